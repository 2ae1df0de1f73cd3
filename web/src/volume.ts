// Volume of what an outline on the map encloses, as stereo_seecolor/extras/reef/ground_volume.py computes it (a test compares both).

import { inside, planeThrough, type Vector } from "./outlines";
import { mean, type Measured } from "./measure";
import type { Ground, Spot } from "./terrain";

const RIM_CELLS = 2;
const FEWEST_RIM_CELLS = 6;
const BENEATH = 0.75;
const ALIKE_REACH = 3;

interface Cell {
  column: number;
  row: number;
  height_m: number;
}

/** Liters above the plane through the ground around; null where too little of that is known, or where the volume is not positive. */
export function volumeAbove(ground: Ground, spots: Spot[]): Measured | null {
  const { heights } = ground;
  const cell_m = heights.place.pixel_m;
  const outline = spots.map((spot) => heights.cell(spot.point_m[0], spot.point_m[1]));
  const [[left, right], [top, bottom]] = [0, 1].map((axis) => {
    const all = outline.map((place) => place[axis]);
    return [Math.floor(Math.min(...all)) - RIM_CELLS - 1, Math.ceil(Math.max(...all)) + RIM_CELLS + 1];
  });
  const isOwn = (column: number, row: number) => inside(outline, column, row);
  const own: Cell[] = [];
  const rim: Cell[] = [];
  const near = new Set<string>();
  for (let row = top; row <= bottom; row++) {
    for (let column = left; column <= right; column++) {
      if (!isOwn(column, row)) continue;
      own.push({ column, row, height_m: heights.at(column, row) });
      for (let r = row - RIM_CELLS; r <= row + RIM_CELLS; r++) for (let c = column - RIM_CELLS; c <= column + RIM_CELLS; c++) near.add(`${c} ${r}`);
    }
  }
  for (const { column, row } of own) near.delete(`${column} ${row}`);
  for (const place of near) {
    const [column, row] = place.split(" ").map(Number);
    const height_m = heights.at(column, row);
    if (!Number.isNaN(height_m)) rim.push({ column, row, height_m });
  }
  const known = own.filter((each) => !Number.isNaN(each.height_m));
  if (rim.length < FEWEST_RIM_CELLS || !known.length) return null;
  const at = (each: Cell): Vector => [each.column - left, each.row - top, each.height_m];
  const [level, across, down] = planeThrough(rim.map(at), FEWEST_RIM_CELLS, () => 0);
  const above = (each: Cell) => each.height_m - level - across * (each.column - left) - down * (each.row - top);
  const each_l = (1000 * cell_m ** 2 * own.length) / known.length;
  const value = each_l * known.reduce((sum, each) => sum + above(each), 0);
  if (!(value > 0)) return null;
  const middle = mean(known.map(above));
  const scatter_m = Math.sqrt(mean(known.map((each) => (above(each) - middle) ** 2)));
  const stds = [
    ground.std_m * gain(known, rim, each_l, ground.correlation_m / cell_m),
    1000 * BENEATH * Math.sqrt(Math.max(alikeAround(rim, above), 0)) * own.length * cell_m ** 2,
    1000 * scatter_m * (own.length - known.length) * cell_m ** 2,
    (value * openSides(own, isOwn, ground)) / Math.sqrt(3),
  ];
  return { value, std: Math.hypot(...stds), power: 3 };
}

/** Mean product of what neighboring cells of the rim depart from its plane. */
function alikeAround(rim: Cell[], off: (each: Cell) => number): number {
  const offs = new Map(rim.map((each) => [`${each.column} ${each.row}`, off(each)]));
  const products = rim.flatMap(({ column, row }) => [`${column + 1} ${row}`, `${column} ${row + 1}`].flatMap((beside) => (offs.has(beside) ? [(offs.get(`${column} ${row}`) as number) * (offs.get(beside) as number)] : [])));
  return products.length ? mean(products) : 0;
}

/** Standard error of the volume, liters, for a height's of 1 m. */
function gain(known: Cell[], rim: Cell[], each_l: number, alike_cells: number): number {
  // the plane's integral over the known cells goes with each height of the rim as the value there of a plane: that through numbers whose sums are the integral's
  const [c0, r0] = [mean(rim.map((each) => each.column)), mean(rim.map((each) => each.row))];
  const [sx, sy] = [known.reduce((sum, each) => sum + each.column - c0, 0), known.reduce((sum, each) => sum + each.row - r0, 0)];
  const [xx, xy, yy] = rim.reduce(([a, b, c], { column, row }) => [a + (column - c0) ** 2, b + (column - c0) * (row - r0), c + (row - r0) ** 2], [0, 0, 0]);
  const det = xx * yy - xy * xy;
  const [gx, gy] = [(sx * yy - sy * xy) / det, (sy * xx - sx * xy) / det];
  const weights = new Map<string, number>(known.map(({ column, row }) => [`${column} ${row}`, each_l]));
  for (const { column, row } of rim) weights.set(`${column} ${row}`, -each_l * (known.length / rim.length + gx * (column - c0) + gy * (row - r0)));
  const reach = Math.ceil(ALIKE_REACH * alike_cells);
  let variance = 0;
  for (const [place, weight] of weights) {
    const [column, row] = place.split(" ").map(Number);
    for (let y = -reach; y <= reach; y++) {
      for (let x = -reach; x <= reach; x++) {
        const beside = weights.get(`${column + x} ${row + y}`);
        if (beside !== undefined) variance += weight * beside * (x || y ? Math.exp(-(x * x + y * y) / (2 * alike_cells ** 2)) : 1);
      }
    }
  }
  return Math.sqrt(Math.max(variance, 0));
}

/**
 * The part of what is enclosed that may be empty below: edges of cells at which the ground falls off by a step whose side was not seen,
 * or at which the outline ends and the ground is not known, over all edges at which the outline ends; at most 1.
 */
function openSides(own: Cell[], isOwn: (column: number, row: number) => boolean, { heights, gap_m }: Ground): number {
  let [ends, open] = [0, 0];
  for (const { column, row, height_m } of own) {
    for (const [c, r] of [[column + 1, row], [column - 1, row], [column, row + 1], [column, row - 1]]) {
      const fall_m = height_m - heights.at(c, r);
      const end = !isOwn(c, r);
      if (end) ends++;
      if ((end && Number.isNaN(fall_m)) || (fall_m > gap_m && !heights.side(column, row))) open++;
    }
  }
  return Math.min(open / Math.max(ends, 1), 1);
}
