// Arrays of the block in which the page's data lie; see moe_policy/experiments/page/packing.py.

const KINDS = { float64: Float64Array, float32: Float32Array, uint8: Uint8Array };

/** The bytes of a text in base64. */
function bytes(text) {
  const found = atob(text), made = new Uint8Array(found.length);
  for (let i = 0; i < found.length; i++) made[i] = found.charCodeAt(i);
  return made;
}

/** Numbers in half precision, as those in single precision. */
function halves(codes) {
  const made = new Float32Array(codes.length);
  for (let i = 0; i < codes.length; i++) {
    const code = codes[i], exponent = (code >> 10) & 31, fraction = code & 1023;
    const size = exponent ? (1 + fraction / 1024) * 2 ** (exponent - 15) : fraction * 2 ** -24;
    made[i] = code & 0x8000 ? -size : size;
  }
  return made;
}

/** A function that returns the array at a place of the block `text`. */
export function reader(text) {
  const { buffer } = bytes(text);
  return ({ type, at, size }) =>
    type === "float16" ? halves(new Uint16Array(buffer, at, size)) : new KINDS[type](buffer, at, size);
}
