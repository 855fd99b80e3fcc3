// A stage: the light and the triangles of a scene, turned by mouse, touch or keys, with its axes,
// names and controls. Every element of the class "stage" carries its data as JSON.

const AXES = ["x", "y", "z"], PADDING = 46, SUMS = ["line integrals", "maximum"];
const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);
const cross = (a, b) => [0, 1, 2].map(
  (k) => a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
const unit = (a) => a.map((value) => value / Math.hypot(...a));
const along = (origin, d, t) => origin.map((value, a) => value + t * d[a]);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const number = (value, digits = 4) => String(Number(value.toPrecision(digits))).replace("-", "−");
const corners = (box) => [0, 1, 2, 3, 4, 5, 6, 7].map(
  (bits) => [0, 1, 2].map((a) => box[bits >> a & 1][a]));

function made(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

function ticks(lower, upper, most) {
  const rough = (upper - lower) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 2.5, 5, 10].find((n) => n * power >= 0.999 * rough);
  const first = Math.ceil(lower / step - 1e-9), last = Math.floor(upper / step + 1e-9);
  return Array.from({ length: Math.max(last - first + 1, 0) }, (_, k) => (first + k) * step);
}

function ramp(colours, way) {  // of a palette, as a style's background
  const bytes = bytesOf(colours), steps = Array.from({ length: 17 }, (_, k) => {
    const at = 3 * Math.round(255 * k / 16);
    return `rgb(${bytes[at]},${bytes[at + 1]},${bytes[at + 2]})`;
  });
  return `linear-gradient(to ${way}, ${steps.join(",")})`;
}

class Stage {
  constructor(root) {
    const data = JSON.parse(root.querySelector(":scope > script").textContent);
    for (const name of ["canvas", "svg", ".names", ".bars", ".readout", ".controls", "img"])
      this[name.replace(".", "")] = root.querySelector(name);
    const layers = new Map(data.layers.map((layer) => [layer.name, { ...layer }]));
    Object.assign(this, { root, data, layers, seen: "", quality: 1, listeners: [], lines: [],
      box: data.zooms[data.zoom].box });
    for (const one of ["azimuth", "elevation"]) this[one] = data[one] * Math.PI / 180;
    root.stage = this;
    try {
      this.light = new Light(this.canvas, data);
    } catch (error) {
      return this.standStill(error.message);
    }
    this.img.hidden = true;
    root.classList.add("alive");
    this.canvas.addEventListener("webglcontextlost", () => this.standStill("the graphics card was "
      + "lost; load the page again"));
    this.labels = data.labels.map((label) => {
      const span = made("span", { textContent: label.text });
      span.style.color = label.colour;
      this.names.append(span);
      return { ...label, span, width: 0 };
    });
    this.offerControls();
    this.listen();
    this.fit();
    new ResizeObserver(() => { if (!this.moved) this.fit(); this.ask(); }).observe(this.canvas);
    this.now();
    if (data.turning && !matchMedia("(prefers-reduced-motion: reduce)").matches) this.turn();
  }

  standStill(words) {
    this.root.classList.remove("alive");
    this.img.hidden = false;
    this.canvas.hidden = true;
    this.controls.replaceChildren(made("p", { className: "still",
      textContent: `A still picture: ${words}.` }));
  }

  // ---- the eye

  axes() {  // rows right, down, forward
    const { axis, sign } = this.data.up, up = [0, 0, 0], away = [0, 0, 0];
    up[axis] = sign;
    const [first, second] = [(axis + 1) % 3, (axis + 2) % 3];
    away[first] = Math.cos(this.elevation) * Math.cos(this.azimuth);
    away[second] = Math.cos(this.elevation) * Math.sin(this.azimuth);
    away[axis] = sign * Math.sin(this.elevation);
    const forward = away.map((value) => -value), right = unit(cross(forward, up));
    return [right, cross(forward, right), forward];
  }

  view(width = this.canvas.clientWidth, height = this.canvas.clientHeight) {
    const axes = this.axes(), eye = along(this.middle, axes[2], -this.distance);
    // what is far beyond the box in sight, such as cameras behind a close-up, is left out
    const reach = this.distance + 2 * Math.hypot(...this.box[0].map((v, a) => this.box[1][a] - v));
    const lamp = unit([0, 1, 2].map((a) => -0.4 * axes[0][a] - 0.75 * axes[1][a] - 0.55 * axes[2][a]));
    const scale = width / Math.max(this.canvas.clientWidth, 1);
    return { axes, eye, lamp, focal: scale * 2.4 * Math.max(this.canvas.clientWidth,
      this.canvas.clientHeight), principal: [(width - 1) / 2 + scale * this.shift,
      (height - 1) / 2], depths: [0.002 * reach, reach] };
  }

  point(p, view = this.view()) {  // pixels of the page, and the depth
    const seen = view.axes.map((row) => dot(row, p.map((value, a) => value - view.eye[a])));
    return { x: view.focal * seen[0] / seen[2] + view.principal[0],
      y: view.focal * seen[1] / seen[2] + view.principal[1], depth: seen[2] };
  }

  fit() {  // step back until the box and the numbers along it are in the picture
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width) return;
    this.shift = this.data.volume ? Math.min(20, width / 25) : 0;  // for the colour bar
    this.middle = this.box[0].map((value, a) => (value + this.box[1][a]) / 2);
    const size = Math.hypot(...this.box[0].map((value, a) => this.box[1][a] - value)) || 1;
    const room = Math.min(PADDING, width / 6, height / 6);
    for (this.distance = size; this.distance < 100 * size; this.distance *= 1.03) {
      const view = this.view();
      if (corners(this.box).map((p) => this.point(p, view)).every((p) => p.depth > 0
        && p.x > room + this.shift && p.x < width - room && p.y > room / 2 && p.y < height - room))
        break;
    }
  }

  zoom(k) {
    this.box = this.data.zooms[k].box;
    this.moved = false;
    this.zooms.forEach((button, own) => button.setAttribute("aria-pressed", own === k));
    this.fit();
    this.ask();
  }

  turn() {  // once around, as long as that is smooth and nobody takes over
    const began = performance.now(), from = this.azimuth;
    let last = began, slow = 0;
    const step = (now) => {
      if (this.moved || this.still || !this.light) return;
      slow = now - last > 120 ? slow + 1 : 0;
      last = now;
      const part = Math.min((now - began) / 14000, 1);
      this.azimuth = from + 2 * Math.PI * part;
      this.busy();
      this.now();
      if (part < 1 && slow < 8) requestAnimationFrame(step);
      else this.rest();
    };
    requestAnimationFrame(step);
  }

  listen() {
    const canvas = this.canvas, fingers = new Map();
    let held = null, travelled = 0;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
      travelled = 0;
      this.still = true;
      const under = event.button || fingers.size > 1 ? null : this.under(event);
      held = under && under.axis !== undefined ? under.axis : null;
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId), at = [event.offsetX, event.offsetY];
      if (!before) return this.tell(event);
      const by = [at[0] - before[0], at[1] - before[1]];
      travelled += Math.hypot(...by);
      if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        this.distance *= clamp(apart(before) / apart(at), 0.5, 2);
        this.slide(by[0] / 2, by[1] / 2);
      } else if (held !== null) this.drag(held, by);
      else if (event.shiftKey || event.buttons > 1) this.slide(...by);
      else this.orbit(-0.008 * by[0], 0.008 * by[1]);
      fingers.set(event.pointerId, at);
      this.moved = true;
      this.busy();
      this.ask();
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => {
      fingers.delete(event.pointerId);
      held = null;
      if (name === "pointerup" && travelled < 4) {
        const under = this.under(event);
        for (const heard of this.listeners) heard(under);
      }
      this.rest();
    });
    canvas.addEventListener("pointerleave", () => { this.readout.textContent = ""; });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.moved = this.still = true;
      this.distance *= Math.exp(clamp(event.deltaY, -200, 200) * 0.0015);
      this.busy();
      this.ask();
    }, { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1],
        ArrowDown: [0, -0.1] }[event.key];
      if (way) this.orbit(...way);
      else if ("+-".includes(event.key)) this.distance *= event.key === "+" ? 0.9 : 1.1;
      else return;
      event.preventDefault();
      this.moved = this.still = true;
      this.ask();
    });
  }

  orbit(across, up) {
    this.azimuth -= this.data.up.sign * across * -1;
    this.elevation = clamp(this.elevation + up, -1.55, 1.55);
  }

  slide(right, down) {
    const view = this.view(), pace = this.distance / view.focal;
    this.middle = this.middle.map((value, a) => value - pace * (right * view.axes[0][a]
      + down * view.axes[1][a]));
  }

  drag(axis, by) {  // a plane, along its normal
    const step = [0, 0, 0], view = this.view(), length = this.distance / view.focal;
    step[axis] = length;
    const from = this.point(this.middle, view), to = this.point(along(this.middle, step, 1), view);
    const way = [to.x - from.x, to.y - from.y];
    const slider = this.planes[axis].at;
    slider.value = Number(slider.value) + length * dot(way, by) / Math.max(dot(way, way), 0.05);
    slider.dispatchEvent(new Event("input"));
  }

  // ---- pictures

  on(name) { return this.layers.has(name) && this.layers.get(name).visible; }

  busy() {  // fewer pixels while something moves, as many as are drawn in time
    clearTimeout(this.resting);
    this.quality = this.pace || 1;
    this.resting = setTimeout(() => this.rest(), 250);
  }

  rest() {
    clearTimeout(this.resting);
    this.quality = 1;
    this.ask();
  }

  ask() {
    if (!this.asked) this.asked = requestAnimationFrame(() => this.now());
  }

  now() {
    this.asked = 0;
    const { canvas } = this, ratio = Math.min(window.devicePixelRatio || 1, 2) * this.quality;
    if (!canvas.clientWidth || !this.light) return;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height)
      Object.assign(canvas, { width, height });
    const began = performance.now();
    Object.assign(this.light, { lit: this.on("light"), moving: this.quality < 1 });
    this.light.draw(this.view(width, height), this.visible());
    if (this.quality < 1 || this.pace === undefined) {  // how long that took, with the card done
      this.light.gl.readPixels(0, 0, 1, 1, this.light.gl.RGBA, this.light.gl.UNSIGNED_BYTE,
        new Uint8Array(4));
      const took = performance.now() - began, pace = this.quality * Math.sqrt(40 / Math.max(took, 1));
      this.pace = clamp(pace, 0.2, 1);
    }
    this.drawFrame();
  }

  visible() {
    return new Set([...this.layers.values()].filter((one) => one.visible).map((one) => one.name));
  }

  drawFrame() {
    const view = this.view(), { clientWidth: width, clientHeight: height } = this.canvas;
    const { axis: up, sign } = this.data.up, box = this.box;
    const near = [0, 1, 2].map((a) => box[view.eye[a] > this.middle[a] ? 1 : 0][a]);
    const floor = box[sign > 0 ? 0 : 1][up], level = [(up + 1) % 3, (up + 2) % 3];
    const edges = level.map((axis, k) => {
      const ends = [0, 1].map((end) => {
        const p = [0, 0, 0];
        p[axis] = box[end][axis];
        p[level[1 - k]] = near[level[1 - k]];
        p[up] = floor;
        return p;
      });
      return { axis, ends };
    });
    const uprights = level.map((axis, k) => ({ axis: up, ends: [0, 1].map((end) => {
      const p = [0, 0, 0], other = level[1 - k];
      p[up] = box[end][up];
      p[axis] = near[axis];
      p[other] = box[0][other] + box[1][other] - near[other];
      return p;
    }) }));
    const leftness = (edge) => this.point(edge.ends[0], view).x + this.point(edge.ends[1], view).x;
    edges.push(uprights.sort((a, b) => leftness(a) - leftness(b))[0]);
    const paths = [], rest = [], all = corners(box).map((p) => this.point(p, view));
    if (this.data.volume && this.zooms.length < 2 && all.every((p) => p.depth > 0))
      for (const bits of [0, 1, 2, 3, 4, 5, 6, 7]) for (const axis of [1, 2, 4]) if (!(bits & axis))
        rest.push(`M${all[bits].x} ${all[bits].y}L${all[bits | axis].x} ${all[bits | axis].y}`);
    // the colour bars' own place
    const bars = [...this.bars.children].map((one) => [one.offsetLeft + 8, this.bars.offsetTop - 34,
      one.offsetLeft + 52, this.bars.offsetTop + this.bars.offsetHeight + 8]);
    const taken = bars, texts = [], middle = this.point(this.middle, view);
    for (const { axis, ends } of edges) {
      const [from, to] = ends.map((p) => this.point(p, view));
      if (!(from.depth > 0 && to.depth > 0)) continue;
      const length = Math.hypot(to.x - from.x, to.y - from.y);
      let out = unit([from.y - to.y || 1e-9, to.x - from.x]);
      const halfway = [(from.x + to.x) / 2 - middle.x, (from.y + to.y) / 2 - middle.y];
      if (dot(out, halfway) < 0) out = out.map((value) => -value);
      paths.push(`M${from.x} ${from.y}L${to.x} ${to.y}`);
      const most = Math.floor(length / 55);
      const zero = this.data.origin[axis];  // numbers are round in the world
      if (length > 25) for (const value of ticks(box[0][axis] + zero, box[1][axis] + zero,
        clamp(most, 1, 6))) {
        const p = [...ends[0]];
        p[axis] = value - zero;
        const at = this.point(p, view);
        paths.push(`M${at.x} ${at.y}L${at.x + 5 * out[0]} ${at.y + 5 * out[1]}`);
        texts.push([number(value, 8), at.x + 9 * out[0], at.y + 9 * out[1], out]);
      }
      texts.push([`${AXES[axis]} (${this.data.unit})`, middle.x + halfway[0] + 36 * out[0],
        middle.y + halfway[1] + 34 * out[1], out, "title"]);
    }
    this.numbers ??= [];
    for (const [k, [text, x, y, out, kind]] of texts.entries()) {
      const span = this.numbers[k] ??= this.names.appendChild(made("span"));
      if (span.textContent !== text) span.textContent = text;
      span.className = `number ${kind || ""}`;
      const w = span.offsetWidth, h = span.offsetHeight;
      const left = clamp(x + out[0] * w / 2 - w / 2, 2, width - w - 2);
      const top = clamp(y + out[1] * h / 2 - h / 2, 0, height - h);
      const free = this.isFree(taken, [left - 1, top, left + w + 1, top + h]);
      span.style.transform = `translate(${left}px, ${top}px)`;
      span.style.visibility = free ? "visible" : "hidden";
      if (free) taken.push([left - 1, top, left + w + 1, top + h]);
    }
    this.numbers.slice(texts.length).forEach((span) => { span.style.visibility = "hidden"; });
    const rays = this.on("clicked rays") ? this.lines.map((line) => this.path(line, view)) : [];
    const leaders = this.placeNames(view, width, height, taken);
    const paint = (part, d) => this.svg.querySelector(part).setAttribute("d", d.join(""));
    paint(".box", rest);
    paint(".edges", paths);
    paint(".leaders", leaders);
    paint(".rays", rays);
  }

  path(line, view) {  // the part before the eye
    const depth = (p) => dot(view.axes[2], p.map((value, a) => value - view.eye[a]));
    const near = view.depths[0], out = [];
    for (let k = 0; k + 1 < line.length; k++) {
      let [a, b] = [line[k], line[k + 1]], [da, db] = [depth(a), depth(b)];
      if (da < near && db < near) continue;
      const cut = (near - da) / (db - da), on = a.map((value, i) => value + cut * (b[i] - value));
      if (da < near) a = on; else if (db < near) b = on;
      const [from, to] = [this.point(a, view), this.point(b, view)];
      out.push(`M${from.x} ${from.y}L${to.x} ${to.y}`);
    }
    return out.join("");
  }

  isFree(taken, box) {
    return taken.every((o) => box[2] <= o[0] || box[0] >= o[2] || box[3] <= o[1] || box[1] >= o[3]);
  }

  // Names are written over the picture, each as near to its point as those nearer to the eye allow.
  placeNames(view, width, height, taken) {
    const wanted = [], lines = [], slack = Math.hypot(...this.box[0]) * 1e-9;
    for (const label of this.labels) {
      const inside = label.position.every((value, a) => value >= this.box[0][a] - slack
        && value <= this.box[1][a] + slack);
      const at = inside && this.on(label.layer) ? this.point(label.position, view) : { depth: 0 };
      label.span.style.visibility = "hidden";
      if (at.depth > 0) wanted.push({ label, at, tip: this.point(
        along(label.position, label.outward, 1), view) });
    }
    wanted.sort((a, b) => a.at.depth - b.at.depth);
    for (const { label, at, tip } of wanted) {
      if (!label.width)
        Object.assign(label, { width: label.span.offsetWidth, height: label.span.offsetHeight });
      const base = Math.hypot(tip.x - at.x, tip.y - at.y) > 1e-6
        ? Math.atan2(tip.y - at.y, tip.x - at.x) : -Math.PI / 2;
      for (const [reach, turn] of TRIES) {
        const cos = Math.cos(base + turn), sin = Math.sin(base + turn);
        const away = reach + (Math.abs(cos) * label.width + Math.abs(sin) * label.height) / 2;
        const left = at.x + cos * away - label.width / 2, top = at.y + sin * away - label.height / 2;
        const box = [left - 2, top, left + label.width + 2, top + label.height];
        if (left < 0 || top < 0 || box[2] > width || box[3] > height || !this.isFree(taken, box))
          continue;
        taken.push(box);
        label.span.style.transform = `translate(${left}px, ${top}px)`;
        label.span.style.visibility = "visible";
        if (reach > 14) lines.push(`M${at.x} ${at.y}L${at.x + cos * reach} ${at.y + sin * reach}`);
        break;
      }
    }
    return lines;
  }

  // ---- the pointer

  under(event) {
    const { width, height, clientWidth, clientHeight } = this.canvas;
    if (!this.light.batches.length && !this.light.planes.length) return null;
    const x = clamp(Math.floor(event.offsetX * width / clientWidth), 0, width - 1);
    const y = clamp(Math.floor(event.offsetY * height / clientHeight), 0, height - 1);
    return this.light.pick(this.view(width, height), x, y, this.visible());
  }

  tell(event) {
    if (this.telling) return;
    this.telling = true;
    requestAnimationFrame(() => {
      this.telling = false;
      const found = this.under(event), volume = this.data.volume, words = [];
      if (found && found.axis !== undefined)
        words.push(`${number(found.share * volume.highest, 3)} ${volume.unit}`);
      else if (found) {
        words.push(found.name);
        const [low, high] = found.mesh.span || [];
        if (found.mesh.palette) words.push(number(low + found.share * (high - low), 3));
      } else if (volume && this.on("light")) {
        const { width, height, clientWidth, clientHeight } = this.canvas;
        const pixel = [event.offsetX * width / clientWidth, event.offsetY * height / clientHeight]
          .map((value, k) => clamp(Math.floor(value), 0, [width, height][k] - 1));
        const [seen] = this.light.integrals(this.view(width, height), pixel);
        this.light.draw(this.view(width, height), this.visible());
        if (seen > 0) words.push(`${number(seen, 3)} ${this.light.greatest ? volume.unit
          : volume.integral_unit}`);
      }
      this.readout.textContent = words.join(": ");
    });
  }

  // ---- controls

  choose(name, visible) {
    const layer = this.layers.get(name), others = [...this.layers.values()];
    const set = (one, shown) => { one.visible = shown; if (one.input) one.input.checked = shown; };
    if (visible && layer.exclusive) others.filter((one) => one.exclusive).forEach((one) => set(one, false));
    // light before a coloured plane or surface would change its colours
    const hides = layer.exclusive || name === "surfaces" || name.startsWith("plane ");
    if (visible && hides && this.layers.has("light")) set(this.layers.get("light"), false);
    set(layer, visible);
    this.update();
  }

  update() {
    const { light, data } = this, volume = data.volume;
    if (volume) {
      light.setPlanes(this.planes.map((one, axis) => [axis, Number(one.at.value)])
        .filter(([axis]) => this.on(`plane ${AXES[axis]}`)));
      light.levels = this.on("surfaces") ? this.levels.map((one) => Number(one.value) / 100)
        .sort((a, b) => a - b) : [];
      light.threshold = Number(this.threshold.value) / 100;
      light.brightness = 2 ** Number(this.brightness.value);
      light.greatest = this.sum.value !== SUMS[0];
      volume.colours = data.palettes[this.colours.value];
      const axis = AXES.indexOf(this.cutAxis.value);
      light.cut = null;
      if (axis >= 0) {
        const normal = [0, 0, 0];
        normal[axis] = 1;
        const share = Number(this.cutAt.value) / 100;
        light.cut = [...normal, volume.lower[axis] + share * volume.extent[axis]];
      }
      this.planes.forEach((one, axis) => {
        one.at.parentNode.hidden = !this.on(`plane ${AXES[axis]}`);
        one.words.textContent = number(Number(one.at.value) + this.data.origin[axis], 3);
      });
      this.levels.forEach((one) => { one.parentNode.hidden = !this.on("surfaces"); });
      this.sum.parentNode.hidden = !this.on("light");
      for (const layer of this.layers.values())
        if (/^(light|surfaces|plane .)$/.test(layer.name))
          layer.swatch.style.background = ramp(volume.colours, "right");
      this.cutAt.hidden = axis < 0;
    }
    this.showBars();
    this.ask();
  }

  showBars() {
    const bars = [], volume = this.data.volume, planes = this.light.planes.length;
    const { brightness, greatest } = this.light, most = volume && volume.highest / brightness;
    if (volume && this.on("light")) bars.push(greatest
      ? [volume.colours, 0, most, `largest on the line of sight (${volume.quantity})`]
      : [volume.colours, 0, volume.full / brightness,
        `light along the line of sight (${volume.integral_unit})`]);
    if (volume && (planes || this.on("surfaces"))) bars.push([volume.colours, 0, most,
      volume.quantity]);
    for (const { mesh } of this.light.batches)
      if (mesh.palette && mesh.title && this.on(mesh.group)) {
        bars.push([mesh.palette, ...mesh.span, mesh.title]);
        break;
      }
    this.bars.replaceChildren(...bars.slice(0, 2).map(([colours, low, high, title]) => {
      const bar = made("i");
      bar.style.background = ramp(colours, "top");
      return made("div", {}, made("b", { textContent: title }), bar, ...[0, 0.25, 0.5, 0.75, 1].map(
        (share) => {
          const text = made("span", { textContent: number(low + share * (high - low), 3) });
          text.style.bottom = `${100 * share}%`;
          return text;
        }));
    }));
  }

  slider(words, low, high, step, value, more = {}) {
    const input = made("input", { type: "range", min: low, max: high, step, value, ...more });
    input.setAttribute("aria-label", words);
    input.addEventListener("input", () => { this.busy(); this.update(); });
    return input;
  }

  select(words, names) {
    const list = made("select", {}, ...names.map((name) => new Option(name, name)));
    list.setAttribute("aria-label", words);
    list.addEventListener("change", () => this.update());
    return list;
  }

  offerControls() {
    const { data, controls } = this, volume = data.volume, rows = [];
    const row = (words, ...parts) => rows.push(made("label", { className: "row" },
      made("span", { textContent: words }), ...parts));
    this.zooms = data.zooms.map((zoom, k) => {
      const button = made("button", { type: "button", textContent: zoom.label });
      button.addEventListener("click", () => this.zoom(k));
      button.setAttribute("aria-pressed", k === data.zoom);
      return button;
    });
    rows.push(made("div", { className: "zooms" }, ...this.zooms));
    const isFilm = data.moments.length > 1;
    if (isFilm) this.offerFilm(rows);
    const list = made("div", { className: "layers" });
    for (const layer of this.layers.values()) {
      layer.input = made("input", { type: "checkbox", checked: layer.visible });
      layer.input.dataset.layer = layer.name;
      layer.input.addEventListener("change", () => this.choose(layer.name, layer.input.checked));
      const swatch = layer.swatch = made("i");
      swatch.style.background = `linear-gradient(to right, ${layer.colours.flatMap((colour, k, all) =>
        layer.gradient ? [colour] : [`${colour} ${100 * k / all.length}%`,
          `${colour} ${100 * (k + 1) / all.length}%`]).join(",")})`;
      list.append(made("label", {}, layer.input, swatch, made("span", { textContent: layer.name })));
    }
    if (volume) {
      this.brightness = this.slider("brightness", -3, 5, 0.25, 0);
      this.threshold = this.slider("threshold, % of the largest value", 0, 100, 0.5, 0);
      row("brightness", this.brightness);
      row("threshold", this.threshold);
      this.sum = this.select("what is shown along the line of sight", SUMS);
      row("line of sight", this.sum);
      this.colours = this.select("colours", Object.keys(data.palettes));
      row("colours", this.colours);
      this.cutAxis = this.select("axis across which the volume is cut", ["no cut", ...AXES]);
      this.cutAt = this.slider("where the volume is cut, %", 0, 100, 0.5, 50);
      row("cut", this.cutAxis, this.cutAt);
      this.levels = volume.levels.map((level) => this.slider("surface, % of the largest value",
        1, 100, 0.5, 100 * level));
      row("surfaces", ...this.levels);
      this.planes = AXES.map((name, axis) => {
        const [low, size] = [volume.lower[axis], volume.extent[axis]];
        const at = this.slider(`plane ${name}`, low, low + size, size / 400, low + size / 2);
        const words = made("output");
        row(`plane ${name} (${data.unit})`, at, words);
        return { at, words };
      });
    }
    const details = made("details", { className: "more", open: innerWidth > 700 || data.open },
      made("summary", { textContent: "Layers and sliders" }), list, ...rows.splice(isFilm ? 2 : 1));
    controls.append(...rows, details);
    if (data.note) controls.append(made("p", { className: "note", textContent: data.note }));
    this.update();
  }

  // A page beside a program sets `load`, which fetches a frame; other pages hold them all.
  offerFilm(rows) {
    const { moments } = this.data, last = moments.length - 1;
    const slider = made("input", { type: "range", min: 0, max: last, step: 1, value: 0, id: "moment" });
    slider.setAttribute("aria-label", "Frame of the film");
    const play = made("button", { type: "button", textContent: "Play", className: "play" });
    const words = made("output", { className: "moment" });
    const pace = made("select", {}, ...[2, 4, 8, 15, 30].map((n) => new Option(`${n} frames/s`, n)));
    pace.setAttribute("aria-label", "Frames a second");
    pace.value = 8;
    this.moment = (k) => {
      slider.value = k;
      words.textContent = moments[k].label;
      slider.setAttribute("aria-valuetext", moments[k].label);
      this.root.dispatchEvent(new CustomEvent("moment", { detail: k, bubbles: true }));
      if (this.load) return this.load(k);
      this.light.show(k);
      return this.ask();
    };
    let playing = null;  // each run of the film has a number of its own
    const run = async (own) => {
      while (playing === own) {
        const began = performance.now();
        this.busy();
        await this.moment((Number(slider.value) + 1) % (last + 1));
        const left = 1000 / Number(pace.value) - (performance.now() - began);
        await new Promise((done) => setTimeout(done, Math.max(left, 5)));
      }
    };
    this.pause = () => { playing = null; play.textContent = "Play"; this.rest(); };
    play.addEventListener("click", () => {
      if (playing !== null) return this.pause();
      play.textContent = "Pause";
      playing = performance.now();
      return run(playing);
    });
    slider.addEventListener("input", () => { this.pause(); this.busy(); this.moment(Number(slider.value)); });
    rows.push(made("div", { className: "film" }, play, slider, words, pace));
    words.textContent = moments[0].label;
  }
}

const TURNS = [0, 25, -25, 50, -50, 80, -80, 120, -120, 180], REACHES = [5, 14, 26, 42, 60, 84];
const TRIES = REACHES.flatMap((reach) => TURNS.map((turn) => [reach, turn * Math.PI / 180]))
  .sort((a, b) => (a[0] / 14 + Math.abs(a[1]) / 0.44) - (b[0] / 14 + Math.abs(b[1]) / 0.44));

const stages = [...document.querySelectorAll(".stage")].map((root) => new Stage(root));
