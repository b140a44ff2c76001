/* Drawings beside the plots: states over time as bars, and graphical constructions that move with time. */

/** States over time as bars. */
class Lanes {
  constructor(player, box) {
    this.player = player;
    if (!player.header.lanes.length) return;
    box.innerHTML = '<h2>States</h2><canvas role="img" aria-label="States over time"></canvas>';
    this.canvas = box.querySelector("canvas");
    this.canvas.style.height = `${24 * player.header.lanes.length + 6}px`;
    drags(this.canvas, (x) => player.seek(player.start + ((x - ROOM.left) / (this.canvas.clientWidth - ROOM.left - ROOM.right)) * (player.end - player.start)));
  }

  draw() {
    if (!this.canvas) return;
    const { player } = this;
    const { g, width, height } = fresh(this.canvas);
    const inner = width - ROOM.left - ROOM.right;
    const X = (t) => ROOM.left + ((t - player.start) / (player.end - player.start || 1)) * inner;
    g.font = "11px system-ui, sans-serif";
    g.textBaseline = "middle";
    player.header.lanes.forEach((lane, n) => {
      const y = 4 + 24 * n;
      g.textAlign = "right";
      g.fillStyle = player.theme.soft;
      g.fillText(lane.name, ROOM.left - 5, y + 9, ROOM.left - 8);
      g.textAlign = "left";
      lane.changes.forEach(([t, state, color], k) => {
        const end = k + 1 < lane.changes.length ? lane.changes[k + 1][0] : player.end;
        g.fillStyle = color;
        g.fillRect(X(t), y, Math.max(X(end) - X(t), 1), 18);
        g.fillStyle = "#000";
        if (g.measureText(state).width < X(end) - X(t) - 6) g.fillText(state, X(t) + 4, y + 9);
      });
    });
    rule(g, X(player.time), 0, X(player.time), height, player.theme.cursor);
  }
}

/** Draws a label with its subscript, such as CB in "a_CBⁿ", and an outline in the background colour. */
function written(g, text, x, y, ground) {
  const [, letter, below, above] = /^([A-Za-z])_(.+?)([ⁿᵗᶜʳ]?)$/.exec(text) || ["", text, "", ""];
  const { font, lineWidth, strokeStyle } = g;
  for (const [words, down, size] of [[letter, 0, "11px"], [below, 3, "8.5px"], [above, 0, "11px"]]) {
    g.font = font.replace(/[\d.]+px/, size);
    Object.assign(g, { lineWidth: 3, lineJoin: "round", strokeStyle: ground });
    g.strokeText(words, x, y + down);
    g.fillText(words, x, y + down);
    x += g.measureText(words).width;
  }
  Object.assign(g, { font, lineWidth, strokeStyle });
}

/** A graphical construction that moves with time: arrows with labels, lines and points, drawn to scale. */
class Construction {
  constructor(player, { title, caption, parts }, box) {
    this.player = player;
    this.parts = parts;
    this.figure = document.createElement("figure");
    this.figure.className = "square";
    this.figure.innerHTML = "<figcaption><b></b></figcaption><canvas role='img'></canvas>";
    this.figure.querySelector("b").textContent = caption;
    this.canvas = this.figure.querySelector("canvas");
    this.canvas.setAttribute("aria-label", title);
    box.append(this.figure);
    let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
    const see = (x, y) => {
      if (Number.isFinite(x + y)) [x0, x1, y0, y1] = [Math.min(x0, x), Math.max(x1, x), Math.min(y0, y), Math.max(y1, y)];
    };
    for (const d of this.parts) {
      const a = player.arrays[d.kind === "arrows" ? d.origins : d.points];
      const v = d.kind === "arrows" ? player.arrays[d.vectors] : null;
      for (let k = 0; k + 1 < a.length; k += 2) {
        see(a[k], a[k + 1]);
        if (v) see(a[k] + v[k], a[k + 1] + v[k + 1]);
      }
    }
    this.box = [x0, x1, y0, y1];
  }

  draw() {
    const { player } = this;
    const { g, width, height } = fresh(this.canvas);
    if (!width) return;
    const [x0, x1, y0, y1] = this.box;
    const per = Math.max((x1 - x0) / (width - 60), (y1 - y0) / (height - 40)) || 1;
    const X = (x) => width / 2 + (x - (x0 + x1) / 2) / per;
    const Y = (y) => height / 2 - (y - (y0 + y1) / 2) / per;
    g.font = "600 11px system-ui, sans-serif";
    g.textBaseline = "middle";
    const said = [];
    const say = (text, x, y, color) => {
      if (!text || said.some(([a, b]) => Math.hypot(a - x, b - y) < 11)) return;
      said.push([x, y]);
      g.fillStyle = color;
      written(g, text, x + 5, y - 6, player.theme.card);
    };
    const color = (d, k) => player.stage ? player.stage.readable(d.colors[k] || "#888888") : player.theme.ink;
    for (const d of this.parts) {
      const moving = (name, n) => at(player.arrays[name], n, player.frame, player.header.frames);
      g.lineWidth = 2;
      if (d.kind === "arrows") {
        const [o, v] = [moving(d.origins, 2 * d.count), moving(d.vectors, 2 * d.count)];
        for (let k = 0; k < d.count; k++) arrow(g, X(o[2 * k]), Y(o[2 * k + 1]), X(o[2 * k] + v[2 * k]), Y(o[2 * k + 1] + v[2 * k + 1]), color(d, k));
        for (let k = 0; k < d.count; k++) say(d.labels[k], X(o[2 * k] + v[2 * k] / 2), Y(o[2 * k + 1] + v[2 * k + 1] / 2), color(d, k));
      } else if (d.kind === "points") {
        const p = d.moves ? moving(d.points, 2 * d.count) : player.arrays[d.points];
        for (let k = 0; k < d.count; k++) {
          dot(g, X(p[2 * k]), Y(p[2 * k + 1]), player.theme.ink, player.theme.card);
          say(d.labels[k], X(p[2 * k]), Y(p[2 * k + 1]), player.theme.ink);
        }
      } else {
        g.lineWidth = 1.2;
        const still = d.kind === "still strips";
        const p = still ? player.arrays[d.points] : moving(d.points, 2 * d.count * d.length);
        let start = 0;
        for (let k = 0; k < (still ? d.lengths.length : d.count); k++) {
          const length = still ? d.lengths[k] : d.length;
          g.strokeStyle = color(d, k);
          g.beginPath();
          for (let i = start; i < start + length; i++) g.lineTo(X(p[2 * i]), Y(p[2 * i + 1]));
          g.stroke();
          start += length;
        }
      }
    }
  }
}
