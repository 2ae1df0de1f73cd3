// Points, lengths and areas on the map's terrain, as stereo_seecolor/extras/reef/map_ground.py computes them (a test compares both).

import type { Heights } from "./heights";
import { lengthAlong, mean, planarArea, straightLength, unseenStd, type Measured, type Placed } from "./measure";
import { inside, planeThrough, polygonArea, type Vector } from "./outlines";

const LEAST_CELLS = 2;
const LAYER_CELLS = 2;
const LAYER_STDS = 6;
const STEP_CELLS = 2;
const STEP_STDS = 6;
const [OF_SLOPES, OF_SQUARES, OF_NOISE] = [0.15, 0.05, 0.25];
const SMOOTHED = 0.1;
const STEEPEST = 0.5;
const [ROUGH_CELLS, ROUGH_OVER_CELLS] = [2, 4];
const OF_ROUGHNESS = 1.1;
const [OF_RELIEF, RELIEF_CELLS] = [0.15, 16];
const HOLE_CELLS = 6.5;
const PLACE_CELLS = 0.7;
const LEAST_SPAN = 1e-3; // of the squared mean size of the cells' offsets

/** A point of the map with its covariance; slope: rise to the east and to the north. */
export interface Spot extends Placed {
  slope: [number, number];
}

export class Ground {
  constructor(
    readonly heights: Heights,
    readonly std_m: number,
    readonly correlation_m: number,
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
    return { point_m, covariance, gap_m: this.gap_m, slope: [east, north] };
  }

  /** The standard error of a height (mapping/raster/height_errors.py). */
  private heightStd(x_m: number, y_m: number): number {
    const [column, row] = this.heights.cell(x_m, y_m).map((each) => Math.floor(each + 0.5));
    return this.stds(column, row, column, row)(column, row);
  }

  /** Standard errors of the heights of cells within bounds. */
  private stds(left: number, top: number, right: number, bottom: number): (column: number, row: number) => number {
    const shape = new Shape((c, r) => this.heights.at(c, r), left, top, right, bottom);
    return (column, row) => shape.std(column, row);
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

  /** Length along the ground, with a part of what is smoothed away put back; null where ``along`` is. */
  length(spots: Spot[]): Measured | null {
    const line = this.along(spots);
    if (!line) return null;
    const found = lengthAlong(line, (a, b) => this.off(a, b));
    const added = SMOOTHED * Math.max(found.value - straightLength(spots).value, 0);
    return { value: found.value + added, std: Math.hypot(found.std, added / 2), power: 1 };
  }

  /** How far another spot lies off the plane of the ground at one, in height. */
  private off({ point_m: a, slope: [east, north] }: Spot, { point_m: b }: Spot): number {
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
    const stds: number[] = [];
    const [left, top, right, bottom] = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)].map((each, i) => (i < 2 ? Math.ceil(each) : Math.floor(each)));
    const std = this.stds(left, top, right, bottom);
    for (let row = top; row <= bottom; row++) {
      for (let column = left; column <= right; column++) {
        if (!inside(outline, column, row) || Number.isNaN(this.heights.at(column, row))) continue;
        steepness.push(this.steepness(column, row));
        stds.push(std(column, row) / this.cell_m);
      }
    }
    if (!steepness.length) return null;
    const known = Math.min(1, steepness.length / Math.max(polygonArea(outline), 1));
    const value = mean(steepness) * level_m2;
    const bySlopes = OF_SLOPES * mean(stds.map((each, i) => each * Math.sqrt(1 - 1 / steepness[i] ** 2)));
    const finer = Math.sqrt(Math.max(1, this.correlation_m / this.cell_m));
    const noise = this.std_m ** 2 / ((2 * this.cell_m) ** 2 + this.correlation_m ** 2);
    const byHeights = Math.hypot(finer * bySlopes, OF_SQUARES * mean(stds) ** 2, OF_NOISE * noise) / mean(steepness);
    return [{ value, std: value * Math.hypot(planar.std / planar.value, byHeights, unseenStd(steepness, known)), power: 2 }, known];
  }

  /** Area over level area of the plane through 3x3 cells, of all layers. */
  private steepness(column: number, row: number): number {
    const [, east, north] = planeOf(this.around(column, row, ...this.heights.center(column, row)));
    return Math.hypot(1, east, north);
  }

  /** The known ones of 3x3 cells: offsets from a place, and heights. */
  private around(column: number, row: number, x_m: number, y_m: number): Vector[] {
    const cells: Vector[] = [];
    for (let r = row - 1; r <= row + 1; r++) {
      for (let c = column - 1; c <= column + 1; c++) {
        const height = this.heights.at(c, r);
        const [x, y] = this.heights.center(c, r);
        if (!Number.isNaN(height)) cells.push([x - x_m, y - y_m, height]);
      }
    }
    return cells;
  }
}

/** The standard errors of heights at cells within bounds: by the roughness around, by the slope, and beside a hole by the relief. */
class Shape {
  private readonly columns: number;
  private readonly z: Float64Array;
  private readonly departures: Float64Array; // squared, -1 where not yet computed
  private readonly rises: Float64Array; // from one cell to the next, known where the departure is

  constructor(at: (column: number, row: number) => number, private readonly left: number, private readonly top: number, right: number, bottom: number) {
    this.columns = right - left + 1 + 2 * RELIEF_CELLS;
    const rows = bottom - top + 1 + 2 * RELIEF_CELLS;
    this.z = Float64Array.from({ length: this.columns * rows }, (_, i) => at(left - RELIEF_CELLS + (i % this.columns), top - RELIEF_CELLS + Math.floor(i / this.columns)));
    this.departures = new Float64Array(this.z.length).fill(-1);
    this.rises = new Float64Array(this.z.length);
  }

  std(column: number, row: number): number {
    const middle = (row - this.top + RELIEF_CELLS) * this.columns + column - this.left + RELIEF_CELLS;
    let [count, squares] = [0, 0];
    this.around(middle, ROUGH_OVER_CELLS, (i) => {
      count += 1;
      squares += this.departure(i);
    });
    let [highest, lowest, toHole] = [-Infinity, Infinity, Infinity];
    this.around(middle, RELIEF_CELLS, (i) => {
      highest = Math.max(highest, this.z[i]);
      lowest = Math.min(lowest, this.z[i]);
    }, (x, y) => (toHole = Math.min(toHole, Math.hypot(x, y))));
    const beside = toHole <= RELIEF_CELLS ? Math.exp(-toHole / HOLE_CELLS) : 0;
    this.departure(middle);
    return Math.hypot(OF_ROUGHNESS * Math.sqrt(squares / Math.max(count, 1)), PLACE_CELLS * this.rises[middle], OF_RELIEF * Math.max(highest - lowest, 0) * beside);
  }

  /** Mean square of what the known heights within ROUGH_CELLS depart from a plane. */
  private departure(middle: number): number {
    if (this.departures[middle] < 0) {
      const cells: Vector[] = [];
      this.around(middle, ROUGH_CELLS, (i, x, y) => cells.push([x, y, this.z[i]]));
      const [height, right, down] = planeThrough(cells, 1, () => 0.5);
      this.departures[middle] = mean(cells.map(([x, y, value]) => (value - height - right * x - down * y) ** 2));
      this.rises[middle] = Math.hypot(right, down);
    }
    return this.departures[middle];
  }

  private around(middle: number, reach: number, known: (i: number, x: number, y: number) => void, hole?: (x: number, y: number) => void): void {
    for (let y = -reach; y <= reach; y++) {
      for (let x = -reach; x <= reach; x++) {
        const i = middle + y * this.columns + x;
        if (Number.isNaN(this.z[i])) hole?.(x, y);
        else known(i, x, y);
      }
    }
  }
}

/** Height at the middle, and rise to the east and north. */
const planeOf = (cells: Vector[]) => planeThrough(cells, 4, (n, size) => LEAST_SPAN * n ** 3 * size ** 2);
