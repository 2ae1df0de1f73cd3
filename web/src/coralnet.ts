// CoralNet's annotations, a CSV of points (Name, Row, Column, Label), as spots of the map and back (stereo_seecolor/extras/reef/labelled_points.py).

import type { About } from "./about";
import { poseOf } from "./blocks";
import type { Dive } from "./dive";
import type { LabelledSpot } from "./kept";
import { has } from "./dive";
import { placed, quoted } from "./measures";
import { seecolor } from "./shared";

const MOST_PX = 8000; // a side of a tile of `export --to tiles`
const LABELS = ["label", "label code"]; // as CoralNet exports the column, and as it takes it

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

/** The text of a table as programs write it: UTF-8 or UTF-16, else that of Windows. */
export async function textOf(file: Blob): Promise<string> {
  const bytes = new Uint8Array(await file.arrayBuffer());
  const wide = { "255,254": "utf-16le", "254,255": "utf-16be" }[`${bytes.slice(0, 2)}`];
  try {
    return new TextDecoder(wide ?? "utf-8", { fatal: true }).decode(bytes);
  } catch {
    return new TextDecoder("windows-1252").decode(bytes);
  }
}

/**
 * The points of a table of CoralNet, each once; label is "" where none was given. Their spots are NaN where the frame has no range, or no place on the map.
 * Throws an Error that names the line, where the table or one of its images is not known, or a point has two labels.
 */
export async function readPoints(text: string, dive: Dive, about: About): Promise<LabelledSpot[]> {
  const [head, ...rows] = table(text);
  const place = (wanted: string) => head?.findIndex((each) => each.toLowerCase() === wanted) ?? -1;
  const [name, row, column] = ["name", "row", "column"].map(place);
  const labels = LABELS.map(place).filter((each) => each >= 0);
  if (Math.min(name, row, column, labels.length - 1) < 0) throw new Error("line 1: columns Name, Row, Column and Label are needed");
  const found = new Map<string, LabelledSpot>();
  for (const [i, cells] of rows.entries()) {
    const pixel = [column, row].map((each) => (cells[each] ? Number(cells[each].replace(",", ".")) : NaN)) as [number, number];
    const spot_m = pixel.every((value) => Number.isInteger(value) && value >= 0) && (await spotOf(cells[name] ?? "", pixel, dive, about));
    if (!spot_m) throw new Error(`line ${i + 2}: ${cells[name]}, row ${cells[row]}, column ${cells[column]} is not a pixel of a corrected frame, or of a tile of export --to tiles`);
    const label = labels.map((each) => cells[each]).find(Boolean) ?? "";
    const key = [cells[name], ...pixel].join("\n");
    const before = found.get(key)?.label;
    if (before && label && before !== label) throw new Error(`line ${i + 2}: labels a point as "${label}" that is "${before}" in a line above: leave one, such as those of one annotator`);
    if (!before) found.set(key, { spot_m, label });
  }
  return [...found.values()];
}

/** Where a pixel of a frame or a tile lies on the map; null where there is no such pixel. */
async function spotOf(image: string, [x, y]: [number, number], dive: Dive, about: About): Promise<[number, number] | null> {
  const file = image.replace(/^.*[\\/]/, "");
  const names = [file, file.replace(/\.[^.]*$/, "")]; // names of frames may hold dots
  const frame = names.find((each) => dive.names.includes(each));
  const { geometry: g } = dive;
  if (g && frame !== undefined) {
    if (x >= g.image_size[0] || y >= g.image_size[1]) return null;
    const pose = await poseOf(dive, frame);
    if (!pose) return [NaN, NaN];
    const range_m = has(dive, frame, "ranges") && seecolor.rangesOf ? (await seecolor.rangesOf(dive, frame)).range_m[y * g.image_size[0] + x] : NaN;
    const ray = [(x - g.cx_left_px) / g.focal_px, (y - g.cy_px) / g.focal_px, 1];
    const far = (range_m * about.range_scale) / Math.hypot(...ray);
    const [east_m, north_m] = placed(pose, ray.map((value) => value * far));
    return [east_m, north_m];
  }
  const mosaic = about.mosaic;
  const tile = mosaic && tiles(mosaic.width, mosaic.height).find((each) => names.includes(each.name.slice(0, -4)));
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

/** The cells of a table, between the most usual of its separators; those in quotes may hold separators and lines. */
function table(text: string): string[][] {
  const rows: string[][] = [[]];
  const content = text.replace(/^\uFEFF/, "");
  const head = content.split(/[\r\n]/, 1)[0];
  const separator = [",", ";", "\t"].reduce((most, each) => (head.split(each).length > head.split(most).length ? each : most));
  const cells = new RegExp(` *(?:"((?:[^"]|"")*)" *|([^${separator}\\r\\n]*))(${separator}|\\r?\\n|\\r|$)`, "g");
  for (const [, quotedCell, plain, end] of content.matchAll(cells)) {
    rows[rows.length - 1].push((quotedCell?.replaceAll('""', '"') ?? plain).trim());
    if (end === "") break;
    if (end !== separator) rows.push([]);
  }
  return rows.filter((row) => row.some(Boolean));
}
