// Gaps of the map: where a line of sight passes through one, and why it has no height there.

import type { Heights } from "./heights";
import type { Sight } from "./scene";

const MOST_STEPS = 2000;

/** Why a spot from above has no height, as a number of the texts; 0 where it has one, or lies outside of the map. */
export async function gapAt(heights: Heights, x_m: number, y_m: number): Promise<number> {
  await heights.load([[x_m, y_m]]);
  const [column, row] = heights.cell(x_m, y_m).map(Math.round);
  return heights.gap(column, row);
}

/** The spot where a line of sight passes through a gap, nearest to the height of the reef before it; null where it passes through none. */
export async function gapOnSight(heights: Heights, { origin_m, direction }: Sight, low_m: number, high_m: number): Promise<number[] | null> {
  if (!(direction[2] < 0)) return null;
  const at = (far: number) => [0, 1, 2].map((axis) => origin_m[axis] + far * direction[axis]);
  const cell_m = heights.place.pixel_m; // level ground has no height of its own
  const [from, to] = [high_m + cell_m, low_m - cell_m].map((z) => Math.max((z - origin_m[2]) / direction[2], 0));
  await heights.load([at(from), at(to)]);
  const level = Math.hypot(direction[0], direction[1]);
  const steps = Math.min(MOST_STEPS, 2 + Math.ceil(((to - from) * level) / cell_m));
  let [best, least, reef_m] = [null as number[] | null, Infinity, NaN];
  for (let i = 0; i <= steps; i++) {
    const spot = at(from + ((to - from) * i) / steps);
    const [column, row] = heights.cell(spot[0], spot[1]).map(Math.round);
    const height_m = heights.at(column, row);
    if (!Number.isNaN(height_m)) reef_m = height_m;
    else if (heights.gap(column, row)) {
      const off_m = Math.abs(spot[2] - (Number.isNaN(reef_m) ? low_m : reef_m));
      if (off_m < least) [best, least] = [spot, off_m];
    }
  }
  return best;
}
