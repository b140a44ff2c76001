// Labels of the scene: subscripts, and plates in the colours of the page: see labels.py. viser draws the letters of a label one by
// one with the fonts of the page and supports neither; subscripts are characters of Unicode's private use area. If another version
// of viser draws labels differently, plates stay white and subscripts appear as boxes.
if (!window.mechvizLetters) {
  const FIRST = 0xe000, SMALL = 0.74, DROP = 0.2; // of the size of the font
  const pen = CanvasRenderingContext2D.prototype, { measureText, fillText } = pen;
  const low = /[\ue000-\ue7ff]/;
  // The pieces of a text, normal or subscript: words, start x, drop y, font and measured size; and the total width.
  const pieces = (g, text) => {
    const font = g.font, size = parseFloat(/([\d.]+)px/.exec(font)[1]), found = [];
    let x = 0;
    for (const piece of text.match(/[\ue000-\ue7ff]+|[^\ue000-\ue7ff]+/g) || []) {
      const below = low.test(piece), words = below ? [...piece].map((c) => String.fromCharCode(c.charCodeAt(0) - FIRST)).join("") : piece;
      if (below) g.font = font.replace(/[\d.]+px/, `${SMALL * size}px`);
      const about = measureText.call(g, words);
      found.push({ words, x, y: below ? DROP * size : 0, font: g.font, about });
      x += about.width;
      g.font = font;
    }
    return { found, width: x };
  };
  pen.measureText = function (text) {
    const whole = measureText.call(this, text);
    if (!low.test(text)) return whole;
    const { found, width } = pieces(this, text), most = (f) => Math.max(...found.map(f));
    return {
      width,
      actualBoundingBoxLeft: most(({ x, about }) => about.actualBoundingBoxLeft - x),
      actualBoundingBoxRight: most(({ x, about }) => about.actualBoundingBoxRight + x),
      actualBoundingBoxAscent: most(({ y, about }) => about.actualBoundingBoxAscent - y),
      actualBoundingBoxDescent: most(({ y, about }) => about.actualBoundingBoxDescent + y),
      fontBoundingBoxAscent: whole.fontBoundingBoxAscent,
      fontBoundingBoxDescent: whole.fontBoundingBoxDescent,
    };
  };
  pen.fillText = function (text, x, y, ...rest) {
    if (!low.test(text)) return fillText.call(this, text, x, y, ...rest);
    const { font } = this;
    for (const piece of pieces(this, text).found) {
      this.font = piece.font;
      fillText.call(this, piece.words, x + piece.x, y + piece.y);
    }
    this.font = font;
  };

  const LIGHT = { "vec4(1.0, 1.0, 1.0, 0.85 * vAlpha)": "vec4(0.13, 0.15, 0.18, 0.85 * vAlpha)", "vec4(0.0, 0.0, 0.0, a)": "vec4(0.93, 0.94, 0.96, a)" };
  const paint = (material) => {
    if (!material || !material.fragmentShader) return;
    const light = (material.userData.light ??= material.fragmentShader);
    let shader = light;
    if (document.documentElement.dataset.mantineColorScheme === "dark") for (const white in LIGHT) shader = shader.replace(white, LIGHT[white]);
    if (material.fragmentShader !== shader) Object.assign(material, { fragmentShader: shader, needsUpdate: true });
  };
  // Before plates are drawn, they and the letters on them, which may be new, get the colours of the page.
  const plates = () => {
    const viser = window.__viserMutable, own = viser && viser.scene && viser.scene.__r3f, found = [];
    if (own) (own.root || own).getState().scene.traverse((o) => { if (o.isMesh && o.material.fragmentShader?.includes("0.85 * vAlpha")) found.push(o); });
    for (const plate of found) plate.onBeforeRender = () => plate.parent.children.forEach((o) => paint(o.material));
    if (!found.length) setTimeout(plates, 200);
  };
  plates();
  window.mechvizLetters = { pieces };
}
