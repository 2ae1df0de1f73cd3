// Heights of the map's terrain at full precision: tiles, loaded as scripts when they are asked for (stereo_seecolor/report/height_code.py).

import type { Place } from "./about";
import { inflated, numbers } from "./codes";
import { script } from "./scripts";
import { seecolor } from "./shared";

const TILE_PX = 512;
const MOST_KEPT = 64;
const MARGIN_CELLS = 18; // of what errors of heights are found from

interface Packed {
  height: number;
  width: number;
  low_m: number;
  step_m: number;
  heights: string;
  gaps?: string;
  sides?: string;
}

interface Tile {
  width: number;
  heights_m: Float32Array;
  gaps: Uint8Array | null;
  sides: Uint8Array | null;
}

const received = new Map<string, Packed>();
seecolor.heights = (name: string, packed: Packed) => received.set(name, packed);

export class Heights {
  private readonly tiles = new Map<string, Tile>();

  constructor(
    readonly place: Place & { tiles: string[] },
    readonly offset_m: number[],
  ) {}

  /** Column and row of a spot in the map's own coordinates; the center of the first cell is (0, 0). */
  cell(x_m: number, y_m: number): [number, number] {
    const { west_m, north_m, pixel_m } = this.place;
    return [(x_m + this.offset_m[0] - west_m) / pixel_m - 0.5, (north_m - y_m - this.offset_m[1]) / pixel_m - 0.5];
  }

  /** x and y of a cell's center. */
  center(column: number, row: number): [number, number] {
    const { west_m, north_m, pixel_m } = this.place;
    return [west_m + (column + 0.5) * pixel_m - this.offset_m[0], north_m - (row + 0.5) * pixel_m - this.offset_m[1]];
  }

  /** Load all that lies around spots, so that ``at`` knows it. */
  async load(spots: number[][]): Promise<void> {
    const cells = spots.map(([x, y]) => this.cell(x, y));
    const bounds = (axis: number) => [Math.min(...cells.map((each) => each[axis])) - MARGIN_CELLS, Math.max(...cells.map((each) => each[axis])) + MARGIN_CELLS].map((each) => Math.floor(each / TILE_PX));
    const [[left, right], [top, bottom]] = [bounds(0), bounds(1)];
    const wanted: Promise<void>[] = [];
    for (let row = top; row <= bottom; row++) {
      for (let column = left; column <= right; column++) wanted.push(this.tile(`${column}_${row}`));
    }
    await Promise.all(wanted);
  }

  /** The height of a cell in the map's own coordinates, NaN where it is unknown. */
  at(column: number, row: number): number {
    const [tile, place] = this.placeOf(column, row);
    return (tile?.heights_m[place] ?? NaN) - this.offset_m[2];
  }

  /** The height of the nearest known cell around a spot that is loaded, within MARGIN_CELLS; NaN where there is none. */
  nearest(x_m: number, y_m: number): number {
    const [column, row] = this.cell(x_m, y_m).map(Math.round);
    let [least, height_m] = [Infinity, NaN];
    for (let down = -MARGIN_CELLS; down <= MARGIN_CELLS; down++) {
      for (let right = -MARGIN_CELLS; right <= MARGIN_CELLS; right++) {
        const [away, found_m] = [Math.hypot(right, down), this.at(column + right, row + down)];
        if (away < least && !Number.isNaN(found_m)) [least, height_m] = [away, found_m];
      }
    }
    return height_m;
  }

  /** Why a cell has no height (Reason of stereo_seecolor/mapping/raster/gaps.py); 0 where it has one, or lies outside of the map. */
  gap(column: number, row: number): number {
    const [tile, place] = this.placeOf(column, row);
    return tile?.gaps?.[place] ?? 0;
  }

  /** Whether the sides of what stands at a cell were seen (stereo_seecolor/mapping/raster/sides.py). */
  side(column: number, row: number): boolean {
    const [tile, place] = this.placeOf(column, row);
    return Boolean((tile?.sides?.[place >> 3] ?? 0) & (128 >> (place & 7)));
  }

  private placeOf(column: number, row: number): [Tile | undefined, number] {
    const tile = this.tiles.get(`${Math.floor(column / TILE_PX)}_${Math.floor(row / TILE_PX)}`);
    const [x, y] = [column % TILE_PX, row % TILE_PX];
    return tile && column >= 0 && row >= 0 && x < tile.width ? [tile, y * tile.width + x] : [undefined, 0];
  }

  private async tile(name: string): Promise<void> {
    if (this.tiles.has(name) || !this.place.tiles.includes(name)) return;
    await script(`page/map/heights/${name}.js`);
    const packed = received.get(name);
    if (!packed) return;
    received.delete(name);
    const { width, low_m, step_m } = packed;
    const heights_m = Float32Array.from(await numbers(packed.heights), (code) => (code ? low_m + (code - 1) * step_m : NaN));
    const [gaps, sides] = await Promise.all([packed.gaps, packed.sides].map((each) => (each ? inflated(each) : null)));
    this.tiles.set(name, { width, heights_m, gaps, sides });
    if (this.tiles.size > MOST_KEPT) this.tiles.delete(this.tiles.keys().next().value as string);
  }
}
