// What was measured, kept in the browser: with undo, and written out for other programs.

import type { Dive } from "./dive";
import { CLICK_STD_PX } from "./measure";

export type Kind = "point" | "length" | "area";

/**
 * places: pixels of the rectified left image. points: the same in its camera, meters. value, std: meters or square meters.
 * On the map, frame is "", places are empty and points in the map's own coordinates; clicks_m: how well each was hit.
 */
export interface Measure {
  id: number;
  frame: string;
  map?: string;
  kind: Kind;
  label: string;
  note?: string;
  places: [number, number][];
  points: number[][];
  clicks_m?: number[];
  value: number;
  std: number;
  known?: number; // fraction of an outline in which the surface is known
  surface: number | null;
  surface_std: number | null;
  volume_l?: number | null; // of an area on the map: above the ground around it
  volume_std_l?: number | null;
}

const MOST_UNDONE = 100;
const COLUMNS = ["measure", "frame", "kind", "label", "vertex", "x_px", "y_px", "x_m", "y_m", "z_m", "value", "std", "surface", "surface_std", "volume_l", "volume_std_l", "click_px", "click_m", "note"];

export class Measures {
  private all: Measure[] = [];
  private readonly earlier: string[] = [];
  private typed = ""; // the field of the last change, where that was typed

  constructor(
    private readonly dive: Dive,
    private readonly changed: () => void,
  ) {
    try {
      this.all = JSON.parse(localStorage.getItem(this.key) ?? "[]") as Measure[];
    } catch {
      this.all = []; // a browser that keeps nothing for files: measures last as long as the page
    }
  }

  private get key(): string {
    return `stereo-seecolor/${this.dive.id}`;
  }

  get list(): readonly Measure[] {
    return this.all;
  }

  get canUndo(): boolean {
    return this.earlier.length > 0;
  }

  /** Add a measure, or put it in the place of the one with its number. */
  put(measure: Omit<Measure, "id"> & { id?: number }): number {
    const id = measure.id ?? 1 + Math.max(0, ...this.all.map((each) => each.id));
    const made = { ...measure, id };
    this.change(this.all.some((each) => each.id === id) ? this.all.map((each) => (each.id === id ? made : each)) : [...this.all, made]);
    return id;
  }

  remove(id: number): void {
    this.change(this.all.filter((each) => each.id !== id));
  }

  /** Keep what is typed, letter by letter; undo takes back all that was typed into a field in one go. */
  write(id: number, key: "label" | "note", typed: string): void {
    const field = `${id} ${key}`;
    const to = this.all.map((each) => (each.id === id ? { ...each, [key]: typed } : each));
    if (field === this.typed) this.set(to);
    else this.change(to);
    this.typed = field;
  }

  undo(): void {
    this.typed = "";
    const before = this.earlier.pop();
    if (before !== undefined) this.set(JSON.parse(before) as Measure[]);
  }

  private change(to: Measure[]): void {
    this.typed = "";
    this.earlier.push(JSON.stringify(this.all));
    if (this.earlier.length > MOST_UNDONE) this.earlier.shift();
    this.set(to);
  }

  private set(to: Measure[]): void {
    this.all = to;
    try {
      localStorage.setItem(this.key, JSON.stringify(to));
    } catch {
      // nothing can be kept: the export still works
    }
    this.changed();
  }

  /** A row for each point: what `stereo-seecolor measure` reads. */
  csv(): string {
    const rows = this.all.flatMap((each) =>
      each.points.map((point, i) => [
        ...[each.id, each.frame, each.kind, each.label, i],
        ...(each.frame ? each.places[i].map((pixels) => pixels.toFixed(2)) : ["", ""]),
        ...this.world(each, point).map((meters) => meters.toFixed(5)),
        ...[each.value, each.std, each.surface, each.surface_std, each.volume_l ?? null, each.volume_std_l ?? null].map((value) => (value === null ? "" : value.toPrecision(6))),
        ...[each.frame ? CLICK_STD_PX : "", each.clicks_m?.[i].toFixed(5) ?? "", each.note ?? ""],
      ]),
    );
    return [COLUMNS, ...rows].map((row) => row.map(quoted).join(",") + "\r\n").join("");
  }

  /** A point of the map in the coordinates of its world; of a frame, as it is, in the camera's. */
  private world(each: Measure, point: number[]): number[] {
    return each.frame ? point : point.map((value, i) => value + this.dive.offset_m[i]);
  }

  /** Features in the map's coordinates where the frame is in the map, else in those of the frame's camera. */
  geojson(): string {
    const features = this.all.map((each) => {
      const pose = this.dive.poses[each.frame];
      const onMap = !each.frame || pose;
      const points = each.points.map((point) => (pose ? placed(pose, point).map((value, i) => value + this.dive.offset_m[i]) : this.world(each, point)));
      const shapes = { point: ["Point", points[0]], length: ["LineString", points], area: ["Polygon", [[...points, points[0]]]] };
      const [type, coordinates] = shapes[each.kind];
      const { frame, kind, label, note = "", value, std, surface, surface_std, volume_l = null, volume_std_l = null, known = 1 } = each;
      const axes = onMap ? (this.dive.north ? "map: x east, y north, z up, meters" : "map: z up, where north lies is not known, meters") : "rectified left camera: x right, y down, z forward, meters";
      return { type: "Feature", id: each.id, geometry: { type, coordinates }, properties: { frame, kind, label, note, value, std, surface, surface_std, volume_l, volume_std_l, known, axes } };
    });
    return JSON.stringify({ type: "FeatureCollection", features }, null, 1);
  }

  /** VIAME's detections: a box around the points, the length in millimeters, and head and tail of a length. */
  viame(): string {
    const head = "# 1: Detection or Track-id,2: Video or Image Identifier,3: Unique Frame Identifier,4-7: Img-bbox(TL_x,TL_y,BR_x,BR_y),8: Detection or Length Confidence,9: Target Length (0 or -1 if invalid),10-11+: Repeated Species,Confidence Pairs or Attributes\n";
    const rows = this.all.filter((each) => each.frame).map((each) => {
      const xs = each.places.map(([x]) => x);
      const ys = each.places.map(([, y]) => y);
      const box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)].map((value) => value.toFixed(2));
      const length = each.kind === "length" ? (1000 * each.value).toFixed(2) : "-1";
      const ends = each.kind === "length" ? [each.places[0], each.places[each.places.length - 1]] : [];
      const keypoints = ends.map(([x, y], i) => `(kp) ${i ? "tail" : "head"} ${x.toFixed(2)} ${y.toFixed(2)}`);
      const image = `${each.frame}${this.dive.image_suffix}`;
      const label = each.label || each.kind;
      return [each.id, image, this.dive.names.indexOf(each.frame), ...box, 1, length, label, 1, ...keypoints].map(quoted).join(",") + "\n";
    });
    return head + rows.join("");
  }
}

/** A cell of a table: in quotes where it must be, and never a formula for a spreadsheet. */
export function quoted(value: string | number): string {
  const text = typeof value === "string" && /^[=+@\t]/.test(value) ? `'${value}` : String(value);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** A point of a camera in the world; pose: rotation and position, by row, 3x4. */
export function placed(pose: number[], [x, y, z]: number[]): number[] {
  return [0, 4, 8].map((i) => pose[i] * x + pose[i + 1] * y + pose[i + 2] * z + pose[i + 3]);
}

/** Hand a text to the user as a file. */
export function save(name: string, text: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
