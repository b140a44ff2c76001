// Plays a motion in the page: see playback.py. Loaded once into a page; `load` takes a motion, `play` starts it, `stop` ends it.
if (!window.mechvizPlayback) {
  const unpack = (text, Type) => {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return new Type(bytes.buffer);
  };
  const player = { motion: null, running: false, frames: 0, frame: -1, watching: "" };
  const PANELS = 80; // [ms] between updates of plots and numbers

  player.load = (data) => {
    const time = unpack(data.time, Float64Array), count = time.length;
    player.motion = {
      time, count, slider: data.slider, seen: data.seen,
      poses: data.poses.map(([name, p, q]) => ({ name, p: unpack(p, Float32Array), q: q && unpack(q, Float32Array) })),
      points: data.points.map(([name, prop, v, n, s]) => {
        const values = unpack(v, Float32Array), steady = s && unpack(s, Uint8Array);
        return { name, prop, values, width: values.length / count, counts: unpack(n, Float32Array), steady, seen: null };
      }),
      numbers: data.numbers.map(([key, v, digits, suffix]) => ({ key, values: unpack(v, Float32Array), digits, suffix })),
      plots: data.plots.map(([uuid, sx, sy, x, y, ends]) => ({ uuid, ends, sx: unpack(sx, Float32Array),
        sy: unpack(sy, Float32Array), x: unpack(x, Float32Array), y: unpack(y, Float32Array) })),
    };
    player.frame = -1;
  };

  // -- one frame ----------------------------------------------------------------------------------------------------
  // `part`: fraction between frame k and the next, so that slow motion is smooth. Jumps between two frames are not interpolated.
  const FAR = 4; // a jump is longer than this times the sum of the steps before and after it
  const step = (p, k) => Math.hypot(p[3 * k + 3] - p[3 * k], p[3 * k + 4] - p[3 * k + 1], p[3 * k + 5] - p[3 * k + 2]);
  const leaps = (p, k, last) => step(p, k) > 1e-12 + FAR * ((k > 0 ? step(p, k - 1) : 0) + (k < last - 1 ? step(p, k + 1) : 0));
  const between = (values, width, k, part, count = width) => {
    const at = width * k, out = values.slice(at, at + count);
    if (part) for (let i = 0; i < count; i++) out[i] += part * (values[at + width + i] - out[i]);
    return out;
  };
  const turned = (q, k, part) => {
    const a = q.subarray(4 * k, 4 * k + 4), b = part ? q.subarray(4 * k + 4, 4 * k + 8) : a;
    const dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
    const to = Math.abs(dot) > 0.5 ? part : 0; // a rotation by more than 120° between two frames is not interpolated
    const w = [0, 1, 2, 3].map((i) => (1 - to) * a[i] + to * (dot < 0 ? -b[i] : b[i])), size = Math.hypot(...w) || 1;
    return w.map((value) => value / size);
  };
  const poses = (viser, motion, k, part = 0) => {
    for (const { name, p, q } of motion.poses) {
      const pose = viser.nodePoseData[name];
      if (!pose) continue;
      const own = part && !leaps(p, k, motion.count - 1) ? part : 0;
      pose.position = Array.from(between(p, 3, k, own));
      if (q) pose.wxyz = turned(q, k, own);
      if (pose.poseUpdateState !== "waitForMakeObject") pose.poseUpdateState = "needsUpdate";
    }
  };
  const scene = (viser, motion, k, part) => {
    poses(viser, motion, k, part);
    for (const track of motion.points) {
      const count = track.counts[k], seen = count > 0;
      if (seen) {
        const smooth = part && count === track.counts[k + 1] && (!track.steady || track.steady[k]);
        const found = between(track.values, track.width, k, smooth ? part : 0, count);
        const values = track.prop === "scale" ? Array.from(found) : found; // a tuple
        viser.messageQueue.push({ type: "SceneNodeUpdateMessage", name: track.name, updates: { [track.prop]: values } });
      }
      if (seen !== track.seen) {
        track.seen = seen;
        viser.messageQueue.push({ type: "SetSceneNodeVisibilityMessage", name: track.name, visible: seen });
      }
    }
    viser.requestRender();
  };
  const text = (value, digits) => {
    if (!Number.isFinite(value)) return "not finite";
    const said = digits === null ? String(Number(value.toPrecision(5))) : value.toFixed(digits);
    return said.replace("-", "−");
  };
  // The server draws a diagram only if it is visible in a page
  const watch = (viser, motion) => {
    const diagram = document.querySelector(".mechviz-diagram");
    const watching = diagram && diagram.getClientRects().length ? motion.seen : "";
    if (watching === player.watching) return;
    player.watching = watching;
    viser.sendMessage({ type: "GuiUpdateMessage", uuid: motion.seen, updates: { value: watching !== "" } });
  };
  const panels = (viser, motion, k) => {
    if (motion.seen) watch(viser, motion);
    viser.messageQueue.push({ type: "GuiUpdateMessage", uuid: motion.slider, updates: { value: k } });
    const found = {};
    for (const element of document.querySelectorAll("[data-mv]")) (found[element.dataset.mv] ||= []).push(element);
    for (const { key, values, digits, suffix } of motion.numbers)
      for (const element of found[key] || []) element.textContent = text(values[k], digits) + suffix;
    for (const line of document.querySelectorAll(".mechviz-now")) {
      const part = (motion.time[k] - motion.time[0]) / Math.max(motion.time[motion.count - 1] - motion.time[0], 1e-300);
      line.setAttribute("x1", 1000 * part);
      line.setAttribute("x2", 1000 * part);
    }
    const charts = (window.__viserTestpoints || {}).uplots || {};
    for (const plot of motion.plots) {
      const chart = charts[plot.uuid] && charts[plot.uuid].chart;
      if (!chart) continue;
      const n = plot.sx.length, curves = plot.sy.length / n, now = plot.x[k];
      let at = 0;
      while (at < n && plot.sx[at] < now) at++;
      const insert = (values, a, b) => {
        const out = new Float64Array(n + 2);
        out.set(values.subarray(0, at)); out[at] = a; out[at + 1] = b; out.set(values.subarray(at), at + 2);
        return out;
      };
      const data = [insert(plot.sx, now, now)];
      for (let c = 0; c < curves; c++) {
        const value = plot.y[c * motion.count + k];
        data.push(insert(plot.sy.subarray(c * n, (c + 1) * n), value, value));
      }
      const cursor = new Float64Array(n + 2).fill(NaN);
      cursor[at] = plot.ends[0]; cursor[at + 1] = plot.ends[1];
      data.push(cursor);
      chart.setData(data, false);
      chart.redraw(false);
    }
  };
  const place = (time, clock) => {
    let low = 0, high = time.length - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (time[middle] <= clock) low = middle; else high = middle; }
    return [low, time[high] > time[low] ? Math.min(Math.max((clock - time[low]) / (time[high] - time[low]), 0), 1) : 0];
  };
  // Show frame k; with `part`, the picture at this fraction between `from` and the next frame, and the numbers of the nearer frame
  // k
  player.show = (k, withPanels, from = k, part = 0) => {
    const viser = window.__viserMutable, motion = player.motion;
    if (!viser || !viser.messageQueue || !motion) return;
    scene(viser, motion, from, part);
    if (withPanels) panels(viser, motion, k);
    player.frame = k;
    player.frames += 1;
  };

  // -- the clock ----------------------------------------------------------------------------------------------------
  let clock = 0, rate = 1, loop = true, ticked = 0, panelled = 0;
  const tick = (now) => {
    if (!player.running) return;
    const { time, count } = player.motion, first = time[0], last = time[count - 1];
    clock += rate * (now - ticked) / 1000;
    ticked = now;
    if (clock >= last && !(loop && last > first)) { clock = last; player.running = false; }
    else clock = first + ((clock - first) % (last - first));
    const [low, part] = place(time, clock), k = part < 0.5 ? low : Math.min(low + 1, count - 1);
    const due = k !== player.frame && now - panelled > PANELS;
    if (due) panelled = now;
    if (part === 0 || part === 1) player.show(k, due);
    else player.show(k, due, low, part);
    if (player.running) requestAnimationFrame(tick);
  };
  player.play = (from, speed, again) => {
    clock = from; rate = speed; loop = again; ticked = performance.now();
    for (const track of player.motion.points) track.seen = null;
    if (!player.running) { player.running = true; requestAnimationFrame(tick); }
  };
  // Messages that the server sends after this may already wait in the queue before those pushed here. So only poses are set, at
  // once, and the visibility of nodes where it differs from what the server assumes for frame k.
  player.stop = (k) => {
    player.running = false;
    const viser = window.__viserMutable, motion = player.motion;
    if (!motion || k >= motion.count) return;
    poses(viser, motion, k);
    for (const track of motion.points) {
      const seen = track.counts[k] > 0;
      if (track.seen !== null && seen !== track.seen)
        viser.messageQueue.push({ type: "SetSceneNodeVisibilityMessage", name: track.name, visible: seen });
    }
    viser.requestRender();
  };
  window.mechvizPlayback = player;
}
