// Names at the pointer: see hover.py. viser tells nothing of a pointer that only hovers, so the page looks by itself: a ray from
// the camera through the pointer against the named nodes. Where viser's page does not show its scene, nothing happens.
if (!window.mechvizHover) {
  const hover = { names: {}, found: null };
  const AGAIN = 150; // [ms] after which is looked again while the pointer rests: what moves may have come below it
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

  // The nearest named node on the ray, with the number of the instance where it draws several things.
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
    try { hit = nearest(viser, canvas); } catch { /* another version of viser draws in other ways: no names */ }
    if (!hit) return hide();
    let [what, more, items] = hover.names[hit.name];
    // of several arrows all are drawn, or it is not known which they are
    const drawn = hit.part.instancesCount ?? hit.part.count;
    if (items && items.length === drawn && items[hit.instance] !== undefined) what = items[hit.instance];
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
    // Buttons: the camera is being turned, a handle dragged. A finger covers what it would be told of.
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
