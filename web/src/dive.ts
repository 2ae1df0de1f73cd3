// The dive as page/dive.js hands it over.

import type { KeptPoints, Measure } from "./kept";

export interface Geometry {
  focal_px: number;
  cx_left_px: number;
  cx_right_px: number;
  cy_px: number;
  baseline_m: number;
  image_size: [number, number];
}

export type Column = (number | null)[];

/** Upper three rows of a pose in the map, row after row. */
export type Pose = number[];

/** Frames, a thousand. pose: of a frame by its number in the block; null where it is not in the map. */
export interface Block {
  pose: (number: number) => Pose | null;
  plots: Record<string, Record<string, Column>>;
}

/** Where the cameras of a block of frames were, in the map's own coordinates. frames: how many. track: some of their places. */
export interface BlockPlace {
  frames: number;
  low_m: number[];
  high_m: number[];
  track: number[][];
}

export interface Dive {
  format: string;
  id: string;
  blocks: (BlockPlace | null)[]; // of frames; null without any in the map
  offset_m: number[];
  north: boolean; // where the map's y axis points to the north
  area_m2: number | null; // that the map shows
  texts: Record<string, string>;
  calibration: string;
  calibration_std: number; // of a length, relative
  geometry: Geometry | null;
  image_suffix: string;
  shelves: string[]; // each frame's folder in corrected/, if it has folders
  products: string[][];
  shown: number[]; // each frame's products, -1 for none
  names: string[];
  status: string[];
  errors: Record<string, string>;
  problems: string[];
  problems_of: Record<string, number[]>;
  plots: Record<string, string[]>; // the curves of each
  water: Record<string, unknown> | null; // as in water.json, where all frames share one
  measures?: Measure[]; // of OUT/measures.json
  cover?: KeptPoints | null; // of the same
  white_errors: (number | null)[] | null; // of its white point, red and blue over green, relative
}

/** The text of a key with its {names} filled in. */
export function texter(texts: Record<string, string>) {
  return (key: string, values: Record<string, string | number> = {}): string =>
    (texts[key] ?? key).replace(/\{(\w+)\}/g, (whole, name: string) => (name in values ? String(values[name]) : whole));
}

export type Text = ReturnType<typeof texter>;

/** True where the page has this file of a frame. */
export function has(dive: Dive, name: string, product: string): boolean {
  return dive.products[dive.shown[dive.names.indexOf(name)]]?.includes(product) ?? false;
}

/** Where a file of a frame lies. */
export function address(dive: Dive, product: string, name: string, suffix = ".jpg"): string {
  return `page/${product}/${shelf(dive, name)}${encodeURIComponent(name)}${suffix}`;
}

/** The folder of a frame in those of a large dive. */
function shelf(dive: Dive, name: string): string {
  const folder = dive.shelves[dive.names.indexOf(name)];
  return folder ? `${folder}/` : "";
}

/** Where a corrected frame lies at its full size: of a large dive on a shelf of its folder. */
export function fullSize(dive: Dive, name: string): string {
  return `corrected/${shelf(dive, name)}${encodeURIComponent(name)}${dive.image_suffix}`;
}

/** The corrected picture of a frame that a browser can show, small or large; "" where there is none. */
export function picture(dive: Dive, frame: number, product: "thumbnails" | "after"): string {
  const name = dive.names[frame];
  if (has(dive, name, product)) return address(dive, product, name);
  const shown = dive.status[frame] === "ok" && [".png", ".jpg"].includes(dive.image_suffix);
  return shown ? fullSize(dive, name) : "";
}
