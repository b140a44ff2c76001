// Names and values at the pointer, and values beside arrows: see marks.py. viser sends no events for a hovering pointer. So the
// page intersects a ray from the camera through the pointer with the named nodes. If viser's page does not expose its scene,
// nothing is shown.
if (!window.mechvizHover) {
  const hover = { names: {}, told: {}, found: null };
  const AGAIN = 150; // [ms] between checks while the pointer rests: moving parts may pass below it
  const box = document.createElement("div");
  box.id = "mechviz-hover";
  box.setAttribute("role", "tooltip");
  box.style.cssText =
    "position:fixed;z-index:1000;pointer-events:none;display:none;max-width:22em;padding:0.25em 0.6em;border-radius:0.35em;" +
    "font:13px/1.35 system-ui,sans-serif;background:rgba(24,30,40,0.92);color:#fff;box-shadow:0 1px 6px rgba(0,0,0,0.35)";
  const title = document.createElement("div"), words = document.createElement("div");
  title.style.fontWeight = "600";
  words.style.opacity = "0.8";
  box.append(title, words);
  document.body.append(box);

  let pointer = null, waiting = false, timer = 0;
  const hide = () => { box.style.display = "none"; hover.found = null; };
  const visible = (node) => { for (; node; node = node.parent) if (!node.visible) return false; return true; };

  // -- values of arrows over the frames, and their ends -----------------------------------------------------------------
  const unpacked = (text) => new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  hover.tell = (told) => {
    for (const name in told) for (const what of ["values", "starts", "tips"]) told[name][what] = unpacked(told[name][what]);
    hover.told = told;
  };
  const frame = () => Number(document.querySelector('[data-mv="frame"]')?.textContent ?? NaN);
  const value = (told, k, item, digits = 5) => {
    const number = told.values[k * told.count + item], size = Math.abs(number) <= told.nothing ? 0 : number;
    if (!Number.isFinite(size)) return "";
    return `${String(Number(size.toPrecision(digits))).replace("-", "−")} ${told.unit}`;
  };
  const place = (told, what, k, item) => told[what].subarray(3 * (k * told.count + item), 3 * (k * told.count + item) + 3);
  // The indices of the arrows that are drawn
  const seen = (told, k) => [...Array(told.count).keys()].filter((item) => Number.isFinite(place(told, "tips", k, item)[0]));

  const layer = document.createElement("div");
  layer.id = "mechviz-values";
  layer.setAttribute("aria-hidden", "true");
  layer.style.cssText = "position:fixed;inset:0;z-index:1;pointer-events:none;overflow:hidden;display:none";
  document.body.append(layer);
  const PLATE =
    "position:absolute;transform:translate(-50%,-50%);padding:0 0.3em;border-left:4px solid;border-radius:0.25em;white-space:nowrap;" +
    "font:12px/1.35 system-ui,sans-serif;background:rgba(24,30,40,0.82);color:#fff";
  const write = () => {
    if (layer.style.display === "none") return;
    requestAnimationFrame(write);
    const viser = window.__viserMutable, canvas = viser && viser.canvas, k = frame();
    let used = 0;
    const placed = [];
    if (canvas && viser.camera && viser.nodeRefFromName && Number.isFinite(k)) {
      const edge = canvas.getBoundingClientRect(), Vector3 = viser.camera.position.constructor;
      layer.style.clipPath = `inset(${edge.top}px ${innerWidth - edge.right}px ${innerHeight - edge.bottom}px ${edge.left}px)`;
      for (const name in hover.told) {
        const node = viser.nodeRefFromName[name], told = hover.told[name];
        if (!node || !visible(node)) continue;
        for (const item of seen(told, k)) {
          const [from, to] = ["starts", "tips"].map((what) => {
            const at = new Vector3(...place(told, what, k, item)).applyMatrix4(node.matrixWorld).project(viser.camera);
            return [edge.left + ((at.x + 1) / 2) * edge.width, edge.top + ((1 - at.y) / 2) * edge.height];
          });
          const plate = layer.children[used] ?? layer.appendChild(document.createElement("div"));
          if (!plate.style.cssText) plate.style.cssText = PLATE;
          const [what, , items] = hover.names[name] ?? ["", "", []], own = (items[item] ?? what).replace(/^[^:]*: /, "");
          const words = `${own}: ${value(told, k, item, 4)}`;
          if (plate.textContent !== words) plate.textContent = words;
          // beyond the head of the arrow, within the picture, and not over another label
          const long = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1, across = (to[0] - from[0]) / long, down = (to[1] - from[1]) / long;
          const wide = plate.offsetWidth / 2, high = plate.offsetHeight / 2, away = Math.abs(across) * wide + Math.abs(down) * high + 3;
          const x = Math.min(Math.max(to[0] + across * away, edge.left + wide), edge.right - wide), y0 = to[1] + down * away;
          const free = (y) => placed.every((p) => Math.abs(p.x - x) >= p.wide + wide || Math.abs(p.y - y) >= p.high + high);
          const y = [0, 1, -1, 2, -2, 3, -3].map((step) => y0 + step * (2 * high + 1)).find(free) ?? y0;
          placed.push({ x, y, wide, high });
          plate.style.borderLeftColor = told.color;
          plate.style.left = `${x}px`;
          plate.style.top = `${y}px`;
          used += 1;
        }
      }
    }
    while (layer.children.length > used) layer.lastChild.remove();
  };
  hover.beside = (on) => {
    const was = layer.style.display !== "none";
    layer.style.display = on ? "block" : "none";
    if (on && !was) write();
  };

  // The nearest named node on the ray, with the index of the instance if the node draws several items.
  const nearest = (viser, canvas) => {
    const edge = canvas.getBoundingClientRect(), camera = viser.camera, Vector3 = camera.position.constructor;
    const x = (2 * (pointer.x - edge.left)) / edge.width - 1, y = 1 - (2 * (pointer.y - edge.top)) / edge.height;
    const origin = new Vector3().setFromMatrixPosition(camera.matrixWorld);
    const direction = new Vector3(x, y, 0.5).unproject(camera).sub(origin).normalize();
    const caster = { ray: { origin, direction }, camera, near: 0, far: Infinity, params: { Mesh: {}, Line: {}, Points: {} } };
    let best = null;
    for (const name in hover.names) {
      const node = viser.nodeRefFromName[name];
      if (!node || !visible(node)) continue;
      node.traverseVisible((part) => {
        if (!part.isMesh) return;
        const hits = [];
        part.raycast(caster, hits);
        for (const hit of hits)
          if (!best || hit.distance < best.distance) best = { name, distance: hit.distance, part, instance: hit.instanceId };
      });
    }
    return best;
  };
  const look = () => {
    waiting = false;
    const viser = window.__viserMutable, canvas = viser && viser.canvas;
    if (!pointer || !canvas || !viser.camera || !viser.nodeRefFromName) return hide();
    let hit = null;
    try { hit = nearest(viser, canvas); } catch { /* another version of viser: no names */ }
    if (!hit) return hide();
    let [what, more, items] = hover.names[hit.name];
    // with several items, the instance identifies the item only if as many are drawn as expected
    const drawn = hit.part.instancesCount ?? hit.part.count;
    const told = hover.told[hit.name], k = frame();
    if (told && Number.isFinite(k)) {
      const shown = seen(told, k), item = items.length ? (shown.length === drawn ? shown[hit.instance] : undefined) : 0;
      if (item !== undefined) what = `${items[item] ?? what}, ${value(told, k, item)}`;
    } else if (items && items.length === drawn && items[hit.instance] !== undefined) what = items[hit.instance];
    hover.found = what;
    title.textContent = what;
    words.textContent = more;
    words.style.display = more ? "" : "none";
    box.style.display = "block";
    const left = pointer.x + 16 + box.offsetWidth > innerWidth ? pointer.x - 12 - box.offsetWidth : pointer.x + 16;
    const top = pointer.y + 18 + box.offsetHeight > innerHeight ? pointer.y - 12 - box.offsetHeight : pointer.y + 18;
    box.style.left = `${left}px`;
    box.style.top = `${top}px`;
  };
  const soon = () => { if (!waiting) { waiting = true; requestAnimationFrame(look); } };
  document.addEventListener("pointermove", (event) => {
    const viser = window.__viserMutable, canvas = viser && viser.canvas;
    // Nothing is shown while a button is pressed (camera turned, handle dragged), nor for touch, as the finger covers the item.
    const over = canvas && event.pointerType !== "touch" && event.buttons === 0 && (canvas === event.target || canvas.parentElement.contains(event.target));
    pointer = over ? { x: event.clientX, y: event.clientY } : null;
    clearInterval(timer);
    if (pointer) { soon(); timer = setInterval(soon, AGAIN); } else hide();
  }, { capture: true, passive: true });
  const leave = () => { pointer = null; clearInterval(timer); hide(); };
  document.addEventListener("pointerdown", leave, { capture: true, passive: true });
  document.addEventListener("pointerleave", leave);
  window.mechvizHover = hover;
}
