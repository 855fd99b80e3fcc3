// Draws a volume's light, added along lines of sight, and the triangles of a scene, by WebGL2.
// Lengths are the scene's own, counted from data.origin, because the card computes in float32.

const POINT = `#version 300 es
in vec3 position; in float owner; in float fraction;
uniform mat3 axes; uniform vec3 eye; uniform vec4 lens; uniform vec2 depths;
out vec3 place; flat out float mine; out float part;
void main() {
  place = position; mine = owner; part = fraction;
  vec3 seen = axes * (position - eye);
  float near = depths.x, far = depths.y;
  gl_Position = vec4(lens.xy * seen.xy + lens.zw * seen.z,
    ((far + near) * seen.z - 2.0 * far * near) / (far - near), seen.z);
}`;

const SURFACE = `#version 300 es
precision highp float; precision highp sampler3D;
in vec3 place; flat in float mine; in float part;
uniform vec4 colour; uniform vec3 lamp, lower, extent; uniform float number, gain;
uniform bool coloured, inside, picked; uniform sampler2D palette; uniform sampler3D volume;
out vec4 shown;
void main() {
  float value = inside ? texture(volume, ((place - lower) / extent).zyx).r : part;
  if (picked) {  // what is here, and its value, for the pointer
    float index = number + mine;
    shown = vec4(mod(index, 256.0) / 255.0, floor(index / 256.0) / 255.0, value, 1.0);
  } else if (coloured) {
    shown = vec4(value < 0.0 ? vec3(0.35) : texture(palette, vec2(value * gain, 0.5)).rgb,
      colour.a);
  } else {
    vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
    shown = vec4(colour.rgb * (0.6 + 0.4 * abs(dot(normal, lamp))), colour.a);
  }
}`;

const SCREEN = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

const MARCH = `#version 300 es
precision highp float; precision highp sampler3D;
uniform sampler3D volume; uniform sampler2D palette, base, depth;
uniform mat3 axes; uniform vec3 eye, lower, extent; uniform vec4 pinhole, cut, levels;
uniform vec2 depths; uniform float stride, threshold, gain, lit;
uniform int surfaces; uniform bool greatest, raw, bare;  // greatest: the largest value in place of the integral
out vec4 shown;
float value(vec3 p) { return texture(volume, ((p - lower) / extent).zyx).r; }
vec3 slope(vec3 p) {
  vec3 h = vec3(2.0 * stride, 0.0, 0.0);
  return vec3(value(p + h.xyy) - value(p - h.xyy), value(p + h.yxy) - value(p - h.yxy),
    value(p + h.yyx) - value(p - h.yyx));
}
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec2 plane = vec2(gl_FragCoord.x - pinhole.z, pinhole.w - gl_FragCoord.y) / pinhole.x;
  vec3 ahead = transpose(axes) * vec3(plane, 1.0);
  float stretch = length(ahead);
  ahead /= stretch;
  vec3 a = (lower - eye) / ahead, b = (lower + extent - eye) / ahead;
  vec3 enters = min(a, b), leaves = max(a, b);
  float first = max(max(max(enters.x, enters.y), enters.z), 0.0);
  float last = min(min(leaves.x, leaves.y), leaves.z);
  // behind the cut, whose normal is cut.xyz, nothing is shown
  float along = dot(cut.xyz, ahead), off = cut.w - dot(cut.xyz, eye);
  if (along > 0.0) last = min(last, off / along);
  else if (along < 0.0) first = max(first, off / along);
  else if (off < 0.0) last = first;
  vec4 ground = vec4(0.0, 0.0, 0.0, 1.0);
  if (!bare) {
    ground = texelFetch(base, pixel, 0);
    float z = 2.0 * texelFetch(depth, pixel, 0).r - 1.0;
    last = min(last, stretch * 2.0 * depths.x * depths.y
      / (depths.y + depths.x - z * (depths.y - depths.x)));
  }
  float total = 0.0, before = 0.0;
  vec4 shells = vec4(0.0);
  if (last > first) {
    int count = min(int(ceil((last - first) / stride)), 4096);
    float pace = (last - first) / float(count);
    for (int k = 0; k < count; k++) {
      vec3 p = eye + (first + (float(k) + 0.5) * pace) * ahead;
      float v = value(p);
      if (v >= threshold) total = greatest ? max(total, v) : total + v;
      for (int one = 0; one < surfaces; one++) {
        float level = levels[one];
        bool crossed = shells.a <= 0.99 && (v >= level) != (before >= level);
        // a loop, not an if: without a graphics card both sides of an if are computed
        for (int once = 0; once < int(crossed); once++) {
          vec3 normal = slope(p - ahead * pace * (v - level) / (v - before));
          float facing = abs(dot(normal, ahead)) / max(length(normal), 1e-9);
          float opacity = one + 1 < surfaces ? 0.3 : 0.95;
          vec3 tint = texture(palette, vec2(0.35 + 0.6 * level, 0.5)).rgb;
          shells += (1.0 - shells.a) * opacity * vec4(tint * (0.35 + 0.65 * facing), 1.0);
        }
      }
      before = v;
    }
    if (!greatest) total *= pace;
  }
  if (raw) {  // the integral over the box's diagonal, or the largest value, as three bytes
    float share = clamp(greatest ? total : total / length(extent), 0.0, 1.0) * 16777215.0;
    shown = vec4(mod(share, 256.0), mod(floor(share / 256.0), 256.0), floor(share / 65536.0),
      255.0) / 255.0;
    return;
  }
  vec3 light = lit * texture(palette, vec2(clamp(total * gain, 0.0, 1.0), 0.5)).rgb;
  shown = vec4(ground.rgb * (1.0 - shells.a) + shells.rgb + light, 1.0);
}`;

const fraction = (step) => (step ? (step - 1) / 254 : -1);
const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

class Light {
  // Throws where the browser has no WebGL2 or the card cannot hold the volume.
  constructor(canvas, data) {
    const gl = canvas.getContext("webgl2", { alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser offers no WebGL2");
    Object.assign(this, { gl, canvas, data, threshold: 0, brightness: 1, levels: [],
      cut: null, lit: true, greatest: false, moving: false, planes: [], frame: -1 });
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.march = this.program(SCREEN, MARCH);
    this.surface = this.program(POINT, SURFACE);
    this.palettes = new Map();
    this.count = 1;  // names before a mesh's own, from 1
    this.batches = data.meshes.map((mesh) => this.batch(mesh));
    if (data.volume) {
      const most = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
      if (Math.max(...data.volume.shape) > most)
        throw new Error(`this graphics card holds volumes up to ${most} voxels long`);
      const n = data.volume.shape, sides = data.volume.extent.map((side, k) => side / n[k]);
      this.stride = Math.min(...sides) / 2;
    }
    this.empty = this.texture3D([1, 1, 1], new Uint8Array(1));
    this.show(0);
  }

  program(vertex, fragment) {
    const gl = this.gl, made = gl.createProgram(), places = {};
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
        throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    ["position", "owner", "fraction"].forEach((name, k) => gl.bindAttribLocation(made, k, name));
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    const at = (name) => places[name] ??= gl.getUniformLocation(made, name);
    return { made, at };
  }

  texture3D([nx, ny, nz], bytes) {  // C order: z runs fastest
    const gl = this.gl, made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_3D, made);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8, nz, ny, nx, 0, gl.RED, gl.UNSIGNED_BYTE, bytes);
    for (const way of ["S", "T", "R"])
      gl.texParameteri(gl.TEXTURE_3D, gl[`TEXTURE_WRAP_${way}`], gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_3D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_3D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    return made;
  }

  texture2D(format, kind, width, height, type, bytes = null) {
    const gl = this.gl, made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, kind, type, bytes);
    for (const [name, value] of [["MIN_FILTER", bytes ? "LINEAR" : "NEAREST"],
      ["MAG_FILTER", bytes ? "LINEAR" : "NEAREST"], ["WRAP_S", "CLAMP_TO_EDGE"],
      ["WRAP_T", "CLAMP_TO_EDGE"]]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl[value]);
    return made;
  }

  palette(text) {  // 256 colours
    const gl = this.gl;
    if (!this.palettes.has(text))
      this.palettes.set(text, this.texture2D(gl.RGB8, gl.RGB, 256, 1, gl.UNSIGNED_BYTE, bytesOf(text)));
    return this.palettes.get(text);
  }

  batch(mesh) {
    const positions = new Float32Array(bytesOf(mesh.vertices).buffer);
    const count = positions.length / 3, owners = new Float32Array(count);
    const fractions = mesh.values ? Float32Array.from(bytesOf(mesh.values), fraction)
      : new Float32Array(count);
    let at = 0;
    mesh.counts.forEach((size, k) => { owners.fill(k, at, at + size); at += size; });
    const number = this.count;
    this.count += mesh.names.length;
    return { mesh, number, positions, ...this.upload(positions, owners, fractions,
      new Uint32Array(bytesOf(mesh.triangles).buffer)) };
  }

  upload(positions, owners, fractions, triangles) {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [[positions, 3], [owners, 1], [fractions, 1]].map(([values, width], place) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, width, gl.FLOAT, false, 0, 0);
      return buffer;
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return { array, length: triangles.length, fractions: buffers[2] };
  }

  show(frame) {  // of a film
    const volume = this.data.volume;
    if (!volume || frame === this.frame) return;
    this.hold(bytesOf(volume.frames[frame]));
    this.frame = frame;
  }

  hold(bytes) {  // another volume on the same grid
    if (this.volume) this.gl.deleteTexture(this.volume);
    this.volume = this.texture3D(this.data.volume.shape, bytes);
  }

  // Other numbers at the vertices of a batch, as 0 for none and 1 to 255 from the lowest up.
  recolour(batch, steps) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, batch.fractions);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, Float32Array.from(steps, fraction));
  }

  // Planes across an axis at a coordinate: [axis, at], as triangles of the scene.
  setPlanes(planes) {
    const { lower, extent } = this.data.volume;
    for (const old of this.planes) this.gl.deleteVertexArray(old.array);
    this.planes = planes.map(([axis, at]) => {
      const corners = [0, 1, 2, 3].flatMap((bits) => {
        const point = [0, 0, 0], [u, v] = [0, 1, 2].filter((other) => other !== axis);
        point[axis] = at;
        point[u] = lower[u] + (bits & 1) * extent[u];
        point[v] = lower[v] + (bits >> 1) * extent[v];
        return point;
      });
      const mesh = { opacity: 1, colour: [1, 1, 1], palette: this.data.volume.colours };
      return { axis, mesh, number: this.count + axis, ...this.upload(new Float32Array(corners), new Float32Array(4),
        new Float32Array(4), new Uint32Array([0, 1, 2, 2, 1, 3])) };
    });
  }

  target(width, height) {  // the triangles' picture and depth, smoothed by four samples
    const gl = this.gl, kept = this.kept;
    if (kept && kept.width === width && kept.height === height) return kept;
    if (kept) {
      for (const one of [kept.colour, kept.depth]) gl.deleteTexture(one);
      for (const one of [kept.many, kept.one, kept.pick]) gl.deleteFramebuffer(one);
      for (const one of kept.buffers) gl.deleteRenderbuffer(one);
    }
    const samples = Math.min(4, gl.getParameter(gl.MAX_SAMPLES));
    const buffer = (format, place, count) => {
      const made = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, made);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, count, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, made);
      return made;
    };
    const many = gl.createFramebuffer(), one = gl.createFramebuffer(), pick = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, many);
    const buffers = [buffer(gl.RGBA8, gl.COLOR_ATTACHMENT0, samples),
      buffer(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT, samples)];
    gl.bindFramebuffer(gl.FRAMEBUFFER, pick);
    buffers.push(buffer(gl.RGBA8, gl.COLOR_ATTACHMENT0, 0),
      buffer(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT, 0));
    const colour = this.texture2D(gl.RGBA8, gl.RGBA, width, height, gl.UNSIGNED_BYTE);
    const depth = this.texture2D(gl.DEPTH_COMPONENT24, gl.DEPTH_COMPONENT, width, height,
      gl.UNSIGNED_INT);
    gl.bindFramebuffer(gl.FRAMEBUFFER, one);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, colour, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depth, 0);
    return this.kept = { width, height, many, one, pick, colour, depth, buffers };
  }

  // A view: eye (3), axes (rows right, down, forward), focal and principal in pixels whose
  // centres are whole numbers, depths [near, far].
  common(program, view) {
    const gl = this.gl, { at } = program, volume = this.data.volume;
    gl.useProgram(program.made);
    // given row by row, read column by column: the transpose is its turn
    gl.uniformMatrix3fv(at("axes"), false, [0, 1, 2].flatMap((c) => view.axes.map((row) => row[c])));
    gl.uniform3fv(at("eye"), view.eye);
    gl.uniform2fv(at("depths"), view.depths);
    gl.uniform3fv(at("lower"), volume ? volume.lower : [0, 0, 0]);
    gl.uniform3fv(at("extent"), volume ? volume.extent : [1, 1, 1]);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_3D, this.volume || this.empty);
    gl.uniform1i(at("volume"), 0);
    gl.uniform1i(at("palette"), 1);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, volume ? this.palette(volume.colours) : null);
  }

  triangles(view, width, height, pick, layers) {
    const gl = this.gl, program = this.surface, { at } = program;
    this.common(program, view);
    const [u, v] = view.principal;
    gl.uniform4f(at("lens"), 2 * view.focal / width, -2 * view.focal / height,
      (2 * u + 1) / width - 1, 1 - (2 * v + 1) / height);
    gl.uniform3fv(at("lamp"), view.lamp);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniform1i(at("picked"), pick);
    const drawn = [...this.batches.filter((one) => layers.has(one.mesh.group)), ...this.planes];
    for (const clear of [false, true]) {  // what is clear comes last and hides nothing
      for (const one of drawn) {
        if (one.mesh.opacity < 1 !== clear) continue;
        gl.depthMask(!clear || pick);
        (clear && !pick ? gl.enable : gl.disable).call(gl, gl.BLEND);
        gl.uniform1i(at("coloured"), Boolean(one.mesh.palette));
        gl.uniform1i(at("inside"), one.axis !== undefined);
        gl.uniform1f(at("gain"), one.axis === undefined ? 1 : this.brightness);
        gl.uniform1f(at("number"), one.number);
        gl.uniform4f(at("colour"), ...one.mesh.colour, one.mesh.opacity);
        if (one.mesh.palette) gl.bindTexture(gl.TEXTURE_2D, this.palette(one.mesh.palette));
        gl.bindVertexArray(one.array);
        gl.drawElements(gl.TRIANGLES, one.length, gl.UNSIGNED_INT, 0);
      }
    }
    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
  }

  draw(view, layers = new Set(), raw = false) {
    const gl = this.gl, { width, height } = this.canvas, volume = this.data.volume;
    const kept = this.target(width, height), bare = raw || !(this.batches.length || this.planes.length);
    if (!bare) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, kept.many);
      gl.viewport(0, 0, width, height);
      gl.clearColor(0, 0, 0, 1);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      this.triangles(view, width, height, false, layers);
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, kept.many);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, kept.one);
      gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height,
        gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT, gl.NEAREST);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    const { at } = this.march;
    this.common(this.march, view);
    gl.uniform1i(at("base"), 2);
    gl.uniform1i(at("depth"), 3);
    gl.activeTexture(gl.TEXTURE2);
    gl.bindTexture(gl.TEXTURE_2D, bare ? null : kept.colour);
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, bare ? null : kept.depth);
    gl.uniform4f(at("pinhole"), view.focal, view.focal, view.principal[0] + 0.5,
      height - view.principal[1] - 0.5);
    gl.uniform4fv(at("cut"), this.cut || [0, 0, 0, 1]);
    gl.uniform4fv(at("levels"), [...this.levels, 0, 0, 0, 0].slice(0, 4));
    gl.uniform1i(at("surfaces"), Math.min(this.levels.length, 3));
    gl.uniform1f(at("stride"), volume ? this.stride * (this.moving ? 2 : 1) : 1);
    gl.uniform1f(at("threshold"), this.threshold);
    gl.uniform1f(at("gain"), this.brightness * (this.greatest || !volume ? 1
      : volume.highest / volume.full));
    gl.uniform1i(at("greatest"), this.greatest);
    gl.uniform1f(at("lit"), this.lit && volume ? 1 : 0);
    gl.uniform1i(at("raw"), raw);
    gl.uniform1i(at("bare"), bare);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // Line integrals along the canvas' pixels, or one of them, first row on top; largest values
  // where those are shown.
  integrals(view, pixel = null) {
    const gl = this.gl, { width, height } = this.canvas, volume = this.data.volume;
    const [x, y, w, h] = pixel ? [pixel[0], height - 1 - pixel[1], 1, 1] : [0, 0, width, height];
    const bytes = new Uint8Array(4 * w * h), found = new Float32Array(w * h);
    if (pixel) { gl.enable(gl.SCISSOR_TEST); gl.scissor(x, y, w, h); }
    this.draw(view, new Set(), true);
    gl.readPixels(x, y, w, h, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    gl.disable(gl.SCISSOR_TEST);
    const whole = volume.highest * (this.greatest ? 1 : Math.hypot(...volume.extent)) / 16777215;
    for (let k = 0; k < found.length; k++) {
      const from = 4 * ((h - 1 - Math.floor(k / w)) * w + k % w);
      found[k] = whole * (bytes[from] + 256 * bytes[from + 1] + 65536 * bytes[from + 2]);
    }
    return found;
  }

  // What the pointer is on: { group, name, share } of a mesh, { axis, share } of a plane, or null.
  pick(view, x, y, layers) {
    const gl = this.gl, { width, height } = this.canvas, kept = this.target(width, height);
    const bytes = new Uint8Array(4);
    gl.bindFramebuffer(gl.FRAMEBUFFER, kept.pick);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(x, height - 1 - y, 1, 1);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.triangles(view, width, height, true, layers);
    gl.readPixels(x, height - 1 - y, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    let number = bytes[0] + 256 * bytes[1] - 1;
    const share = bytes[2] / 255;
    if (number < 0) return null;
    for (const { mesh } of this.batches) {
      if (number < mesh.names.length) return { mesh, name: mesh.names[number], share };
      number -= mesh.names.length;
    }
    return { axis: number, share };
  }
}
