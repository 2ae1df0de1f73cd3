// CoralNet's annotations, a CSV of points (Name, Row, Column, Label), as spots of the map and back (stereo_seecolor/extras/reef/labelled_points.py).

import type { About } from "./about";
import { poseOf } from "./blocks";
import type { Dive } from "./dive";
import type { LabelledSpot } from "./kept";
import { has } from "./dive";
import { placed, quoted } from "./measures";
import { seecolor } from "./shared";

const MOST_PX = 8000; // a side of a tile of `export --to tiles`
const LABELS = ["Label", "Label code"]; // as CoralNet exports the column, and as it takes it

interface Tile {
  name: string;
  left: number;
  top: number;
  width: number;
  height: number;
}

/** The tiles of an orthomosaic (windows of stereo_seecolor/extras/export/mosaic_tiles.py). */
export function tiles(width: number, height: number): Tile[] {
  const [x, y] = [width, height].map((size) => {
    const count = Math.ceil(size / MOST_PX);
    return Array.from({ length: count + 1 }, (_, i) => evenRound((size * i) / count));
  });
  return y.slice(1).flatMap((bottom, row) =>
    x.slice(1).map((right, column) => ({ name: `${row}_${column}.png`, left: x[column], top: y[row], width: right - x[column], height: bottom - y[row] })),
  );
}

/** To the nearest whole number, halves to the even one, as numpy does. */
function evenRound(value: number): number {
  const near = Math.round(value);
  return value % 1 === 0.5 && near % 2 ? near - 1 : near;
}

/**
 * The points of a table of CoralNet; label is "" where none was given. Their spots are NaN where the frame has no range.
 * Throws an Error that names the line, where the table or one of its images is not known.
 */
export async function readPoints(text: string, dive: Dive, about: About): Promise<LabelledSpot[]> {
  const [head, ...rows] = table(text);
  const [name, row, column] = ["Name", "Row", "Column"].map((wanted) => head?.indexOf(wanted) ?? -1);
  const label = Math.max(...LABELS.map((wanted) => head?.indexOf(wanted) ?? -1));
  if (Math.min(name, row, column, label) < 0) throw new Error("line 1: columns Name, Row, Column and Label are needed");
  const found: LabelledSpot[] = [];
  for (const [i, cells] of rows.entries()) {
    const pixel = [Number(cells[column]), Number(cells[row])] as [number, number];
    const spot_m = pixel.every((value) => Number.isInteger(value) && value >= 0) && (await spotOf(cells[name], pixel, dive, about));
    if (!spot_m) throw new Error(`line ${i + 2}: ${cells[name]}, row ${cells[row]}, column ${cells[column]} is not a pixel of a frame of the map, or of a tile of export --to tiles`);
    found.push({ spot_m, label: cells[label] ?? "" });
  }
  return found;
}

/** Where a pixel of a frame or a tile lies on the map; null where there is no such pixel. */
async function spotOf(image: string, [x, y]: [number, number], dive: Dive, about: About): Promise<[number, number] | null> {
  const stem = image.replace(/\.[^.]*$/, "");
  const { geometry: g } = dive;
  const pose = await poseOf(dive, stem);
  if (g && pose) {
    if (x >= g.image_size[0] || y >= g.image_size[1]) return null;
    const range_m = has(dive, stem, "ranges") && seecolor.rangesOf ? (await seecolor.rangesOf(dive, stem)).range_m[y * g.image_size[0] + x] : NaN;
    const ray = [(x - g.cx_left_px) / g.focal_px, (y - g.cy_px) / g.focal_px, 1];
    const far = (range_m * about.range_scale) / Math.hypot(...ray);
    const [east_m, north_m] = placed(pose, ray.map((value) => value * far));
    return [east_m, north_m];
  }
  const mosaic = about.mosaic;
  const tile = mosaic && tiles(mosaic.width, mosaic.height).find((each) => each.name === `${stem}.png`);
  if (!mosaic || !tile || x >= tile.width || y >= tile.height) return null;
  return [mosaic.west_m + (tile.left + x + 0.5) * mosaic.pixel_m - about.offset_m[0], mosaic.north_m - (tile.top + y + 0.5) * mosaic.pixel_m - about.offset_m[1]];
}

/** A table of the points as pixels of the tiles, for CoralNet to take. */
export function writePoints(points: readonly LabelledSpot[], about: About): string {
  const mosaic = about.mosaic;
  const all = mosaic ? tiles(mosaic.width, mosaic.height) : [];
  const rows = points.flatMap(({ spot_m, label }) => {
    if (!mosaic) return [];
    const x = Math.floor((spot_m[0] + about.offset_m[0] - mosaic.west_m) / mosaic.pixel_m);
    const y = Math.floor((mosaic.north_m - spot_m[1] - about.offset_m[1]) / mosaic.pixel_m);
    const tile = all.find((each) => x >= each.left && y >= each.top && x < each.left + each.width && y < each.top + each.height);
    return tile ? [[tile.name, y - tile.top, x - tile.left, label]] : [];
  });
  return [["Name", "Row", "Column", "Label"], ...rows].map((row) => row.map(quoted).join(",") + "\r\n").join("");
}

/** The cells of a table; those in quotes may hold commas and lines. */
function table(text: string): string[][] {
  const rows: string[][] = [[]];
  for (const [, quotedCell, plain, end] of text.replace(/^\uFEFF/, "").matchAll(/(?:"((?:[^"]|"")*)"|([^",\r\n]*))(,|\r?\n|\r|$)/g)) {
    rows[rows.length - 1].push(quotedCell?.replaceAll('""', '"') ?? plain.trim());
    if (end === "") break;
    if (end !== ",") rows.push([]);
  }
  return rows.filter((row) => row.some(Boolean));
}
