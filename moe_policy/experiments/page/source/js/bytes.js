// Arrays of the block in which the page's data lie; see moe_policy/experiments/page/packing.py.

const KINDS = { float64: Float64Array, float32: Float32Array, int8: Int8Array, uint8: Uint8Array };

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

/** Whole numbers, row by row, in the units of their rows. */
function inUnits(numbers, units) {
  const made = new Float32Array(numbers.length), width = numbers.length / units.length;
  for (let i = 0; i < numbers.length; i++) made[i] = numbers[i] * units[Math.floor(i / width)];
  return made;
}

/** A function that returns the array at a place of the block `text`. */
export function reader(text) {
  const { buffer } = bytes(text);
  function read({ type, at, size, units }) {
    if (type === "float16") return halves(new Uint16Array(buffer, at, size));
    const found = new KINDS[type](buffer, at, size);
    return units ? inUnits(found, read(units)) : found;
  }
  return read;
}
