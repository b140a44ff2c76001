// Draws lightly while something moves, where there is no graphics card: see drawing.py. Loaded once into a page that has its canvas.
(() => {
  const viser = window.__viserMutable, own = viser && viser.scene && viser.scene.__r3f, store = own && (own.root || own);
  const read = store && store.getState, gl = read && read().gl, context = gl && gl.getContext && gl.getContext();
  const complete = context && context.texStorage2D && gl.resetState && gl.state && gl.setViewport && gl.getRenderTarget && read().invalidate;
  if (window.mechvizDrawing || !complete) return;

  const REST = 150; // [ms] without a change, after which the picture is drawn as well as can be
  const LEVELS = [0, 1, 0.75, 0.5]; // parts of the pixels each way, with one sample each; 0: as the canvas is
  const MOST = 14, LEAST = 4, GAIN = 0.85; // [ms] for a picture: above it the next level, below it the last; a gain worth it
  const OFTEN = 4, COUNT = 3; // one of so many pictures is timed, and the shortest of so many times decides

  const named = context.getExtension("WEBGL_debug_renderer_info");
  const card = String(context.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : context.RENDERER));
  const drawing = {
    card, software: /swiftshader|llvmpipe|softpipe|software|basic render/i.test(card),
    fixed: new URLSearchParams(window.location.search).has("fixedDpr"), // somebody has chosen the number of pixels
    moving: false, level: 1, whole: 0, light: 0, size: null, // pictures drawn as well as can be, lightly; of the last
    triangles: 0, before: [], // of a whole picture; what is to be done before each, which may give what is to be done after
  };
  drawing.draw = () => read().invalidate();

  // -- what moves ---------------------------------------------------------------------------------------------------
  let due = 0, waiting = 0;
  const rest = () => {
    const left = due - performance.now();
    waiting = left > 1 ? setTimeout(rest, left) : 0;
    if (waiting) return;
    drawing.moving = false;
    const { viewport, setDpr } = read(), ratio = window.devicePixelRatio;
    // viser leaves a slow page with fewer pixels for good
    if (drawing.software && !drawing.fixed && viewport.dpr < ratio) setDpr(ratio);
    drawing.draw();
  };
  drawing.touch = () => {
    drawing.moving = true;
    due = performance.now() + REST;
    if (!waiting) waiting = setTimeout(rest, REST);
  };
  const last = new Float64Array(9);
  const turned = ({ position: p, quaternion: q, fov, zoom }) => {
    const now = [p.x, p.y, p.z, q.x, q.y, q.z, q.w, fov, zoom], other = now.some((value, k) => value !== last[k]);
    last.set(now);
    return other;
  };

  // -- how lightly: a picture that takes too long gets fewer pixels, if that helps ---------------------------------------
  let times, before, vain;
  drawing.forget = () => { times = []; before = 0; vain = false; };
  drawing.forget();
  drawing.took = (time) => {
    times.push(time);
    if (times.length < COUNT) return;
    const least = Math.min(...times), tried = before;
    times = []; before = 0;
    if (tried && least > GAIN * tried) { drawing.level -= 1; vain = true; } // it is not the pixels that cost
    else if (least > MOST && drawing.level < LEVELS.length - 1 && !(vain && drawing.level > 0)) {
      if (drawing.level > 0) before = least;
      drawing.level += 1;
    } else if (least < LEAST && drawing.level > 0) drawing.level -= 1;
  };
  const pixel = new Uint8Array(4);
  const finish = () => context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, pixel); // waits for the picture
  const timed = (draw) => {
    if ((drawing.whole + drawing.light) % OFTEN) return draw();
    finish();
    const start = performance.now();
    draw(); finish();
    drawing.took(performance.now() - start);
  };

  // three takes a state that it has forgotten for one in which what is near has the lesser depth; viser's page has it the other way
  // round, and all that is behind would be drawn before all that is in front
  const depth = gl.state && gl.state.buffers.depth;
  const forget = () => {
    const reversed = depth && depth.getReversed && depth.getReversed();
    gl.resetState();
    if (reversed) { depth.setReversed(true); depth.setClear(1); }
  };

  // -- a picture of one sample a pixel, put onto the canvas as a whole -----------------------------------------------------
  let target = null, copier = null;
  const shader = (kind, source) => {
    const made = context.createShader(kind);
    context.shaderSource(made, source);
    context.compileShader(made);
    return made;
  };
  const prepare = (width, height, part) => {
    if (target && target.width === width && target.height === height) return;
    if (target) {
      context.deleteFramebuffer(target.frame); context.deleteTexture(target.color); context.deleteRenderbuffer(target.depth);
    }
    target = { width, height };
    target.frame = context.createFramebuffer(); target.color = context.createTexture(); target.depth = context.createRenderbuffer();
    context.activeTexture(context.TEXTURE0);
    context.bindTexture(context.TEXTURE_2D, target.color);
    context.texStorage2D(context.TEXTURE_2D, 1, context.RGBA8, width, height);
    const filter = part === 1 ? context.NEAREST : context.LINEAR;
    for (const [kind, value] of [["MIN_FILTER", filter], ["MAG_FILTER", filter], ["WRAP_S", 0], ["WRAP_T", 0]])
      context.texParameteri(context.TEXTURE_2D, context[`TEXTURE_${kind}`], value || context.CLAMP_TO_EDGE);
    context.bindRenderbuffer(context.RENDERBUFFER, target.depth);
    context.renderbufferStorage(context.RENDERBUFFER, context.DEPTH_COMPONENT24, width, height);
    context.bindFramebuffer(context.FRAMEBUFFER, target.frame);
    context.framebufferTexture2D(context.FRAMEBUFFER, context.COLOR_ATTACHMENT0, context.TEXTURE_2D, target.color, 0);
    context.framebufferRenderbuffer(context.FRAMEBUFFER, context.DEPTH_ATTACHMENT, context.RENDERBUFFER, target.depth);
    context.bindFramebuffer(context.FRAMEBUFFER, null);
    forget();
  };
  const copy = () => {
    if (!copier) {
      copier = { program: context.createProgram(), corners: context.createVertexArray() };
      context.attachShader(copier.program, shader(context.VERTEX_SHADER, `#version 300 es
        out vec2 at;
        void main() {
          vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
          at = 0.5 * corner + 0.5;
          gl_Position = vec4(corner, 0.0, 1.0);
        }`));
      context.attachShader(copier.program, shader(context.FRAGMENT_SHADER, `#version 300 es
        precision mediump float;
        in vec2 at;
        uniform sampler2D picture;
        out vec4 color;
        void main() { color = texture(picture, at); }`));
      context.linkProgram(copier.program);
    }
    for (const test of ["DEPTH_TEST", "BLEND", "CULL_FACE", "SCISSOR_TEST", "STENCIL_TEST"]) context.disable(context[test]);
    context.colorMask(true, true, true, true);
    context.viewport(0, 0, context.drawingBufferWidth, context.drawingBufferHeight);
    context.useProgram(copier.program);
    context.bindVertexArray(copier.corners);
    context.activeTexture(context.TEXTURE0);
    context.bindTexture(context.TEXTURE_2D, target.color);
    context.drawArrays(context.TRIANGLES, 0, 3);
  };
  const bind = context.bindFramebuffer, whole = gl.render;
  const light = (scene, camera) => {
    const part = LEVELS[drawing.level], { width, height } = read().size, ratio = gl.getPixelRatio();
    prepare(...[width, height].map((length) => Math.max(Math.floor(length * ratio * part), 1)), part);
    drawing.size = [target.width, target.height];
    context.bindFramebuffer = (kind, frame) => bind.call(context, kind, frame || target.frame); // whatever is meant for the canvas
    context.bindFramebuffer(context.FRAMEBUFFER, null);
    try {
      gl.setViewport(0, 0, target.width / ratio, target.height / ratio);
      timed(() => whole.call(gl, scene, camera));
    } finally {
      delete context.bindFramebuffer;
      gl.setViewport(0, 0, width, height);
      context.bindFramebuffer(context.FRAMEBUFFER, null);
      forget();
    }
    copy();
    forget();
    drawing.light += 1;
  };
  context.canvas.addEventListener("webglcontextrestored", () => { target = copier = null; });

  let canvas = "";
  gl.render = (scene, camera) => {
    const usual = scene === viser.scene && gl.getRenderTarget() === null && (viser.getRenderRequestState || "ready") === "ready";
    if (!drawing.software || !usual) return whole.call(gl, scene, camera);
    // A page without a picture behind the scene fills itself with one that is not seen
    const back = viser.backgroundMaterial, behind = back && scene.children.find((node) => node.material === back);
    if (behind) behind.visible = back.uniforms.enabled.value;
    const full = [context.drawingBufferWidth, context.drawingBufferHeight].join();
    if (full !== canvas) drawing.forget();
    canvas = full;
    if (turned(camera)) drawing.touch();
    const lightly = !drawing.fixed && drawing.moving && drawing.level > 0;
    const part = lightly ? LEVELS[drawing.level] : 1, rows = context.drawingBufferHeight * part;
    const after = drawing.before.map((first) => first(part, lightly, camera, rows));
    try {
      if (lightly) return light(scene, camera);
      const draw = () => whole.call(gl, scene, camera);
      if (drawing.moving && !drawing.fixed) timed(draw); else draw();
    } finally {
      for (const undo of after) if (undo) undo();
    }
    drawing.triangles = gl.info.render.triangles;
    drawing.whole += 1;
    drawing.size = [context.drawingBufferWidth, context.drawingBufferHeight];
  };
  window.mechvizDrawing = drawing;
})();
