// Draws viser's grid as lines where there is no graphics card: viser's own fills the whole picture to colour a few of its pixels.
// The lines hang below viser's mesh, which itself is no longer drawn, and take its colours: the grid is switched as ever.
(() => {
  const viser = window.__viserMutable, drawing = window.mechvizDrawing;
  if (!drawing || drawing.lines !== undefined || !drawing.software) return;
  drawing.lines = null;

  const INK = [0.4, 0.96]; // of lines one pixel wide, as much as of viser's cells and sections, which are 0.6 and 0.9 wide and soft
  const VERTEX = `
    attribute float kind;
    varying float section;
    void main() {
      section = kind;
      gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    }`;
  const FRAGMENT = `
    varying float section;
    uniform vec3 cellColor, sectionColor;
    uniform vec2 ink;
    void main() {
      gl_FragColor = vec4(mix(cellColor, sectionColor, section), 1.0);
      #include <tonemapping_fragment>
      gl_FragColor.a = mix(ink.x, ink.y, section);
      #include <colorspace_fragment>
    }`;

  // In the grid's own plane, y = 0; those of sections come last and lie above the others
  const strokes = (width, depth, cell, section) => {
    const ends = [], kinds = [], every = Math.max(Math.round(section / cell), 1);
    for (const kind of [0, 1])
      for (const [reach, along, place] of [[width, depth, (u, v) => [u, 0, v]], [depth, width, (u, v) => [v, 0, u]]]) {
        const most = Math.floor(reach / 2 / cell + 1e-6);
        for (let k = -most; k <= most; k++)
          if ((k % every === 0) === (kind === 1)) {
            ends.push(...place(k * cell, -along / 2), ...place(k * cell, along / 2));
            kinds.push(kind, kind);
          }
      }
    return [new Float32Array(ends), new Float32Array(kinds)];
  };
  const build = (mesh) => {
    const plane = mesh.geometry, { uniforms } = mesh.material, Geometry = Object.getPrototypeOf(plane.constructor);
    const { width, height } = plane.parameters || {}, bare = new Geometry(), Attribute = plane.attributes.position.constructor;
    if (bare.type !== "BufferGeometry" || !(width > 0 && height > 0)) return null;
    const [ends, kinds] = strokes(width, height, uniforms.cellSize.value, uniforms.sectionSize.value);
    bare.setAttribute("position", new Attribute(ends, 3));
    bare.setAttribute("kind", new Attribute(kinds, 1));
    const material = new mesh.material.constructor({
      vertexShader: VERTEX, fragmentShader: FRAGMENT, transparent: true, depthWrite: false,
      uniforms: { cellColor: uniforms.cellColor, sectionColor: uniforms.sectionColor, ink: { value: [...INK] } },
    });
    const lines = new mesh.constructor(bare, material);
    lines.isMesh = false;
    lines.isLine = lines.isLineSegments = true; // what the renderer asks for
    lines.raycast = () => {};
    lines.frustumCulled = false;
    mesh.add(lines);
    mesh.layers.disableAll();
    mesh.addEventListener("removed", () => { bare.dispose(); material.dispose(); });
    return { mesh, lines, key: key(mesh) };
  };
  const key = ({ geometry, material: { uniforms } }) =>
    [geometry.uuid, uniforms.cellSize.value, uniforms.sectionSize.value].join();
  const take = (found) => {
    found.lines.removeFromParent();
    found.lines.geometry.dispose(); found.lines.material.dispose();
    found.mesh.layers.set(0);
  };
  const find = () => {
    let found = null;
    const node = viser.nodeRefFromName["/grid"];
    if (node) node.traverse((o) => { if (!found && o.isMesh && o.material.uniforms && o.material.uniforms.cellSize) found = o; });
    return found;
  };
  const suits = ({ material: { uniforms: { infiniteGrid, followCamera, planeOpacity, shadowOpacity } } }) =>
    ![infiniteGrid, followCamera, planeOpacity, shadowOpacity].some((uniform) => uniform && uniform.value);

  let made = null, refused = null;
  drawing.before.push((part) => {
    const mesh = find();
    if (made && (made.mesh !== mesh || made.key !== key(mesh))) { take(made); made = null; }
    if (!made && mesh && mesh !== refused && suits(mesh)) {
      made = build(mesh);
      if (!made) refused = mesh;
    }
    drawing.lines = made && made.lines;
    if (made) made.lines.material.uniforms.ink.value = INK.map((ink) => ink * part); // a line is wider where pixels are larger
  });
})();
