// Points, lengths and areas on the map's terrain, as stereo_seecolor/extras/reef/map_ground.py computes them (a test compares both).

import type { Heights } from "./heights";
import { mean, planarArea, unseenStd, type Measured, type Placed } from "./measure";
import { inside, planeThrough, polygonArea, type Vector } from "./outlines";

const LEAST_CELLS = 2;
const LAYER_CELLS = 2;
const LAYER_STDS = 6;
const STEP_CELLS = 2;
const STEP_STDS = 6;
const NOISE = 0.25;
const STEEPEST = 0.5;
const REACH_CELLS = 8;
const OF_DEPARTURE = 0.5;
const LEAST_SPAN = 1e-3; // of the squared mean size of the cells' offsets

/** A point of the map with its covariance; slope: rise to the east and to the north. */
export interface Spot extends Placed {
  slope: [number, number];
}

export class Ground {
  constructor(
    readonly heights: Heights,
    readonly std_m: number,
  ) {}

  private get cell_m(): number {
    return this.heights.place.pixel_m;
  }

  get gap_m(): number {
    return Math.max(LAYER_CELLS * this.cell_m, LAYER_STDS * this.std_m);
  }

  /** The ground at a spot; given a height, the point of that height, with the slope of what lies there. null where it is unknown. */
  pick(x_m: number, y_m: number, z_m: number | null, click_m: number): Spot | null {
    const [column, row] = this.heights.cell(x_m, y_m);
    const cells = this.around(Math.floor(column + 0.5), Math.floor(row + 0.5), x_m, y_m);
    const layer = z_m === null ? this.highest(cells) : cells.filter((cell) => Math.abs(cell[2] - z_m) <= this.gap_m);
    if (layer.length < LEAST_CELLS) return z_m === null ? null : this.spot([x_m, y_m, z_m], [0, 0], click_m);
    const [height, east, north] = planeOf(layer);
    return this.spot([x_m, y_m, z_m ?? height], [east, north], click_m);
  }

  /** The highest layer that holds enough cells: at the edge of a coral its top, and not the ground beside it. */
  private highest(cells: Vector[]): Vector[] {
    const ranked = [...cells].sort((a, b) => b[2] - a[2]);
    const layers: Vector[][] = [];
    ranked.forEach((cell, i) => {
      if (!i || ranked[i - 1][2] - cell[2] > this.gap_m) layers.push([]);
      layers[layers.length - 1].push(cell);
    });
    return layers.find((layer) => layer.length >= LEAST_CELLS) ?? [];
  }

  private spot(point_m: Vector, [east, north]: [number, number], click_m: number): Spot {
    const [a, b, c] = [click_m ** 2, this.heightStd(point_m[0], point_m[1]) ** 2, click_m ** 2];
    const covariance = [a, 0, a * east, 0, c, c * north, a * east, c * north, b + a * east ** 2 + c * north ** 2];
    return { point_m, covariance, slope: [east, north] };
  }

  /** The standard error of a height: of ranges, and a part of what the ground around departs from a plane, as at rims. */
  private heightStd(x_m: number, y_m: number): number {
    const [column, row] = this.heights.cell(x_m, y_m);
    const cells = this.around(Math.floor(column + 0.5), Math.floor(row + 0.5), x_m, y_m, REACH_CELLS);
    const [height, east, north] = planeThrough(cells, 1, () => 0);
    const departs = cells.length ? Math.sqrt(mean(cells.map(([x, y, z]) => (z - height - east * x - north * y) ** 2))) : 0;
    return Math.hypot(this.std_m, OF_DEPARTURE * departs);
  }

  /** Points of the ground along the lines between spots; null where a spot does not lie on the ground as it is seen from above. */
  along(spots: Spot[]): Spot[] | null {
    if (!spots.every((spot) => this.isOnGround(spot))) return null;
    const step_m = Math.max(STEP_CELLS * this.cell_m, STEP_STDS * this.std_m);
    const line = [spots[0]];
    for (let k = 1; k < spots.length; k++) {
      const [a, b] = [spots[k - 1].point_m, spots[k].point_m];
      const count = Math.max(1, Math.floor(Math.hypot(b[0] - a[0], b[1] - a[1]) / step_m));
      for (let i = 1; i < count; i++) {
        const between = this.pick(a[0] + ((b[0] - a[0]) * i) / count, a[1] + ((b[1] - a[1]) * i) / count, null, 0);
        if (between) line.push(between);
      }
      line.push(spots[k]);
    }
    return line;
  }

  /** How far another spot lies off the plane of the ground at one, in height. */
  off({ point_m: a, slope: [east, north] }: Spot, { point_m: b }: Spot): number {
    return Math.abs(b[2] - a[2] - east * (b[0] - a[0]) - north * (b[1] - a[1]));
  }

  private isOnGround({ point_m: [x, y, z] }: Spot): boolean {
    const ground = this.pick(x, y, null, 0);
    return ground !== null && Math.abs(ground.point_m[2] - z) <= this.gap_m;
  }

  /** Area of the ground inside an outline; null where the outline stands too steep to be seen from above, or nothing is known. */
  area(spots: Spot[]): [Measured, number] | null {
    const outline = spots.map((spot) => this.heights.cell(spot.point_m[0], spot.point_m[1]));
    const level_m2 = polygonArea(outline) * this.cell_m ** 2;
    const planar = planarArea(spots);
    if (!(level_m2 >= STEEPEST * planar.value) || !spots.every((spot) => this.isOnGround(spot))) return null;
    const [xs, ys] = [0, 1].map((axis) => outline.map((place) => place[axis]));
    const steepness: number[] = [];
    for (let row = Math.ceil(Math.min(...ys)); row <= Math.max(...ys); row++) {
      for (let column = Math.ceil(Math.min(...xs)); column <= Math.max(...xs); column++) {
        if (!inside(outline, column, row)) continue;
        if (!Number.isNaN(this.heights.at(column, row))) steepness.push(this.steepness(column, row));
      }
    }
    if (!steepness.length) return null;
    const known = Math.min(1, steepness.length / Math.max(polygonArea(outline), 1));
    const value = mean(steepness) * level_m2;
    const byNoise = Math.sqrt(1 + (NOISE * (this.std_m / this.cell_m) ** 2) / mean(steepness.map((each) => each * each))) - 1;
    return [{ value, std: value * Math.hypot(planar.std / planar.value, byNoise, unseenStd(steepness, known)), power: 2 }, known];
  }

  /** Area over level area of the plane through 3x3 cells, of all layers. */
  private steepness(column: number, row: number): number {
    const [, east, north] = planeOf(this.around(column, row, ...this.heights.center(column, row)));
    return Math.hypot(1, east, north);
  }

  /** The known ones of 3x3 cells, or of more: offsets from a place, and heights. */
  private around(column: number, row: number, x_m: number, y_m: number, reach = 1): Vector[] {
    const cells: Vector[] = [];
    for (let r = row - reach; r <= row + reach; r++) {
      for (let c = column - reach; c <= column + reach; c++) {
        const height = this.heights.at(c, r);
        const [x, y] = this.heights.center(c, r);
        if (!Number.isNaN(height)) cells.push([x - x_m, y - y_m, height]);
      }
    }
    return cells;
  }
}

/** Height at the middle, and rise to the east and north. */
const planeOf = (cells: Vector[]) => planeThrough(cells, 4, (n, size) => LEAST_SPAN * n ** 3 * size ** 2);
