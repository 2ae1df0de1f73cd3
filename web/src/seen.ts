// Which frames saw a spot of the reef.

import { posesOf } from "./blocks";
import type { BlockPlace, Dive, Geometry } from "./dive";
import { has } from "./dive";
import { seecolor } from "./shared";

const MOST = 12;
const FARTHEST_M = 40; // no camera sees farther through water
const AGREEMENT = 0.05;

/** A frame that sees a spot: where in its picture, and from how far. */
export interface Sighting {
  name: string;
  x_px: number;
  y_px: number;
  range_m: number;
}

/** Frames in whose picture a spot of the map lies, the nearest first, a dozen at most: of the blocks whose cameras may be so near. */
export async function sightings(dive: Dive, spot_m: number[]): Promise<Sighting[]> {
  if (!dive.geometry) return [];
  const found: Sighting[] = [];
  const off_m = (each: BlockPlace) => Math.hypot(...spot_m.map((value, i) => Math.max(each.low_m[i] - value, value - each.high_m[i], 0)));
  const near = dive.blocks.flatMap((each, number): [number, number][] => (each ? [[off_m(each), number]] : [])).sort((a, b) => a[0] - b[0]);
  for (const [least_m, number] of near) {
    if (least_m > FARTHEST_M || found.filter(({ range_m }) => range_m <= least_m).length >= MOST) break;
    found.push(...seenFrom(dive.geometry, await posesOf(dive, number), spot_m));
  }
  return found.sort((a, b) => a.range_m - b.range_m).slice(0, MOST);
}

/** Frames of these poses in whose picture a spot lies. */
export function seenFrom(g: Geometry, poses: [string, number[]][], spot_m: number[]): Sighting[] {
  const found: Sighting[] = [];
  for (const [name, pose] of poses) {
    const offset = [0, 1, 2].map((i) => spot_m[i] - pose[4 * i + 3]);
    const [x, y, z] = [0, 1, 2].map((i) => pose[i] * offset[0] + pose[4 + i] * offset[1] + pose[8 + i] * offset[2]);
    const x_px = g.cx_left_px + (g.focal_px * x) / z;
    const y_px = g.cy_px + (g.focal_px * y) / z;
    const [width, height] = g.image_size;
    if (z > 0 && x_px >= 0 && y_px >= 0 && x_px < width && y_px < height) found.push({ name, x_px, y_px, range_m: Math.hypot(x, y, z) });
  }
  return found;
}

/** False where the frame's own ranges say that something stands before the spot. */
export async function isVisible(dive: Dive, { name, x_px, y_px, range_m }: Sighting): Promise<boolean> {
  if (!seecolor.rangesOf || !has(dive, name, "ranges")) return true;
  const data = await seecolor.rangesOf(dive, name); // page.js and map.js are two programs: one of them holds what was loaded
  const measured = data.range_m[Math.min(Math.round(y_px), data.height - 1) * data.width + Math.min(Math.round(x_px), data.width - 1)];
  return !(measured < range_m * (1 - AGREEMENT));
}
