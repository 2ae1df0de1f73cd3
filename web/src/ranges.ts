// A frame's ranges: loaded as a script, inflated, and turned into meters (stereo_seecolor/report/range_code.py).

import { decoded, unpacked } from "./codes";
import { address } from "./dive";
import { script } from "./scripts";

const STD_FLOOR_M = 1e-5;
const STD_STEPS_PER_OCTAVE = 12;
export const STD_BLOCK_PX = 4;
export const OVERLAY_STEP_PX = 2;

interface Packed {
  height: number;
  width: number;
  step_per_m: number;
  ranges: string;
  known: string;
  std: string;
  confidence: string;
  mask: string;
}

/** range_m: (height x width) meters, NaN where unknown. std_m: of blocks of 4x4. confidence, mask: every second pixel. */
export interface Ranges {
  width: number;
  height: number;
  range_m: Float32Array;
  std_m: Float32Array;
  confidence: Uint8Array;
  mask: Uint8Array;
}

const waiting = new Map<string, (packed: Packed) => void>();
const kept = new Map<string, Promise<Ranges>>();
const MOST_KEPT = 8;

/** What the scripts of page/ranges call. */
export function receive(name: string, packed: Packed): void {
  waiting.get(name)?.(packed);
  waiting.delete(name);
}

/** A frame's ranges; the latest ones are kept in memory. */
export function ranges(name: string): Promise<Ranges> {
  const known = kept.get(name);
  if (known) return known;
  const made = load(name).then(unpack);
  kept.set(name, made);
  if (kept.size > MOST_KEPT) kept.delete(kept.keys().next().value as string);
  made.catch(() => kept.delete(name));
  return made;
}

function load(name: string): Promise<Packed> {
  return new Promise((resolve, reject) => {
    waiting.set(name, resolve);
    script(address("ranges", name, ".js")).catch(reject);
  });
}

async function unpack(packed: Packed): Promise<Ranges> {
  const [codes, known, std, confidence, mask] = await Promise.all(
    [packed.ranges, packed.known, packed.std, packed.confidence, packed.mask].map(inflated),
  );
  const { width, height } = packed;
  return {
    width,
    height,
    range_m: decoded(unpacked(codes, width * height), known, width, height, (code) => 1 / (code * packed.step_per_m)),
    std_m: Float32Array.from(std, (code) => (code ? STD_FLOOR_M * 2 ** ((code - 1) / STD_STEPS_PER_OCTAVE) : NaN)),
    confidence,
    mask,
  };
}

/** Bytes of a deflated text. */
export async function inflated(text: string): Promise<Uint8Array> {
  const stream = new Blob([fromText(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;<=>?@^_`{|}~";
const VALUES = Uint8Array.from({ length: 128 }, (_, code) => Math.max(DIGITS.indexOf(String.fromCharCode(code)), 0));

/** Bytes that a script holds as base85 (RFC 1924): five digits for four bytes, fewer at the end. */
export function fromText(text: string): Uint8Array<ArrayBuffer> {
  const words = Math.ceil(text.length / 5);
  const view = new DataView(new ArrayBuffer(4 * words));
  for (let word = 0; word < words; word++) {
    let value = 0;
    for (let i = 5 * word; i < 5 * word + 5; i++) value = 85 * value + (i < text.length ? VALUES[text.charCodeAt(i)] : 84);
    view.setUint32(4 * word, value);
  }
  return new Uint8Array(view.buffer, 0, 4 * words - (5 * words - text.length));
}
