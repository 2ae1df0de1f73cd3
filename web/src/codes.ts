// Whole numbers of a picture, predicted from their neighbors (stereo_seecolor/report/prediction.py).

const LARGE = 15;

/** Low and high bytes of the prediction's errors from two to a byte, and those that are too large for that at the end. */
export function unpacked(bytes: Uint8Array, count: number): Uint8Array {
  const planes = new Uint8Array(2 * count);
  const half = Math.ceil(count / 2);
  const large = (bytes.length - half) / 2;
  for (let i = 0, next = half; i < count; i++) {
    const low = (bytes[i >> 1] >> (4 * (i & 1))) & 15;
    planes[i] = low < LARGE ? low : bytes[next];
    if (low === LARGE) planes[count + i] = bytes[large + next++];
  }
  return planes;
}

/** Each code through value, row after row; NaN where known's bit is 0. bytes: low and high bytes of the prediction's errors. */
export function decoded(bytes: Uint8Array, known: Uint8Array, width: number, height: number, value: (code: number) => number): Float32Array {
  const count = width * height;
  const codes = new Uint16Array(count);
  const values = new Float32Array(count);
  for (let row = 0, i = 0; row < height; row++) {
    let left = 0; // the sum along the row, modulo 2^16
    for (let column = 0; column < width; column++, i++) {
      const folded = bytes[i] | (bytes[count + i] << 8);
      left += (folded >>> 1) ^ -(folded & 1);
      codes[i] = left + (row ? codes[i - width] : 0);
      values[i] = known[i >> 3] & (128 >> (i & 7)) ? value(codes[i]) : NaN;
    }
  }
  return values;
}
