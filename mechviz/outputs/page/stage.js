/* The picture of the mechanism: lit solids, arrows, lines and dots in WebGL 2; names of joints as text above it. */

const SOLID = {
  vertex: `#version 300 es
    uniform mat4 clip; uniform vec4 pose; // x, y, cos, sin
    uniform float stretch; // along x: of springs
    uniform vec3 shift; uniform vec4 spin; // in the link's frame: of cams that turn about an axis in the plane
    in vec3 place; in vec3 normal; in vec3 color;
    out vec3 n; out vec3 p; out vec3 c;
    vec2 turned(vec2 v) { return vec2(pose.z * v.x - pose.w * v.y, pose.w * v.x + pose.z * v.y); }
    vec3 spun(vec3 v) { return v + 2.0 * cross(spin.xyz, cross(spin.xyz, v) + spin.w * v); }
    void main() {
      vec3 at = spun(place * vec3(stretch, 1, 1)) + shift, up = spun(normal * vec3(1.0 / stretch, 1, 1));
      p = vec3(turned(at.xy) + pose.xy, at.z); n = vec3(turned(up.xy), up.z); c = color;
      gl_Position = clip * vec4(p, 1.0);
    }`,
  fragment: `#version 300 es
    precision highp float;
    uniform vec3 eye; uniform vec3 sight; uniform float flatView; uniform float gain;
    in vec3 n; in vec3 p; in vec3 c; out vec4 result;
    const vec3 KEY = vec3(-0.30, 0.50, 0.81), FILL = vec3(0.62, 0.06, 0.78);
    void main() {
      vec3 N = normalize(n), V = flatView > 0.5 ? sight : normalize(eye - p);
      float sky = 0.5 + 0.5 * N.y;
      vec3 light = mix(vec3(0.36, 0.37, 0.41), vec3(0.50, 0.51, 0.53), sky);
      light += 0.52 * max(dot(N, KEY), 0.0) + 0.14 * max(dot(N, FILL), 0.0) + 0.10 * max(dot(N, V), 0.0);
      float shine = pow(max(dot(N, normalize(KEY + V)), 0.0), 48.0);
      float rim = pow(1.0 - max(dot(N, V), 0.0), 3.0);
      vec3 linear = pow(c, vec3(2.2)) * light * gain + vec3(0.16) * shine + vec3(0.05) * rim;
      result = vec4(pow(clamp(linear, 0.0, 1.0), vec3(1.0 / 2.2)), 1.0);
    }`,
};

const ARROW = {
  // an arrow of unit size, stretched to each instance: its shaft and head keep their thickness
  vertex: `#version 300 es
    uniform mat4 clip;
    in vec3 part; // cosine, sine, which ring
    in vec3 origin; in vec4 reach; in vec3 tint; // vector and radius
    out vec3 n; out vec3 p; out vec3 c;
    void main() {
      float len = length(reach.xyz), r = min(reach.w, 0.09 * len), head = min(6.5 * reach.w, 0.42 * len), wide = 0.36 * head;
      vec3 along = reach.xyz / max(len, 1e-30);
      vec3 side = normalize(abs(along.z) < 0.9 ? cross(along, vec3(0, 0, 1)) : cross(along, vec3(1, 0, 0)));
      vec3 out2 = part.x * side + part.y * cross(along, side);
      float ring = part.z;
      float at = ring < 0.5 ? 0.0 : ring < 3.5 ? len - head : len;
      float w = ring < 1.8 ? r : ring < 3.5 ? wide : 0.0;
      n = ring < 1.5 ? out2 : ring < 2.5 ? -along : normalize(out2 * head + along * wide);
      p = origin + at * along + w * out2; c = tint;
      gl_Position = clip * vec4(p, 1.0);
    }`,
  fragment: SOLID.fragment,
};

const LINE = {
  // segments with round ends, as wide as stated in the world but never thinner than a pixel and a half
  vertex: `#version 300 es
    uniform mat4 clip; uniform vec2 pixels; uniform float perMetre; // pixels of a metre at unit depth
    in vec2 corner; in vec3 from; in vec3 to; in vec4 tint;
    out vec2 at; out float half_; out float len; out vec3 c;
    void main() {
      vec4 a = clip * vec4(from, 1.0), b = clip * vec4(to, 1.0);
      vec2 pa = a.xy / a.w * pixels, pb = b.xy / b.w * pixels;
      half_ = max(tint.w * perMetre / mix(a.w, b.w, corner.x), 0.9);
      vec2 d = pb - pa; len = length(d);
      vec2 u = len > 1e-6 ? d / len : vec2(1, 0), v = vec2(-u.y, u.x);
      float e = (corner.x * 2.0 - 1.0) * (half_ + 1.0), w = corner.y * (half_ + 1.0);
      at = vec2(corner.x * len + e, w); c = tint.xyz;
      vec2 spot = mix(pa, pb, corner.x) + u * e + v * w;
      vec4 end = corner.x < 0.5 ? a : b;
      gl_Position = vec4(spot / pixels * end.w, end.z, end.w);
    }`,
  fragment: `#version 300 es
    precision highp float;
    in vec2 at; in float half_; in float len; in vec3 c; out vec4 result;
    void main() {
      float d = length(at - vec2(clamp(at.x, 0.0, len), 0.0));
      float cover = clamp(half_ + 0.5 - d, 0.0, 1.0);
      if (cover < 0.02) discard;
      result = vec4(c * cover, cover);
    }`,
};

const RING = 20;

class Stage {
  constructor(canvas, labels, header, arrays, theme) {
    this.canvas = canvas;
    this.labelBox = labels;
    this.header = header;
    this.arrays = arrays;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("This browser offers no WebGL 2, which the picture needs. The plots work without it.");
    this.camera = new Camera(header.drawn, header.core);
    this.size = Math.max(header.bounds[1][0] - header.bounds[0][0], header.bounds[1][1] - header.bounds[0][1], 1e-9);
    this.shown = Object.fromEntries(header.groups.map((g) => [g.name, g.shown]));
    this.theme = theme;
    const { per_metre } = header.length;
    const wanted = (this.size / 10) * per_metre; // a round length near a tenth of the mechanism
    const decade = 10 ** Math.floor(Math.log10(wanted));
    this.cell = (decade * [5, 2, 1].find((step) => step * decade <= wanted * (1 + 1e-9))) / per_metre;
    this.load();
    // phones take graphics memory away from pages in the background, and give it back
    canvas.addEventListener("webglcontextlost", (e) => e.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.load();
      if (this.state) this.draw(this.state.frame);
    });
    this.tags = [];
    for (const d of header.drawables)
      if (d.labels.some((t) => t)) for (let k = 0; k < d.count; k++) if (d.labels[k]) this.tags.push({ d, k, span: this.tag(d.labels[k]) });
    this.resize();
  }

  /** Creates everything in the memory of the graphics card. */
  load() {
    const { gl, header } = this;
    this.programs = { solid: program(gl, SOLID), arrow: program(gl, ARROW), line: program(gl, LINE) };
    this.solids = [...header.links.filter((link) => link.mesh), ...header.bodies].map((link) => this.solid(link));
    this.arrowMesh = arrowMesh(gl, this.programs.arrow);
    this.lineMesh = lineMesh(gl, this.programs.line);
  }

  tag(text) {
    const span = document.createElement("span");
    span.textContent = text;
    this.labelBox.append(span);
    return span;
  }

  solid(link) {
    const { gl, arrays } = this;
    const { vertices, normals, faces, colors, palette } = link.mesh;
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const attribute = (name, data, size, type, normalized) => {
      const at = gl.getAttribLocation(this.programs.solid.handle, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, type, normalized, 0, 0);
    };
    attribute("place", arrays[vertices], 3, gl.FLOAT, false);
    attribute("normal", arrays[normals], 3, gl.FLOAT, false);
    const paint = palette.map(rgb);
    const bytes = new Float32Array(arrays[colors].length * 3);
    arrays[colors].forEach((n, k) => bytes.set(paint[n], 3 * k));
    attribute("color", bytes, 3, gl.FLOAT, false);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, arrays[faces], gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return { link, vao, count: arrays[faces].length };
  }

  /** Adapts to the size of the canvas; returns whether it has changed. */
  resize() {
    const scale = Math.min(window.devicePixelRatio || 1, 2);
    const box = this.canvas.getBoundingClientRect();
    const [w, h] = [Math.max(1, Math.round(box.width * scale)), Math.max(1, Math.round(box.height * scale))];
    this.scale = scale;
    const over = ["views", "groups"].map((id) => document.getElementById(id)).filter((e) => e && getComputedStyle(e).position === "absolute");
    const low = Math.max(box.top, ...over.map((e) => e.getBoundingClientRect().bottom));
    this.camera.covered = Math.min(Math.max((low - box.top) / (box.height || 1), 0), 0.35);
    this.camera.resize(w / h);
    if (this.canvas.width === w && this.canvas.height === h) return false;
    [this.canvas.width, this.canvas.height] = [w, h];
    return true;
  }

  /** Pose of a link at a frame, which may have a fraction: x, y, angle. */
  pose(link, frame) {
    const values = this.arrays[link.pose];
    if (!link.moves) return [values[0], values[1], values[2]];
    const [k, t] = split(frame, this.header.frames);
    const next = Math.min(k + 1, this.header.frames - 1);
    return [0, 1, 2].map((i) => values[3 * k + i] * (1 - t) + values[3 * next + i] * t);
  }

  /** Displacement and quaternion of a solid relative to its link at a frame. */
  spin(link, frame) {
    if (link.spin === undefined) return [0, 0, 0, 0, 0, 0, 1];
    const values = this.arrays[link.spin];
    const [k, t] = split(frame, this.header.frames);
    const next = Math.min(k + 1, this.header.frames - 1);
    const found = [0, 1, 2, 3, 4, 5, 6].map((i) => values[7 * k + i] * (1 - t) + values[7 * next + i] * t);
    const length = Math.hypot(...found.slice(3));
    return found.map((x, i) => (i < 3 ? x : x / length));
  }

  /** Scale of a spring along its axis. */
  stretch(link, frame) {
    return link.stretch === undefined ? 1 : at(this.arrays[link.stretch], 1, frame, this.header.frames)[0];
  }

  draw(frame) {
    const { gl, camera } = this;
    const { clip, eye, back } = camera.matrices();
    if (gl.isContextLost()) {
      this.state = { ...this.state, frame };
      return;
    }
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.enable(gl.CULL_FACE);
    const lit = (p) => {
      gl.useProgram(p.handle);
      gl.uniformMatrix4fv(p.at("clip"), false, clip);
      gl.uniform3fv(p.at("eye"), eye);
      gl.uniform3fv(p.at("sight"), back);
      gl.uniform1f(p.at("flatView"), camera.flat ? 1 : 0);
    };
    const { solid, arrow, line } = this.programs;
    lit(solid);
    gl.uniform1f(solid.at("gain"), this.theme.dark ? 1.0 : 1.06);
    for (const s of this.solids) {
      if (s.link.group && this.shown[s.link.group] === false) continue;
      gl.uniform1f(solid.at("stretch"), this.stretch(s.link, frame));
      const [x, y, angle] = this.pose(s.link, frame);
      gl.uniform4f(solid.at("pose"), x, y, Math.cos(angle), Math.sin(angle));
      const spin = this.spin(s.link, frame);
      gl.uniform3f(solid.at("shift"), ...spin.slice(0, 3));
      gl.uniform4f(solid.at("spin"), ...spin.slice(3));
      gl.bindVertexArray(s.vao);
      gl.drawElements(gl.TRIANGLES, s.count, gl.UNSIGNED_INT, 0);
    }
    const { arrows, lines } = this.collect(frame);
    gl.disable(gl.CULL_FACE);
    lit(arrow);
    gl.uniform1f(arrow.at("gain"), 1.15);
    this.instances(this.arrowMesh, arrows, 10);
    gl.enable(gl.BLEND);
    gl.depthMask(false); // the soft edge of one segment must not hide the next
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(line.handle);
    gl.uniformMatrix4fv(line.at("clip"), false, clip);
    gl.uniform2f(line.at("pixels"), this.canvas.width / 2, this.canvas.height / 2);
    const half = camera.flat ? camera.distance * Math.tan(FIELD / 2) : Math.tan(FIELD / 2);
    gl.uniform1f(line.at("perMetre"), this.canvas.height / 2 / half);
    this.instances(this.lineMesh, lines, 10);
    gl.depthMask(true);
    gl.bindVertexArray(null);
    this.placeTags(frame, clip);
    this.state = { arrows: arrows.length / 10, segments: lines.length / 10, frame };
  }

  instances(mesh, data, width) {
    if (!data.length) return;
    const { gl } = this;
    gl.bindVertexArray(mesh.vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(data), gl.DYNAMIC_DRAW);
    gl.drawArraysInstanced(mesh.mode, 0, mesh.count, data.length / width);
  }

  /** Arrows and line segments of a frame, ten numbers each. */
  collect(frame) {
    const arrows = [];
    const lines = [...this.grid()];
    for (const d of this.header.drawables) {
      if (d.group === "joints" || this.shown[d.group] === false) continue;
      const group = this.header.groups.find((g) => g.name === d.group);
      const color = (k) => rgb((group && group[this.theme.dark ? "dark" : "light"]) || this.readable(d.colors[k] || "#888888"));
      const place = d.link === undefined ? (x, y) => [x, y] : this.carried(this.header.links[d.link], frame);
      if (d.kind === "arrows") {
        const [origins, vectors] = [at(this.arrays[d.origins], d.count * 2, frame, this.header.frames), at(this.arrays[d.vectors], d.count * 2, frame, this.header.frames)];
        for (let k = 0; k < d.count; k++) {
          const [vx, vy] = [vectors[2 * k], vectors[2 * k + 1]];
          if (Number.isFinite(vx + origins[2 * k]) && Math.hypot(vx, vy) > 1e-4 * this.size)
            arrows.push(origins[2 * k], origins[2 * k + 1], d.z, vx, vy, 0, d.radii[k] || 0.005 * this.size, ...color(k));
        }
      } else if (d.kind === "strips") {
        const points = at(this.arrays[d.points], d.count * d.length * 2, frame, this.header.frames);
        for (let k = 0; k < d.count; k++)
          this.strip(lines, points.subarray(2 * k * d.length, 2 * (k + 1) * d.length), place, d.z, color(k), d.radii[k]);
      } else if (d.kind === "still strips") {
        let start = 0;
        d.lengths.forEach((length, k) => {
          this.strip(lines, this.arrays[d.points].subarray(2 * start, 2 * (start + length)), place, d.z, color(k), d.radii[k]);
          start += length;
        });
      } else if (d.kind === "points") {
        const points = d.moves ? at(this.arrays[d.points], d.count * 2, frame, this.header.frames) : this.arrays[d.points];
        for (let k = 0; k < d.count; k++)
          this.strip(lines, [points[2 * k], points[2 * k + 1], points[2 * k], points[2 * k + 1]], place, d.z, color(k), d.radii[k]);
      }
    }
    return { arrows, lines };
  }

  strip(lines, points, place, z, color, radius = 0.002 * this.size) {
    for (let k = 0; k + 3 < points.length; k += 2) {
      if (!Number.isFinite(points[k] + points[k + 1] + points[k + 2] + points[k + 3])) continue;
      const [a, b] = [place(points[k], points[k + 1]), place(points[k + 2], points[k + 3])];
      lines.push(a[0], a[1], z, b[0], b[1], z, ...color, radius);
    }
  }

  /** A function that transforms points of a link to the world. */
  carried(link, frame) {
    const [x, y, angle] = this.pose(link, frame);
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    return (u, v) => [x + c * u - s * v, y + s * u + c * v];
  }

  /** A colour, which was chosen for a dark background, for the present background: darker on a light one. */
  readable(color) {
    if (this.theme.dark) return color;
    if (Math.min(...rgb(color)) > 0.78) return "#22262e"; // white becomes black
    return "#" + rgb(color).map((v) => Math.round(255 * v * 0.62).toString(16).padStart(2, "0")).join("");
  }

  /** Lines of a grid with a round cell size: on the ground below the mechanism, or in front and back views behind everything. */
  grid() {
    const [low, high] = this.header.bounds;
    const lines = [];
    const section = 5 * this.cell;
    const [a, b, c] = this.camera.pans ? [0, 1, 2] : [0, 2, 1]; // axes along the grid, and across it
    const height = low[c] - (this.camera.pans ? 0.03 : 0.002) * this.size;
    const reach = [a, b].map((k) => [Math.floor((low[k] - 0.9 * this.size) / section) * section, Math.ceil((high[k] + 0.9 * this.size) / section) * section]);
    for (const k of [0, 1])
      for (let n = 0; n <= Math.round((reach[k][1] - reach[k][0]) / this.cell); n++) {
        const v = reach[k][0] + n * this.cell;
        for (const end of reach[1 - k]) {
          const place = [0, 0, 0];
          [place[a], place[b], place[c]] = k ? [end, v, height] : [v, end, height];
          lines.push(...place);
        }
        lines.push(...rgb(n % 5 ? this.theme.fine : this.theme.coarse), 0);
      }
    return lines;
  }

  placeTags(frame, clip) {
    const box = this.canvas.getBoundingClientRect();
    const taken = []; // boxes of names: a name that would overlap another is left out
    for (const { d, k, span } of this.tags) {
      const place = d.link === undefined ? (x, y) => [x, y] : this.carried(this.header.links[d.link], frame);
      const spot = d.kind === "points" && this.shown.names && this.shown[d.group] !== false ? this.spot(d, k, frame) : null;
      span.hidden = !spot;
      if (!spot) continue;
      const [x, y] = place(...spot);
      const w = clip[3] * x + clip[7] * y + clip[11] * d.z + clip[15];
      const px = (0.5 + (0.5 * (clip[0] * x + clip[4] * y + clip[8] * d.z + clip[12])) / w) * box.width;
      const py = (0.5 - (0.5 * (clip[1] * x + clip[5] * y + clip[9] * d.z + clip[13])) / w) * box.height;
      const width = 8 + 7.5 * span.textContent.length;
      span.hidden = taken.some(([x0, y0, w]) => Math.abs(py - y0) < 13 && px < x0 + w && x0 < px + width);
      if (!span.hidden) taken.push([px, py, width]);
      span.style.transform = `translate(${px.toFixed(1)}px, ${(py - 16).toFixed(1)}px)`;
    }
  }

  spot(d, k, frame) {
    const points = d.moves ? at(this.arrays[d.points], d.count * 2, frame, this.header.frames) : this.arrays[d.points];
    return Number.isFinite(points[2 * k]) ? [points[2 * k], points[2 * k + 1]] : null;
  }
}

/** Integer part and fraction of a frame, within the run. */
function split(frame, frames) {
  const k = Math.min(Math.max(Math.floor(frame), 0), frames - 1);
  return [k, Math.min(Math.max(frame - k, 0), 1)];
}

/** Values (`width` numbers per frame) interpolated between two frames; where one of them is absent, those of the nearer frame. */
function at(values, width, frame, frames) {
  const [k, t] = split(frame, frames);
  const now = values.subarray(width * k, width * (k + 1));
  if (t < 1e-6 || k + 1 >= frames) return now;
  const next = values.subarray(width * (k + 1), width * (k + 2));
  const out = new Float32Array(width);
  for (let i = 0; i < width; i++) {
    const v = now[i] * (1 - t) + next[i] * t;
    out[i] = Number.isFinite(v) ? v : t < 0.5 ? now[i] : next[i];
  }
  return out;
}

function rgb(hex) {
  const n = parseInt(hex.slice(1), 16);
  return [(n >> 16) / 255, ((n >> 8) & 255) / 255, (n & 255) / 255];
}

function program(gl, { vertex, fragment }) {
  const handle = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(handle, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
  }
  gl.linkProgram(handle);
  const known = {};
  return { handle, at: (name) => (known[name] === undefined ? (known[name] = gl.getUniformLocation(handle, name)) : known[name]) };
}

/** A mesh drawn as instances: an attribute of its vertices, and ten numbers per instance. */
function instanced(gl, { handle }, name, width, vertices, layout, mode) {
  const vao = gl.createVertexArray();
  gl.bindVertexArray(vao);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(vertices), gl.STATIC_DRAW);
  const own = gl.getAttribLocation(handle, name);
  gl.enableVertexAttribArray(own);
  gl.vertexAttribPointer(own, width, gl.FLOAT, false, 0, 0);
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  let offset = 0;
  for (const [attribute, size] of layout) {
    const place = gl.getAttribLocation(handle, attribute);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, gl.FLOAT, false, 40, offset);
    gl.vertexAttribDivisor(place, 1);
    offset += 4 * size;
  }
  gl.bindVertexArray(null);
  return { vao, buffer, mode, count: vertices.length / width };
}

function arrowMesh(gl, p) {
  const vertices = [];
  const ring = (n, k) => [Math.cos((2 * Math.PI * n) / RING), Math.sin((2 * Math.PI * n) / RING), k];
  for (let n = 0; n < RING; n++)
    for (const [a, b] of [[0, 1], [1.6, 2], [3, 4]]) // shaft, back of the head, head
      for (const [m, k] of [[n, a], [n + 1, a], [n + 1, b], [n, a], [n + 1, b], [n, b]]) vertices.push(...ring(m, k));
  return instanced(gl, p, "part", 3, vertices, [["origin", 3], ["reach", 4], ["tint", 3]], gl.TRIANGLES);
}

function lineMesh(gl, p) {
  return instanced(gl, p, "corner", 2, [0, -1, 1, -1, 0, 1, 1, 1], [["from", 3], ["to", 3], ["tint", 4]], gl.TRIANGLE_STRIP);
}
