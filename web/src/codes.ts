// What scripts hold as text: bytes (stereo_seecolor/report/templates.py), and whole numbers of a picture (stereo_seecolor/report/plane_code.py).

const [ESCAPE, MOVED] = [0x100, 0x4000];
const CLIP = 2;
const MOST_AROUND = 12;
const UNARY = 20;
const SHIFT = 6;

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

/** Each whole number, row after row: a prediction from its neighbors, and its error from a binary arithmetic code. */
export function decoded(text: string, width: number, height: number): Int32Array {
  const bytes = fromText(text);
  const chances = (count: number) => new Uint16Array(count).fill(1 << 15);
  const begun = chances(2 * (2 * CLIP + 1) ** 3);
  const further = chances((MOST_AROUND + 1) * UNARY);
  const counts = chances(64);
  let [low, high, code, read] = [0, 0xffffffff, 0, 0];
  const next = () => (code = ((code << 8) | (bytes[read++] ?? 0)) >>> 0);
  for (let i = 0; i < 4; i++) next();
  const bit = (of: Uint16Array, which: number): number => {
    const chance = of[which];
    const middle = low + Math.floor(((high - low) * chance) / 65536);
    const found = code <= middle ? 1 : 0;
    if (found) {
      high = middle;
      of[which] = chance + ((65536 - chance) >> SHIFT);
    } else {
      low = middle + 1;
      of[which] = chance - (chance >> SHIFT);
    }
    while ((low ^ high) >>> 24 === 0) {
      low = (low << 8) >>> 0;
      high = ((high << 8) | 255) >>> 0;
      next();
    }
    return found;
  };
  const size = () => {
    let rest = 0;
    let found = 0;
    while (bit(counts, found)) found++;
    for (let place = found - 1; place >= 0; place--) rest |= bit(counts, 32 + place) << place;
    return (1 << found) + rest - 1;
  };
  const clipped = (difference: number) => Math.min(Math.max(difference, -CLIP), CLIP) + CLIP;
  const values = new Int32Array(width * height);
  for (let row = 0, i = 0; row < height; row++) {
    let left = 0;
    for (let column = 0; column < width; column++, i++) {
      const up = row ? values[i - width] : left;
      if (!column) left = up;
      const leftAbove = !column ? up : row ? values[i - width - 1] : left;
      const rightAbove = row && column + 1 < width ? values[i - width + 1] : up;
      const value = Math.max(Math.min(left, up), Math.min(Math.max(left, up), left + up - leftAbove)); // the middle of three
      const [first, second, third] = [rightAbove - up, up - leftAbove, leftAbove - left];
      const context = 2 * ((clipped(first) * (2 * CLIP + 1) + clipped(second)) * (2 * CLIP + 1) + clipped(third));
      let error = 0;
      if (bit(begun, context)) {
        const negative = bit(begun, context + 1);
        const place = Math.min(Math.abs(first) + Math.abs(second) + Math.abs(third), MOST_AROUND) * UNARY;
        let rest = 0;
        while (rest < UNARY && bit(further, place + rest)) rest++;
        if (rest === UNARY) rest += size();
        error = negative ? -1 - rest : 1 + rest;
      }
      values[i] = left = value + error;
    }
  }
  return values;
}
