/* Unpacks the page's data (written by pack.py): base64, deflate, then a header and arrays stored as byte planes. */

const SIZES = { f32: 4, q16: 2, i8: 1, u8: 1, d32: 4 };
const ABSENT = 65535;

async function unpack(text) {
  const letters = atob(text.trim());
  const packed = new Uint8Array(letters.length);
  for (let k = 0; k < letters.length; k++) packed[k] = letters.charCodeAt(k);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  const arrays = header.arrays.map((entry) => array(bytes, 4 + length, entry));
  return { header, arrays };
}

function array(bytes, start, { type, at, count, low, span }) {
  const size = SIZES[type];
  const buffer = new ArrayBuffer(count * size);
  const out = new Uint8Array(buffer);
  for (let plane = 0; plane < size; plane++) {
    const from = start + at + plane * count;
    for (let k = 0; k < count; k++) out[k * size + plane] = bytes[from + k];
  }
  if (type === "f32") return new Float32Array(buffer);
  if (type === "u8") return out;
  if (type === "i8") return Float32Array.from(new Int8Array(buffer), (v) => v / 127);
  if (type === "q16") return Float32Array.from(new Uint16Array(buffer), (v) => (v === ABSENT ? NaN : low + span * v));
  const steps = new Int32Array(buffer);
  const sums = new Uint32Array(count);
  let sum = 0;
  for (let k = 0; k < count; k++) sums[k] = sum += steps[k];
  return sums;
}
