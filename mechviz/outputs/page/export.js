/* Plots as files: a drawing surface that writes SVG instead of painting, tables, and downloads. */

/** The part of a canvas context that plots use; `text()` returns the drawing as SVG. */
class SvgSurface {
  constructor(width, height, ground) {
    [this.width, this.height, this.parts, this.depth] = [width, height, [`<rect width="100%" height="100%" fill="${ground}"/>`], 0];
    Object.assign(this, { font: "11px sans-serif", lineWidth: 1, globalAlpha: 1, strokeStyle: "#000", fillStyle: "#000", textAlign: "left", textBaseline: "alphabetic", path: "", dashes: [], open: [0] });
  }

  save() {
    this.open.push(0);
  }

  restore() {
    this.parts.push("</g>".repeat(this.open.pop()));
  }

  group(attributes) {
    this.parts.push(`<g ${attributes}>`);
    this.open[this.open.length - 1]++;
  }

  translate(x, y) {
    this.group(`transform="translate(${fixed(x)} ${fixed(y)})"`);
  }

  rotate(angle) {
    this.group(`transform="rotate(${fixed((angle * 180) / Math.PI)})"`);
  }

  rect(x, y, w, h) {
    this.path += `M${fixed(x)} ${fixed(y)}h${fixed(w)}v${fixed(h)}h${fixed(-w)}Z`;
  }

  clip() {
    const id = `clip${this.parts.length}`;
    this.parts.push(`<clipPath id="${id}"><path d="${this.path}"/></clipPath>`);
    this.group(`clip-path="url(#${id})"`);
  }

  beginPath() {
    this.path = "";
  }

  moveTo(x, y) {
    this.path += `M${fixed(x)} ${fixed(y)}`;
  }

  lineTo(x, y) {
    this.path += `${this.path ? "L" : "M"}${fixed(x)} ${fixed(y)}`;
  }

  stroke() {
    const dashes = this.dashes.length ? ` stroke-dasharray="${this.dashes.join(" ")}"` : "";
    if (this.path) this.parts.push(`<path d="${this.path}" fill="none" stroke="${this.strokeStyle}" stroke-width="${this.lineWidth}" stroke-linejoin="round"${dashes}/>`);
  }

  fill() {
    if (this.path) this.parts.push(`<path d="${this.path}Z" fill="${this.fillStyle}" fill-opacity="${this.globalAlpha}"/>`);
  }

  setLineDash(dashes) {
    this.dashes = dashes;
  }

  measureText(text) {
    return { width: 6 * text.length };
  }

  fillText(text, x, y) {
    const anchor = { left: "start", center: "middle", right: "end" }[this.textAlign];
    const base = { top: "hanging", middle: "central", alphabetic: "auto" }[this.textBaseline];
    this.parts.push(`<text x="${fixed(x)}" y="${fixed(y)}" fill="${this.fillStyle}" text-anchor="${anchor}" dominant-baseline="${base}">${escaped(text)}</text>`);
  }

  text(title) {
    const head = `<svg xmlns="http://www.w3.org/2000/svg" width="${this.width}" height="${this.height}" viewBox="0 0 ${this.width} ${this.height}" font-family="sans-serif" font-size="11">`;
    return `${head}<title>${escaped(title)}</title>${this.parts.join("")}${"</g>".repeat(this.open.reduce((a, b) => a + b, 0))}</svg>\n`;
  }
}

/** A text as the content of an element: `]]>`, too, has a meaning in XML. */
function escaped(text) {
  return text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
}

function fixed(value) {
  return String(Number(value.toFixed(2)));
}

/** CSV text of named columns; every number in its shortest form. */
function csv(names, columns) {
  const quoted = (name) => (/[",\n]/.test(name) ? `"${name.replace(/"/g, '""')}"` : name);
  const rows = Array.from(columns[0], (_, k) => columns.map((c) => (Number.isFinite(c[k]) ? String(c[k]) : "")).join(","));
  return `${[names.map(quoted).join(","), ...rows].join("\r\n")}\r\n`;
}

/** Downloads data as a file, whose name keeps its ending however long the title is. */
function download(title, ending, type, data) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([data], { type }));
  link.download = `${title.replace(/[^\p{L}\p{N}.-]+/gu, "-").slice(0, 76)}.${ending}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
