/* Connects picture, plots, events and notes to one timeline, and handles mouse, touch and keyboard. */

const $ = (id) => document.getElementById(id);
const DARK = window.matchMedia("(prefers-color-scheme: dark)");

function theme() {
  const style = getComputedStyle(document.documentElement);
  const color = (name) => style.getPropertyValue(`--${name}`).trim();
  const names = ["ink", "soft", "line", "card", "cursor", "warn"];
  const dark = DARK.matches;
  return { dark, curves: CURVES[dark ? "dark" : "light"], fine: dark ? "#262d38" : "#e3e7ec", coarse: dark ? "#323b48" : "#d3d9e0", ...Object.fromEntries(names.map((n) => [n, color(n)])) };
}

class Player {
  constructor({ header, arrays }) {
    [this.header, this.arrays] = [header, arrays];
    this.times = Float64Array.from(arrays[header.time]);
    [this.start, this.end] = [this.times[0], this.times[this.times.length - 1]];
    this.time = this.times[header.opening];
    this.frame = header.opening;
    this.playing = false;
    this.theme = theme();
    this.axes = [...header.axes.map((a) => ({ ...a, values: arrays[a.values] })), { title: "time", unit: "s", decimals: header.time_decimals, values: this.times }];
    this.axis = this.axes[0];
    this.plots = [];
    $("learning-goal").textContent = header.learning_goal;
    try {
      this.stage = new Stage($("picture"), $("labels"), header, arrays, this.theme);
    } catch (error) {
      trouble(error.message);
    }
    this.buildGroups();
    this.buildSide();
    this.buildTimeline();
    this.listen();
    this.seek(this.time);
  }

  // -- content of the page ---------------------------------------------------------------------------------------------
  buildGroups() {
    for (const group of this.header.groups) {
      const button = document.createElement("button");
      button.type = "button";
      button.dataset.group = group.name;
      button.title = group.meaning ? `${group.meaning}${group.value ? `; scale: ${group.value} = ${this.length(group.length, 3)}` : ""}` : group.label;
      button.setAttribute("aria-pressed", String(group.shown));
      if (group.light) {
        const swatch = document.createElement("i");
        swatch.style.background = swatch.style.color = group[this.theme.dark ? "dark" : "light"];
        button.append(swatch);
      }
      button.append(group.label);
      button.onclick = () => this.show(group.name, button.getAttribute("aria-pressed") !== "true");
      $("groups").append(button);
    }
    this.noteScales();
  }

  /** A length [m] in the display unit. */
  length(value, digits) {
    return `${words(value * this.header.length.per_metre, digits)} ${this.header.length.unit}`;
  }

  /** Shows the cell of the grid, and the scales of arrows, equal ones once. */
  noteScales() {
    if (!this.stage) return;
    const scales = this.header.groups.filter((g) => g.value && this.stage.shown[g.name]).map((g) => `${g.value} = ${this.length(g.length, 3)}`);
    $("grid-note").textContent = [`Grid ${this.length(this.stage.cell)}`, ...new Set(scales)].join("  ·  ");
  }

  buildSide() {
    this.axes.forEach((a, k) => $("axis").add(new Option(`${a.title} [${a.unit}]`, k)));
    this.band = 1; // factor of the width of tolerance bands
    $("band-choice").hidden = !this.header.plots.some((p) => p.half !== undefined);
    $("band").onchange = () => {
      this.band = Number($("band").value);
      for (const plot of this.plots) plot.draw();
    };
    $("axis").onchange = () => {
      this.axis = this.axes[Number($("axis").value)];
      this.drawPlots();
    };
    this.header.first.forEach((n) => this.addPlot(n));
    $("more").hidden = !this.header.plots.length;
    $("more").onclick = () => this.addPlot(this.header.plots.findIndex((_, k) => !this.plots.some((p) => p.number === k)));
    this.lanes = new Lanes(this, $("lanes"));
    this.constructions = this.header.constructions.map((drawing) => new Construction(this, drawing, $("constructions")));
    document.querySelector("[data-panel=constructions]").hidden = !this.constructions.length;
    this.header.events.forEach((event) => {
      const item = document.createElement("li");
      const button = document.createElement("button");
      button.type = "button";
      const when = document.createElement("time");
      when.textContent = `${words(event.time, 4)} s`;
      const what = document.createElement("span");
      what.textContent = event.text;
      what.className = event.level === "WARN" ? "warn" : "";
      button.append(when, what);
      button.onclick = () => this.seek(event.time);
      item.append(button);
      $("events").append(item);
    });
    document.querySelector("#tab-events").textContent = `Events (${this.header.events.length})`;
    if (!this.header.events.length) $("events").textContent = "Nothing in particular happens in this run.";
    $("notes").innerHTML = this.header.notes; // escaped when the page was written
    for (const box of document.querySelectorAll("#notes .wide")) box.tabIndex = 0; // scrollable boxes can get the keyboard focus
    if (this.header.total > this.header.frames) {
      const note = document.createElement("p");
      note.id = "thinned";
      note.textContent = `This page holds ${this.header.frames} of the run's ${this.header.total} frames.`;
      $("notes").prepend(note);
    }
    for (const tab of document.querySelectorAll("[role=tab]")) {
      tab.onclick = () => this.openPanel(tab.dataset.panel);
      tab.onkeydown = (e) => this.moveAlongTabs(e, tab);
    }
  }

  /** Moves from tab to tab by arrow keys while a tab has the focus. */
  moveAlongTabs(event, tab) {
    const tabs = [...document.querySelectorAll("[role=tab]:not([hidden])")];
    const here = tabs.indexOf(tab);
    const to = { ArrowLeft: here - 1, ArrowRight: here + 1, Home: 0, End: tabs.length - 1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    event.stopPropagation(); // no step in time
    const next = tabs[(to + tabs.length) % tabs.length];
    this.openPanel(next.dataset.panel);
    next.focus();
  }

  openPanel(name) {
    for (const tab of document.querySelectorAll("[role=tab]")) {
      tab.setAttribute("aria-selected", String(tab.dataset.panel === name));
      tab.tabIndex = tab.dataset.panel === name ? 0 : -1;
      $(tab.dataset.panel).hidden = tab.dataset.panel !== name;
    }
    this.drawPlots();
  }

  buildTimeline() {
    [$("slider").min, $("slider").max] = [this.start, this.end];
    $("slider").oninput = () => this.seek(Number($("slider").value));
    for (const event of this.header.events) {
      const mark = document.createElement("i");
      mark.className = event.level === "WARN" ? "warn" : "";
      mark.style.left = `${(100 * (event.time - this.start)) / (this.end - this.start || 1)}%`;
      $("ticks").append(mark);
    }
    $("play").onclick = () => this.play(!this.playing);
    $("back").onclick = () => this.step(-1);
    $("forth").onclick = () => this.step(1);
  }

  addPlot(number) {
    if (number < 0 || !this.header.plots[number]) return;
    const plot = new Plot(this, number);
    this.plots.push(plot);
    $("plot-list").append(plot.figure);
    plot.draw();
  }

  removePlot(plot) {
    this.plots = this.plots.filter((p) => p !== plot);
    plot.figure.remove();
  }

  // -- time ------------------------------------------------------------------------------------------------------------
  frameAt(time) {
    return inverse(this.times, time);
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.start), this.end);
    this.frame = this.frameAt(this.time);
    this.refresh();
  }

  seekFrame(frame) {
    const [k, t] = split(frame, this.header.frames);
    const next = Math.min(k + 1, this.header.frames - 1);
    this.seek(this.times[k] * (1 - t) + this.times[next] * t);
  }

  step(frames) {
    this.play(false);
    const last = this.header.frames - 1;
    this.seekFrame(Math.min(Math.max(Math.round(this.frame) + frames, 0), last));
  }

  play(on) {
    if (on && this.time >= this.end) this.seek(this.start);
    this.playing = on;
    $("play").textContent = on ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", on ? "Pause" : "Play");
    if (!on) return;
    let before = null;
    const tick = (now) => {
      if (!this.playing) return;
      const passed = before === null ? 0 : Math.min((now - before) / 1000, 0.25);
      before = now;
      const next = this.time + passed * this.header.pace * Number($("speed").value);
      if (next < this.end) this.seek(next);
      else if ($("loop").checked) this.seek(this.start + ((next - this.end) % (this.end - this.start || 1)));
      else {
        this.seek(this.end);
        this.play(false);
        return;
      }
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  // -- drawing ---------------------------------------------------------------------------------------------------------
  refresh() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.drawNow();
    });
  }

  drawNow() {
    if (this.stage) this.stage.draw(this.frame);
    if (!$("plots").hidden) {
      for (const plot of this.plots) plot.move();
      this.lanes.draw();
    }
    if (!$("constructions").hidden) for (const c of this.constructions) c.draw();
    $("slider").value = this.time;
    const parts = this.axes.filter((a) => !a.turn).map((a) => {
      const text = between(a.values, this.frame).toFixed(a.decimals).replace("-", "−");
      return a.unit === "s" ? `t = ${text} s` : `${text}${a.unit === "°" ? "" : " "}${a.unit}`;
    });
    $("readout").textContent = parts.join("  ·  ");
    $("slider").setAttribute("aria-valuetext", parts.join(", "));
    let current = -1;
    this.header.events.forEach((e, k) => {
      if (e.time <= this.time + 1e-9 * (this.end - this.start)) current = k;
    });
    $("events").querySelectorAll("button").forEach((b, k) => b.setAttribute("aria-current", String(k === current)));
  }

  drawPlots() {
    if (!$("plots").hidden) for (const plot of this.plots) plot.draw();
    this.refresh();
  }

  show(group, on) {
    const button = document.querySelector(`#groups button[data-group="${group}"]`);
    if (!button) return;
    button.setAttribute("aria-pressed", String(on));
    if (this.stage) {
      this.stage.shown[group] = on;
      this.noteScales();
    }
    this.refresh();
  }

  camera(move) {
    if (!this.stage) return;
    move(this.stage.camera);
    this.refresh();
  }

  view(name) {
    if (!this.stage) return;
    if (name === "fit") this.stage.camera.fit();
    else if (VIEWS[name]) this.stage.camera.look(name);
    this.refresh();
  }

  // -- mouse, touch, keyboard ------------------------------------------------------------------------------------------
  listen() {
    for (const button of document.querySelectorAll("#views button")) button.onclick = () => this.view(button.dataset.view);
    if (this.stage) this.listenToPicture($("picture"));
    document.addEventListener("keydown", (e) => {
      if (e.ctrlKey || e.metaKey || e.altKey || /^(SELECT|TEXTAREA)$/.test(e.target.tagName)) return;
      if (e.target.tagName === "INPUT" && e.target.type !== "range") return;
      const keys = {
        " ": () => this.play(!this.playing),
        ArrowLeft: () => this.step(e.shiftKey ? -10 : -1),
        ArrowRight: () => this.step(e.shiftKey ? 10 : 1),
        Home: () => this.seek(this.start),
        End: () => this.seek(this.end),
        0: () => this.view("fit"),
        2: () => this.view("front"),
        3: () => this.view("3d"),
        1: () => this.view("iso"),
        4: () => this.view("top"),
        5: () => this.view("right"),
        "+": () => this.camera((c) => c.zoom(1.2)),
        "-": () => this.camera((c) => c.zoom(1 / 1.2)),
        w: () => this.camera((c) => c.turn(0, 0.1)),
        s: () => this.camera((c) => c.turn(0, -0.1)),
        a: () => this.camera((c) => c.turn(0.1, 0)),
        d: () => this.camera((c) => c.turn(-0.1, 0)),
      };
      if (e.key === " " && e.target.tagName === "BUTTON") return; // presses the button
      if (keys[e.key]) {
        e.preventDefault();
        keys[e.key]();
      }
    });
    DARK.addEventListener("change", () => {
      this.theme = theme();
      if (this.stage) this.stage.theme = this.theme;
      for (const g of this.header.groups) {
        const swatch = document.querySelector(`#groups button[data-group="${g.name}"] i`);
        if (swatch) swatch.style.background = swatch.style.color = g[this.theme.dark ? "dark" : "light"];
      }
      this.drawPlots();
    });
    new ResizeObserver(() => {
      if (this.stage) this.stage.resize();
      this.drawPlots();
    }).observe(document.querySelector("main"));
  }

  listenToPicture(canvas) {
    const fingers = new Map();
    const { camera } = this.stage;
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      fingers.set(e.pointerId, [e.clientX, e.clientY]);
    });
    const gone = (e) => fingers.delete(e.pointerId);
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(name, gone);
    canvas.addEventListener("pointermove", (e) => {
      const before = fingers.get(e.pointerId);
      if (!before) return;
      const height = canvas.clientHeight;
      const [dx, dy] = [(e.clientX - before[0]) / height, (e.clientY - before[1]) / height];
      const others = [...fingers].filter(([id]) => id !== e.pointerId).map(([, place]) => place);
      fingers.set(e.pointerId, [e.clientX, e.clientY]);
      if (others.length) {
        const apart = (p) => Math.hypot(p[0] - others[0][0], p[1] - others[0][1]) || 1;
        camera.zoom(apart([e.clientX, e.clientY]) / apart(before));
        camera.pan(dx / 2, dy / 2);
      } else if (camera.pans || e.buttons & 6 || e.shiftKey) camera.pan(dx, dy);
      else camera.turn(3 * dx, 3 * dy);
      this.refresh();
    });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("dblclick", () => this.view("fit"));
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      camera.zoom(Math.exp(-0.0012 * e.deltaY * (e.deltaMode === 1 ? 20 : 1)));
      this.refresh();
    }, { passive: false });
  }
}

function trouble(text) {
  $("trouble").textContent = text;
  $("trouble").hidden = false;
}

async function open() {
  if (typeof DecompressionStream === "undefined")
    throw new Error("This browser is too old for this page: it cannot unpack its data (DecompressionStream).");
  globalThis.mechviz.player = new Player(await unpack($("data").textContent));
  globalThis.mechviz.player.drawNow();
}

/** For programs that take screenshots: await `mechviz.ready`, then use `mechviz.player`. */
globalThis.mechviz = {};
globalThis.mechviz.ready = open();
globalThis.mechviz.ready.catch((error) => trouble(error.message));
