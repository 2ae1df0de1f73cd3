// What scripts hold as text: bytes (stereo_seecolor/report/templates.py), and whole numbers (stereo_seecolor/report/number_code.py).

const [ESCAPE, MOVED] = [0x100, 0x4000];

/** Bytes from characters of two, of which some are escaped; a digit before them says how many of the last ones only fill it. */
export function fromText(text: string): Uint8Array<ArrayBuffer> {
  const units = new Uint16Array(text.length - 1);
  let count = 0;
  for (let i = 1; i < text.length; i++) {
    const unit = text.charCodeAt(i);
    units[count++] = unit === ESCAPE ? text.charCodeAt(++i) ^ MOVED : unit;
  }
  return new Uint8Array(units.buffer.slice(0, 2 * count - Number(text[0])));
}

/** Bytes of a deflated text. */
export async function inflated(text: string): Promise<Uint8Array> {
  const stream = new Blob([fromText(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Whole numbers: each differs from the one before by a number of either sign, in three bytes, the lowest of all first. */
export async function numbers(text: string): Promise<Int32Array> {
  const bytes = await inflated(text);
  const count = bytes.length / 3;
  const values = new Int32Array(count);
  let value = 0;
  for (let i = 0; i < count; i++) {
    const folded = bytes[i] | (bytes[count + i] << 8) | (bytes[2 * count + i] << 16);
    values[i] = value += (folded >>> 1) ^ -(folded & 1);
  }
  return values;
}
