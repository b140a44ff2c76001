// Draws large scenes with fewer triangles while something moves, where there is no graphics card: there each triangle costs as much as
// many pixels, and most of those of many small bodies are smaller than a pixel. Corners that lie within a pixel or so of each other
// and face the same way become one. Each mesh gets a coarse one below it, of the same corners, which takes its place in light pictures.
(() => {
  const viser = window.__viserMutable, drawing = window.mechvizDrawing;
  if (!drawing || drawing.coarse || !drawing.software) return;

  const MANY = 30000, FEW = 100; // triangles: of a picture from which on this pays, of a mesh that is left alone
  const CELL = 1.25, FINER = 0.5, COARSER = 4; // [pixels], and by what the view may come nearer or go away before they are made anew
  const made = (drawing.coarse = new Map()), mine = new WeakSet(); // by mesh

  // Which of the corners stand for all, and the triangles that are left: their three are different, and no others have the same
  const cluster = (position, normal, index, cell) => {
    const count = position.length / 3, stands = new Uint32Array(count), first = new Map(), low = [Infinity, Infinity, Infinity];
    for (let k = 0; k < position.length; k++) low[k % 3] = Math.min(low[k % 3], position[k]);
    for (let v = 0; v < count; v++) {
      let key = 0, side = 0, most = 0;
      for (let axis = 0; axis < 3; axis++) {
        key = key * 131072 + Math.min(Math.round((position[3 * v + axis] - low[axis]) / cell), 131071);
        const part = normal[3 * v + axis];
        if (Math.abs(part) > most) { most = Math.abs(part); side = 2 * axis + (part > 0 ? 1 : 0); }
      }
      const place = key + side / 8; // below 2 ** 51: eighths are exact
      if (!first.has(place)) first.set(place, v);
      stands[v] = first.get(place);
    }
    const left = [], seen = new Set();
    for (let k = 0; k < index.length; k += 3) {
      const a = stands[index[k]], b = stands[index[k + 1]], c = stands[index[k + 2]];
      if (a === b || b === c || c === a) continue;
      const key = a < b ? (a < c ? `${a},${b},${c}` : `${c},${a},${b}`) : b < c ? `${b},${c},${a}` : `${c},${a},${b}`;
      if (!seen.has(key)) { seen.add(key); left.push(a, b, c); }
    }
    return new Uint32Array(left);
  };
  drawing.cluster = cluster;

  const drop = (mesh) => {
    const { low } = made.get(mesh);
    low.removeFromParent();
    // The corners belong to the mesh itself: only what is ours may go
    low.geometry.attributes = {};
    low.geometry.dispose();
    made.delete(mesh);
  };
  const build = (mesh, cell) => {
    const { position, normal } = mesh.geometry.attributes, index = mesh.geometry.index;
    let Geometry = mesh.geometry.constructor;
    while (new Geometry().type !== "BufferGeometry") Geometry = Object.getPrototypeOf(Geometry);
    const bare = new Geometry();
    bare.setAttribute("position", position);
    bare.setAttribute("normal", normal);
    bare.setIndex(new index.constructor(cluster(position.array, normal.array, index.array, cell), 1));
    const low = new mesh.constructor(bare, mesh.material);
    low.raycast = () => {};
    low.frustumCulled = false; // it is drawn if the mesh is
    low.layers.disableAll();
    mesh.add(low);
    mine.add(low);
    made.set(mesh, { low, cell, position, index });
  };
  const suits = (o) => o.isMesh && !o.isInstancedMesh && !o.isInstancedMesh2 && o.material.isMeshStandardMaterial &&
    o.geometry.index && o.geometry.index.count > 3 * FEW && o.geometry.attributes.normal && !mine.has(o);

  let meshes = [], resting = true;
  drawing.before.push((part, lightly, camera, height) => {
    if (!lightly || drawing.triangles < MANY) { resting = true; return null; }
    if (resting) {
      meshes = [];
      viser.scene.traverse((o) => { if (suits(o)) meshes.push(o); });
      for (const mesh of [...made.keys()]) if (!meshes.includes(mesh)) drop(mesh);
      resting = false;
    }
    const pixel = (2 * Math.tan((camera.fov * Math.PI) / 360)) / height, centre = camera.position.clone(), swapped = [];
    for (const mesh of meshes) {
      const { center } = mesh.geometry.boundingSphere || {}, { position } = mesh.geometry.attributes;
      if (!center || !position) continue;
      const cell = CELL * pixel * centre.copy(center).applyMatrix4(mesh.matrixWorld).distanceTo(camera.position);
      const known = made.get(mesh);
      const fits = known && known.position === position && known.index === mesh.geometry.index &&
        cell > FINER * known.cell && cell < COARSER * known.cell;
      if (!fits) {
        if (known) drop(mesh);
        build(mesh, cell);
      }
      const { low } = made.get(mesh);
      low.material = mesh.material;
      if (mesh.layers.mask) { low.layers.mask = mesh.layers.mask; mesh.layers.mask = 0; swapped.push([mesh, low]); }
    }
    return () => {
      for (const [mesh, low] of swapped) { mesh.layers.mask = low.layers.mask; low.layers.mask = 0; }
    };
  });
})();
