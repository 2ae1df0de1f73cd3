// A frame's ranges: loaded as a script, decoded, and turned into meters (stereo_seecolor/report/range_code.py).

import { numbers } from "./codes";
import { address, type Dive } from "./dive";
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
export function ranges(dive: Dive, name: string): Promise<Ranges> {
  const known = kept.get(name);
  if (known) return known;
  const made = load(dive, name).then(unpack);
  kept.set(name, made);
  if (kept.size > MOST_KEPT) kept.delete(kept.keys().next().value as string);
  made.catch(() => kept.delete(name));
  return made;
}

function load(dive: Dive, name: string): Promise<Packed> {
  return new Promise((resolve, reject) => {
    waiting.set(name, resolve);
    script(address(dive, "ranges", name, ".js")).catch(reject);
  });
}

async function unpack({ width, height, step_per_m, ...packed }: Packed): Promise<Ranges> {
  const [codes, std, confidence, mask] = await Promise.all([packed.ranges, packed.std, packed.confidence, packed.mask].map(numbers));
  return {
    width,
    height,
    range_m: Float32Array.from(codes, (code) => (code ? 1 / (code * step_per_m) : NaN)),
    std_m: Float32Array.from(std, (code) => (code ? STD_FLOOR_M * 2 ** ((code - 1) / STD_STEPS_PER_OCTAVE) : NaN)),
    confidence: Uint8Array.from(confidence, (code) => 16 * code),
    mask: Uint8Array.from(mask),
  };
}
