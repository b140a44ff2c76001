/* Plots on canvases: axes with units, curves, events, and a cursor that can be dragged; plots of one quantity over another. */

const CURVES = {
  light: ["#2563c9", "#d97706", "#0f8a5f", "#c2255c", "#7c4dcc", "#8a6d00", "#0e7c86", "#b0468f", "#5b6675", "#8a5a2b", "#5f7d12", "#4453c4"],
  dark: ["#5cacff", "#ffaa40", "#60d684", "#ff6672", "#be8cff", "#f4de5c", "#4cdade", "#ff8ccc", "#b0bed0", "#c69a70", "#a4c850", "#8c96ff"],
};
const ROOM = { left: 58, right: 12, top: 8, bottom: 34 };
const ANGLES = [1, 2, 5, 10, 15, 30, 45, 90, 180, 360, 720, 1440, 3600];

/** Round values between two bounds, about `count` of them. */
function ticks(low, high, count, unit) {
  const wanted = (high - low) / Math.max(count, 1);
  if (!(wanted > 0)) return [low];
  const decade = 10 ** Math.floor(Math.log10(wanted));
  const step = (unit === "°" && ANGLES.find((s) => s >= wanted && s >= 5)) || decade * [1, 2, 5, 10].find((s) => s * decade >= wanted * 0.999);
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push(k * step);
  return out;
}

/** A number for reading: short, with a true minus. */
function words(value, digits = 5) {
  if (!Number.isFinite(value)) return "–";
  let text = Math.abs(value) >= 1e6 || (value !== 0 && Math.abs(value) < 1e-4) ? value.toExponential(digits - 2) : String(Number(value.toPrecision(digits)));
  return text.replace("e+", "e").replace(/-/g, "−");
}

class Plot {
  constructor(player, number) {
    this.player = player;
    this.figure = document.createElement("figure");
    this.figure.innerHTML = `<figcaption><select class="what" aria-label="What is plotted"></select>
      <button type="button" title="Remove this plot" aria-label="Remove this plot">×</button></figcaption><div class="values"></div><canvas role="img"></canvas>
      <div class="more"><select class="beside" aria-label="What is plotted beside it" title="Another curve of the same unit, or one to be taken away"></select>
      ${["SVG", "PNG", "CSV"].map((kind) => `<button type="button" title="Save this plot as ${kind}">${kind}</button>`).join("")}</div>`;
    [this.select, this.beside, this.canvas, this.readout] = [".what", ".beside", "canvas", ".values"].map((s) => this.figure.querySelector(s));
    player.header.plots.forEach((p, k) => this.select.add(new Option(`${p.title} [${p.unit}]`, k)));
    this.select.onchange = () => this.choose(Number(this.select.value));
    this.beside.onchange = () => this.join(Number(this.beside.value));
    this.figure.querySelector("button").onclick = () => player.removePlot(this);
    for (const button of this.figure.querySelectorAll(".more button")) button.onclick = () => this.save(button.textContent);
    drags(this.canvas, (x) => {
      if (!this.plot.x && this.scale) player.seekFrame(this.frameAt(this.scale.fromX(x)));
    });
    this.choose(number);
  }

  choose(number) {
    this.show([number]);
  }

  /** Adds another plot of the same unit to this one, or removes it. */
  join(number) {
    const rest = this.numbers.filter((n) => n !== number);
    this.show(rest.length < this.numbers.length ? rest : [...rest, number]);
  }

  show(numbers) {
    const { header, arrays } = this.player;
    this.numbers = numbers;
    this.number = numbers[0];
    this.select.value = String(this.number);
    const parts = numbers.map((n) => header.plots[n]);
    const [first] = parts;
    this.plot = first;
    this.values = arrays[first.values];
    this.half = arrays[first.half]; // half width of the tolerance band, undefined without one
    if (parts.length > 1) {
      const item = (p) => p.title.split(": ").slice(0, -1).join(": ") || p.title;
      const names = parts.flatMap((p) => p.names.map((name) => (p.names.length > 1 ? `${item(p)}: ${name}` : p.title)));
      this.plot = { title: parts.map((p) => p.title).join(", "), unit: first.unit, names };
      this.values = new Float32Array(header.frames * names.length);
      this.half = parts.some((p) => p.half !== undefined) ? new Float32Array(header.frames * names.length).fill(NaN) : undefined;
      let column = 0;
      for (const p of parts)
        for (let c = 0; c < p.names.length; c++, column++)
          for (let k = 0; k < header.frames; k++) {
            this.values[k * names.length + column] = arrays[p.values][k * p.names.length + c];
            if (p.half !== undefined) this.half[k * names.length + column] = arrays[p.half][k * p.names.length + c];
          }
    }
    this.beside.replaceChildren(new Option(parts.length > 1 ? `with ${parts.length - 1} more` : "with …", -1));
    header.plots.forEach((p, k) => {
      if (k !== this.number && p.unit === first.unit && p.x === undefined) this.beside.add(new Option(`${numbers.includes(k) ? "− " : "+ "}${p.title}`, k));
    });
    this.beside.hidden = first.x !== undefined || this.beside.length < 2;
    this.figure.classList.toggle("square", !!this.plot.equal);
    this.canvas.setAttribute("aria-label", `Plot of ${this.plot.title}, in ${this.plot.unit}`);
    this.draw();
  }

  /** Downloads the plot as a file. */
  save(kind) {
    const { plot, values } = this;
    const save = (type, data) => download(plot.title, kind.toLowerCase(), type, data);
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (kind === "CSV") {
      const axis = this.axis();
      const columns = (list) => plot.names.map((_, c) => Array.from({ length: this.player.header.frames }, (_, k) => list[k * plot.names.length + c]));
      const heads = (words) => plot.names.map((n) => `${n}${words} [${plot.unit}]`);
      const bands = this.half ? [heads(" tolerance ±"), columns(this.half)] : [[], []];
      save("text/csv", csv([`${axis.title} [${axis.unit}]`, ...heads(""), ...bands[0]], [axis.values, ...columns(values), ...bands[1]]));
    } else if (kind === "SVG") {
      const surface = new SvgSurface(width, height, this.player.theme.card);
      this.paint(surface, width, height);
      save("image/svg+xml", surface.text(plot.title));
    } else {
      const copy = Object.assign(document.createElement("canvas"), { width: this.canvas.width, height: this.canvas.height });
      const g = copy.getContext("2d");
      g.fillStyle = this.player.theme.card;
      g.fillRect(0, 0, copy.width, copy.height);
      g.drawImage(this.canvas, 0, 0);
      copy.toBlob((blob) => save("image/png", blob));
    }
  }

  /** The abscissa of the curves: values at the frames, title and unit. */
  axis() {
    if (this.plot.x !== undefined) {
      const [, title, unit] = /^(.*) \[(.*)\]$/.exec(this.plot.x_title) || [null, this.plot.x_title, ""];
      return { values: this.player.arrays[this.plot.x], title, unit };
    }
    return this.player.axis;
  }

  draw() {
    const { g, width, height } = fresh(this.canvas);
    if (!width) return;
    this.paint(g, width, height);
    this.background = g.getImageData(0, 0, this.canvas.width, this.canvas.height);
    this.move();
  }

  /** Draws axes, events and curves on a surface: a canvas, or an SvgSurface. */
  paint(g, width, height) {
    const { player, plot, values } = this;
    const theme = player.theme;
    const axis = this.axis();
    const count = plot.names.length;
    const cycle = axis.turn ? (v) => v - axis.turn * Math.floor(v / axis.turn + 1e-9) : (v) => v;
    const xs = axis.turn ? Float64Array.from(axis.values, cycle) : axis.values;
    let [x0, x1] = axis.turn ? [0, axis.turn] : span(xs);
    const half = player.band ? this.half : undefined;
    const edge = (i, side) => values[i] + side * player.band * half[i];
    let [y0, y1] = span(values);
    if (half)
      for (const side of [-1, 1]) {
        const [low, high] = span(half.map((_, i) => edge(i, side)));
        if (half.some(Number.isFinite)) [y0, y1] = [Math.min(y0, low), Math.max(y1, high)];
      }
    [y0, y1] = padded(y0, y1);
    if (plot.x !== undefined) [x0, x1] = padded(x0, x1);
    const inner = { w: width - ROOM.left - ROOM.right, h: height - ROOM.top - ROOM.bottom };
    if (plot.equal) {
      // the origin is in the picture, and both axes have the same scale
      [x0, x1, y0, y1] = [Math.min(x0, 0), Math.max(x1, 0), Math.min(y0, 0), Math.max(y1, 0)];
      const per = Math.max((x1 - x0) / inner.w, (y1 - y0) / inner.h);
      [x0, x1] = [(x0 + x1 - per * inner.w) / 2, (x0 + x1 + per * inner.w) / 2];
      [y0, y1] = [(y0 + y1 - per * inner.h) / 2, (y0 + y1 + per * inner.h) / 2];
    }
    if (x0 === x1) x1 = x0 + 1;
    const X = (v) => ROOM.left + ((v - x0) / (x1 - x0)) * inner.w;
    const Y = (v) => ROOM.top + inner.h - ((v - y0) / (y1 - y0)) * inner.h;
    this.scale = { X, Y, xs, cycle, fromX: (px) => x0 + ((px - ROOM.left) / inner.w) * (x1 - x0) };
    g.font = "11px system-ui, sans-serif";
    g.lineWidth = 1;
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (const v of ticks(y0, y1, inner.h / 22, plot.unit)) {
      rule(g, ROOM.left, Y(v), ROOM.left + inner.w, Y(v), v === 0 ? theme.soft : theme.line);
      g.fillStyle = theme.soft;
      g.fillText(words(v, 4), ROOM.left - 5, Y(v));
    }
    g.textAlign = "center";
    g.textBaseline = "top";
    for (const v of ticks(x0, x1, inner.w / 62, axis.unit)) {
      rule(g, X(v), ROOM.top, X(v), ROOM.top + inner.h, v === 0 && plot.x !== undefined ? theme.soft : theme.line);
      g.fillStyle = theme.soft;
      const half = g.measureText(words(v, 4)).width / 2;
      g.fillText(words(v, 4), Math.min(X(v), width - 1 - half), ROOM.top + inner.h + 4);
    }
    g.fillText(`${axis.title} [${axis.unit}]`, ROOM.left + inner.w / 2, height - 13);
    g.save();
    g.translate(10, ROOM.top + inner.h / 2);
    g.rotate(-Math.PI / 2);
    g.textBaseline = "middle";
    g.fillText(plot.x !== undefined ? `${plot.names[0]} [${plot.unit}]` : `[${plot.unit}]`, 0, 0);
    g.restore();
    g.save();
    g.beginPath();
    g.rect(ROOM.left - 1, ROOM.top - 1, inner.w + 2, inner.h + 2);
    g.clip();
    if (plot.x === undefined)
      for (const e of player.header.events) {
        g.setLineDash([2, 3]);
        const x = X(cycle(between(axis.values, player.frameAt(e.time))));
        rule(g, x, ROOM.top, x, ROOM.top + inner.h, e.level === "WARN" ? theme.warn : theme.soft);
      }
    g.setLineDash([]);
    if (half) {
      g.globalAlpha = 0.22;
      for (let c = 0; c < count; c++) {
        g.fillStyle = theme.curves[c % theme.curves.length];
        for (const strip of strips(axis, xs, (k) => Number.isFinite(half[k * count + c]))) {
          g.beginPath();
          for (const [x, k] of strip) g.lineTo(X(x), Y(edge(k * count + c, 1)));
          for (const [x, k] of strip.reverse()) g.lineTo(X(x), Y(edge(k * count + c, -1)));
          g.fill();
        }
      }
      g.globalAlpha = 1;
    }
    g.lineWidth = 1.8;
    g.lineJoin = "round";
    for (let c = 0; c < count; c++) {
      g.strokeStyle = theme.curves[c % theme.curves.length];
      g.beginPath();
      for (const strip of strips(axis, xs, (k) => Number.isFinite(values[k * count + c])))
        strip.forEach(([x, k], i) => (i ? g.lineTo(X(x), Y(values[k * count + c])) : g.moveTo(X(x), Y(values[k * count + c]))));
      g.stroke();
    }
    g.restore();
  }

  /** Moves the cursor to the present frame, and shows the values there. */
  move() {
    if (!this.background || !this.scale) return;
    const { player, plot, values } = this;
    const g = this.canvas.getContext("2d");
    g.putImageData(this.background, 0, 0);
    const count = plot.names.length;
    const now = (list, c = 0) => between(list, player.frame, count, c);
    const px = this.scale.X(this.scale.cycle(between(this.axis().values, player.frame)));
    const theme = player.theme;
    const height = this.canvas.clientHeight;
    if (plot.x === undefined) {
      g.lineWidth = 1.5;
      rule(g, px, ROOM.top - 4, px, height - ROOM.bottom, theme.cursor);
      this.cursorX = px;
    } else if (plot.equal) {
      g.lineWidth = 1.5;
      rule(g, this.scale.X(0), this.scale.Y(0), px, this.scale.Y(now(values)), theme.cursor);
    }
    const parts = plot.names.map((name, c) => {
      const v = now(values, c);
      dot(g, px, this.scale.Y(v), theme.curves[c % theme.curves.length], theme.card);
      return [name, v, theme.curves[c % theme.curves.length]];
    });
    while (this.readout.children.length < count) {
      const span = document.createElement("span");
      span.append(document.createElement("b"), " ", document.createTextNode(""));
      this.readout.append(span);
    }
    while (this.readout.children.length > count) this.readout.lastChild.remove();
    parts.forEach(([name, v, color], c) => {
      const span = this.readout.children[c];
      span.firstChild.style.setProperty("--c", color);
      span.firstChild.textContent = name;
      const off = this.half ? now(this.half, c) : NaN;
      const unit = { 1: "", "°": "°" }[plot.unit] ?? ` ${plot.unit}`;
      span.lastChild.data = `${words(v)}${Number.isFinite(off) ? ` ± ${words(off, 2)}` : ""}${unit}`;
    });
  }

  /** The frame at a value of the abscissa; with overlaid cycles, that in the present cycle. */
  frameAt(x) {
    const { xs } = this.scale;
    const axis = this.axis();
    if (!axis.turn) return inverse(xs, x);
    const turns = Math.floor(axis.values[Math.round(this.player.frame)] / axis.turn + 1e-9);
    return inverse(axis.values, x + turns * axis.turn);
  }
}

/** The value of a column at a frame, interpolated linearly for fractions. */
function between(list, frame, width = 1, column = 0) {
  const [k, t] = split(frame, list.length / width);
  const next = Math.min(k + 1, list.length / width - 1);
  return list[k * width + column] * (1 - t) + list[next * width + column] * t;
}

/** Runs of successive frames with known values, as pairs of abscissa and frame. With overlaid cycles, a run ends at one edge and the
    next begins at the other: the step across the edge is in both. */
function strips(axis, xs, known) {
  const all = [];
  let strip = [];
  const end = () => {
    if (strip.length) all.push(strip);
    strip = [];
  };
  for (let k = 0; k < xs.length; k++) {
    if (!known(k)) end();
    else {
      const step = strip.length ? axis.values[k] - axis.values[k - 1] : 0;
      if (axis.turn && strip.length && Math.abs(xs[k] - xs[k - 1] - step) > axis.turn / 2) {
        strip.push([xs[k - 1] + step, k]);
        end();
        strip.push([xs[k] - step, k - 1]);
      }
      strip.push([xs[k], k]);
    }
  }
  end();
  return all;
}

/** The frame, with fraction, at which monotonic values reach x. */
function inverse(xs, x) {
  const last = xs.length - 1;
  const rising = xs[last] >= xs[0];
  let [low, high] = [0, last];
  if (rising ? x <= xs[0] : x >= xs[0]) return 0;
  if (rising ? x >= xs[last] : x <= xs[last]) return last;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (rising ? xs[middle] <= x : xs[middle] >= x) low = middle;
    else high = middle;
  }
  return low + (xs[high] === xs[low] ? 0 : (x - xs[low]) / (xs[high] - xs[low]));
}

/** Clears a canvas and sets its size in device pixels; returns its context in CSS pixels, and its size in CSS pixels. */
function fresh(canvas) {
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  [canvas.width, canvas.height] = [Math.max(1, Math.round(width * scale)), Math.max(1, Math.round(height * scale))];
  const g = canvas.getContext("2d", { willReadFrequently: true });
  g.setTransform(scale, 0, 0, scale, 0, 0);
  g.clearRect(0, 0, width, height);
  return { g, width, height };
}

/** Calls `moved` with the horizontal position while a pressed pointer moves on a canvas. */
function drags(canvas, moved) {
  const tell = (e) => moved(e.clientX - canvas.getBoundingClientRect().left);
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    tell(e);
  });
  canvas.addEventListener("pointermove", (e) => {
    if (e.buttons || e.pressure > 0) tell(e);
  });
}

function span(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const v of values)
    if (Number.isFinite(v)) {
      if (v < low) low = v;
      if (v > high) high = v;
    }
  return low <= high ? [low, high] : [0, 1];
}

function padded(low, high) {
  let room = 0.06 * (high - low);
  if (room <= 1e-7 * Math.max(Math.abs(low), Math.abs(high))) room = 0.1 * Math.abs(low) || 1;
  return [low - room, high + room];
}

function rule(g, x0, y0, x1, y1, color) {
  g.strokeStyle = color;
  g.beginPath();
  g.moveTo(x0, y0);
  g.lineTo(x1, y1);
  g.stroke();
}

function dot(g, x, y, color, edge) {
  if (!Number.isFinite(x + y)) return;
  g.fillStyle = color;
  g.strokeStyle = edge;
  g.lineWidth = 1.5;
  g.beginPath();
  g.arc(x, y, 4, 0, 2 * Math.PI);
  g.fill();
  g.stroke();
}

function arrow(g, x0, y0, x1, y1, color) {
  const length = Math.hypot(x1 - x0, y1 - y0);
  if (!(length > 0.5)) return;
  const [ux, uy] = [(x1 - x0) / length, (y1 - y0) / length];
  const head = Math.min(10, 0.5 * length);
  rule(g, x0, y0, x1 - 0.8 * head * ux, y1 - 0.8 * head * uy, color);
  g.fillStyle = color;
  g.beginPath();
  g.moveTo(x1, y1);
  g.lineTo(x1 - head * ux - 0.4 * head * uy, y1 - head * uy + 0.4 * head * ux);
  g.lineTo(x1 - head * ux + 0.4 * head * uy, y1 - head * uy - 0.4 * head * ux);
  g.fill();
}
