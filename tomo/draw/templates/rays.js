// The panel of camera images: a pixel clicked there shows its line of sight in the stage.

const page = JSON.parse(document.getElementById("page-views").textContent);
const scene = stages[0], bounds = scene.data.zooms[0].box.map((p) => along(p, scene.data.origin, 1));
const rays = { drawn: [], view: null, marks: new Map() };

function lagrange(place, count) {
  return Array.from({ length: count }, (_, one) => {
    let weight = 1;
    for (let other = 0; other < count; other++)
      if (other !== one) weight *= (place - other) / (one - other);
    return weight;
  });
}

function between(view, nodes, x, y, count, missing = view.missing) {
  const column = Math.min(Math.max(Math.floor(x) - (count / 2 - 1), 0), view.columns - count);
  const row = Math.min(Math.max(Math.floor(y) - (count / 2 - 1), 0), view.rows - count);
  const across = lagrange(x - column, count), down = lagrange(y - row, count);
  const found = [0, 0, 0];
  for (let r = 0; r < count; r++)
    for (let c = 0; c < count; c++) {
      const node = (row + r) * view.columns + column + c;
      if (missing.has(node)) return null;
      for (let a = 0; a < 3; a++) found[a] += down[r] * across[c] * nodes[3 * node + a];
    }
  return found;
}

// Where a pixel's ray starts and its unit vector; null where the lens maps none. The page's table
// holds them at nodes; between them they follow cubics (straight lines next to missing nodes).
function lineOfSight(view, u, v) {
  const x = (u + 0.5) / view.size[0] * (view.columns - 1);
  const y = (v + 0.5) / view.size[1] * (view.rows - 1);
  for (const count of [4, 2]) {
    const found = between(view, view.nodes, x, y, count);
    if (!found) continue;
    const length = Math.hypot(...found);
    const corners = view.corners.map((nodes, k) => between(view, nodes, x, y, 2, view.straight[k]));
    return {
      corners: corners.every((point) => point) ? corners : [],
      origin: view.origins ? between(view, view.origins, x, y, count) : view.origin,
      direction: found.map((value) => value / length),
    };
  }
  return null;
}

function crossing(origin, d, box) {
  let enter = -Infinity, leave = Infinity;
  for (let a = 0; a < 3; a++) {
    const one = (box[0][a] - origin[a]) / d[a], other = (box[1][a] - origin[a]) / d[a];
    if (Number.isNaN(one) || Number.isNaN(other)) continue;
    enter = Math.max(enter, Math.min(one, other));
    leave = Math.min(leave, Math.max(one, other));
  }
  return leave > Math.max(enter, 0) ? [Math.max(enter, 0), leave] : null;
}

const written = (p) => p.map((value) => Number(value.toPrecision(5))).join(", ");

function cast(view, u, v) {
  const readout = document.getElementById("ray");
  const line = lineOfSight(view, u, v);
  const pixel = `${view.name}, pixel (${u.toFixed(1)}, ${v.toFixed(1)})`;
  if (!line) {
    readout.textContent = `${pixel}: the lens maps no direction here`;
    return;
  }
  const origin = line.origin, d = line.direction;
  const box = page.box || bounds;
  const middle = box[0].map((value, a) => (value + box[1][a]) / 2);
  const radius = Math.hypot(...box[0].map((value, a) => box[1][a] - value)) / 2;
  const nearest = middle.reduce((sum, value, a) => sum + (value - origin[a]) * d[a], 0);
  const foot = along(origin, d, nearest);
  const miss = Math.hypot(...foot.map((value, a) => value - middle[a]));
  const hit = page.box ? crossing(origin, d, page.box) : null;
  const end = Math.max(nearest + 1.5 * radius, hit ? hit[1] : 0, 0.5 * radius);
  rays.drawn.push([...line.corners, origin, along(origin, d, end)]);
  rays.marks.set(view.name, [...(rays.marks.get(view.name) || []), [u, v]]);
  const crosses = hit
    ? ` and crosses the volume from (${written(along(origin, d, hit[0]))}) to `
      + `(${written(along(origin, d, hit[1]))})`
    : " and misses the volume";
  readout.textContent = `${pixel} looks along `
    + `(${written(d.map((value) => Math.round(1e5 * value) / 1e5 + 0))})`
    + (page.box ? `, passes the volume's middle at ${Number(miss.toPrecision(3))} ${scene.data.unit}${crosses}`
      : "");
  readout.dataset.direction = JSON.stringify(d);
  drawRays();
  if (scene.light && !scene.on("clicked rays")) scene.choose("clicked rays", true);
  paint();
}

function drawRays() {
  scene.lines = rays.drawn.map((line) => line.map((point) => along(point, scene.data.origin, -1)));
  if (scene.light) scene.ask();
}

function paint() {
  const view = rays.view, canvas = document.getElementById("picture");
  const [width, height] = view.size;
  const shown = canvas.clientWidth || 300;
  const tall = Math.min(shown * height / width, 520);
  const ratio = window.devicePixelRatio || 1;
  canvas.style.height = `${tall}px`;
  canvas.width = shown * ratio;
  canvas.height = tall * ratio;
  const pen = canvas.getContext("2d");
  // the whole image fits; a tall one leaves room at its sides
  const zoom = Math.min(canvas.width / width, canvas.height / height);
  rays.place = { zoom: zoom / ratio, left: (canvas.width - zoom * width) / 2 / ratio,
    top: (canvas.height - zoom * height) / 2 / ratio };
  pen.setTransform(zoom, 0, 0, zoom, rays.place.left * ratio, rays.place.top * ratio);
  pen.fillStyle = "#fff";
  pen.fillRect(0, 0, width, height);
  if (view.picture) pen.drawImage(view.picture, 0, 0, width, height);
  pen.save();
  pen.beginPath();
  pen.rect(0, 0, width, height);
  pen.clip();
  pen.translate(0.5, 0.5);  // pixel centres are at integers
  pen.lineWidth = 1.2 * ratio / zoom;
  pen.strokeStyle = view.picture ? "#f6b04c" : "#1b2733";
  for (const line of view.outlines) {
    pen.beginPath();
    line.forEach(([u, v], k) => (k ? pen.lineTo(u, v) : pen.moveTo(u, v)));
    pen.stroke();
  }
  pen.strokeStyle = "#d4148c";
  pen.lineWidth = 1.6 * ratio / zoom;
  const arm = 7 * ratio / zoom;
  for (const [u, v] of rays.marks.get(view.name) || []) {
    pen.beginPath();
    pen.moveTo(u - arm, v);
    pen.lineTo(u + arm, v);
    pen.moveTo(u, v - arm);
    pen.lineTo(u, v + arm);
    pen.stroke();
  }
  pen.restore();
  pen.strokeStyle = "#9aa5b1";
  pen.lineWidth = ratio / zoom;
  pen.strokeRect(0, 0, width, height);
}

function select(name) {
  const view = page.views.find((candidate) => candidate.name === name);
  if (!view) return;
  rays.view = view;
  document.getElementById("camera").value = name;
  if (view.image && !view.picture) {
    const picture = new Image();
    picture.onload = () => { view.picture = picture; if (rays.view === view) paint(); };
    picture.src = view.image;
  }
  paint();
}

function offerViews() {
  const list = document.getElementById("camera");
  for (const view of page.views) {
    view.missing = new Set(view.missing);
    view.straight = view.straight.map((nodes) => new Set(nodes));
    list.append(new Option(view.name, view.name));
  }
  list.addEventListener("change", () => select(list.value));
  const column = document.getElementById("column"), row = document.getElementById("row");
  document.getElementById("picture").addEventListener("click", (event) => {
    const bounds = event.target.getBoundingClientRect(), place = rays.place;
    const u = (event.clientX - bounds.left - event.target.clientLeft - place.left) / place.zoom;
    const v = (event.clientY - bounds.top - event.target.clientTop - place.top) / place.zoom;
    if (u < 0 || v < 0 || u > rays.view.size[0] || v > rays.view.size[1]) return;
    column.value = (u - 0.5).toFixed(1);
    row.value = (v - 0.5).toFixed(1);
    cast(rays.view, u - 0.5, v - 0.5);
  });
  document.getElementById("cast").addEventListener("click", () => {
    if (column.value !== "" && row.value !== "")
      cast(rays.view, Number(column.value), Number(row.value));
  });
  document.getElementById("clear").addEventListener("click", () => {
    rays.drawn = [];
    rays.marks.clear();
    drawRays();
    paint();
  });
  window.addEventListener("resize", paint);
  select(page.views[0].name);
  const named = new Set(page.views.map((view) => view.name));
  scene.listeners.push((under) => { if (under && named.has(under.name)) select(under.name); });
}

if (page.views.length) offerViews();
