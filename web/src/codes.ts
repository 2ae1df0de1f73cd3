// Whole numbers of a picture, predicted from their neighbors (stereo_seecolor/report/prediction.py).

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
