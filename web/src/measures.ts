// What was measured, kept in the browser: with undo, shared by all tabs of it, and written out for other programs and browsers.

import { poseOf } from "./blocks";
import type { Dive } from "./dive";
import { CoverPoints } from "./coverpoints";
import type { KeptPoints, Kind, Measure } from "./kept";
import { CLICK_STD_PX } from "./measure";

export type { Kind, Measure };

const MOST_UNDONE = 100;
const COLUMNS = ["measure", "frame", "kind", "label", "vertex", "x_px", "y_px", "x_m", "y_m", "z_m", "value", "std", "surface", "surface_std", "volume_l", "volume_std_l", "click_px", "click_m", "note"];

const FORMAT = "stereo-seecolor measures 1";

/** One change, to be taken back: a measure as it was before; null where there was none. */
interface Step {
  id: number;
  before: Measure | null;
}

/** A coordinate on the map, moved by at most 5 µm: never that of a cell's border, where the table's rounding would choose another cell. */
export function offBorders(meters: number): number {
  return (Math.floor(meters * 1e5) + 0.5) / 1e5;
}

export class Measures {
  /** The random points of the map. */
  readonly points: CoverPoints;
  private all: Measure[] = [];
  private readonly steps: Step[] = [];
  private typed = ""; // the field of the last change, where that was typed
  private kept = true; // false in a browser that keeps nothing for files: measures last as long as the page

  constructor(
    private readonly dive: Dive,
    private readonly changed: () => void,
  ) {
    this.all = this.stored();
    this.add(dive.measures ?? [], true);
    this.points = new CoverPoints(`stereo-seecolor/cover/${dive.id}`, dive.cover ?? null, changed);
    window.addEventListener("storage", ({ key }) => {
      if (key !== this.key) return;
      this.all = this.stored(); // another tab of this browser has changed it
      this.changed();
    });
  }

  private get key(): string {
    return `stereo-seecolor/${this.dive.id}`;
  }

  get list(): readonly Measure[] {
    return this.all;
  }

  get canUndo(): boolean {
    return this.steps.length > 0;
  }

  /** Add a measure, or put it in the place of the one with its number. */
  put(measure: Omit<Measure, "id"> & { id?: number }): number {
    const all = this.stored();
    const id = measure.id ?? nextId(all);
    this.change(id, (before) => ({ ...measure, id, key: before?.key ?? newKey(), changed_ms: Date.now() }));
    return id;
  }

  remove(id: number): void {
    this.change(id, () => null);
  }

  /** Keep what is typed, letter by letter; undo takes back all that was typed into a field in one go. */
  write(id: number, key: "label" | "note", typed: string): void {
    const field = `${id} ${key}`;
    const changed = (before: Measure | null) => before && { ...before, [key]: typed, changed_ms: Date.now() };
    if (field === this.typed) this.set(id, changed);
    else this.change(id, changed);
    this.typed = field;
  }

  undo(): void {
    this.typed = "";
    const step = this.steps.pop();
    if (step) this.set(step.id, () => step.before && { ...step.before, changed_ms: Date.now() });
  }

  private change(id: number, to: (before: Measure | null) => Measure | null): void {
    this.typed = "";
    this.steps.push({ id, before: this.stored().find((each) => each.id === id) ?? null });
    if (this.steps.length > MOST_UNDONE) this.steps.shift();
    this.set(id, to);
  }

  /** Change one measure of those that are kept now, whichever tab kept them. */
  private set(id: number, to: (before: Measure | null) => Measure | null): void {
    const all = this.stored();
    const made = to(all.find((each) => each.id === id) ?? null);
    this.keep([...all.filter((each) => each.id !== id), ...(made ? [made] : [])]);
    this.changed();
  }

  private stored(): Measure[] {
    if (!this.kept) return this.all;
    try {
      return JSON.parse(localStorage.getItem(this.key) ?? "[]") as Measure[];
    } catch {
      this.kept = false;
      return this.all;
    }
  }

  private keep(all: Measure[]): void {
    this.all = all.sort((a, b) => a.id - b.id);
    try {
      localStorage.setItem(this.key, JSON.stringify(this.all));
    } catch {
      this.kept = false; // the export still works
    }
  }

  /** Take over measures of another browser: those not known here, and those changed later than here. once: none that was here before, and was deleted. */
  private add(others: Measure[], once: boolean): number {
    const all = this.stored();
    const before = new Set(once ? this.taken() : []);
    let count = 0;
    for (const other of others) {
      const own = all.findIndex((each) => each.key !== undefined && each.key === other.key);
      if (own < 0 ? before.has(other.key ?? "") : (all[own].changed_ms ?? 0) >= (other.changed_ms ?? 0)) continue;
      if (own >= 0) all[own] = { ...other, id: all[own].id };
      else all.push({ ...other, id: all.some((each) => each.id === other.id) ? nextId(all) : other.id });
      count++;
    }
    if (count) this.keep(all);
    if (once && others.length) this.remember([...before, ...others.map((each) => each.key ?? "")]);
    return count;
  }

  /** Measures of the page's own file that were taken over before: what was deleted since does not come back. */
  private taken(): string[] {
    try {
      return JSON.parse(localStorage.getItem(`${this.key}/taken`) ?? "[]") as string[];
    } catch {
      return [];
    }
  }

  private remember(keys: string[]): void {
    try {
      localStorage.setItem(`${this.key}/taken`, JSON.stringify([...new Set(keys)]));
    } catch {
      // nothing can be kept
    }
  }

  /** All of it, for another browser, for ``report``, which shows what lies in OUT/measures.json, and for ``measure``. */
  json(): string {
    return JSON.stringify({ format: FORMAT, dive: this.dive.id, offset_m: this.dive.offset_m, measures: this.all, cover: this.points.content }, null, 1);
  }

  /** Take over what ``json`` wrote; returns how many measures and random points are new or changed. Throws an Error for another file, or one of another dive. */
  load(text: string): number {
    const content = JSON.parse(text) as { format?: string; dive?: string; measures?: Measure[]; cover?: KeptPoints };
    if (content.format !== FORMAT || !Array.isArray(content.measures)) throw new Error("not a file of measures");
    if (content.dive !== this.dive.id) throw new Error("of another dive");
    const count = this.add(content.measures, false);
    this.changed();
    return count + (this.points.take(content.cover) ? this.points.list.length : 0);
  }

  /** A row for each point: what `stereo-seecolor measure` reads. */
  csv(): string {
    const rows = this.all.flatMap((each) =>
      each.points.map((point, i) => [
        ...[each.id, each.frame, each.kind, each.label, i],
        ...(each.frame ? each.places[i].map((pixels) => pixels.toFixed(2)) : ["", ""]),
        ...this.world(each, point).map((meters) => meters.toFixed(6)),
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
  async geojson(): Promise<string> {
    const frames = [...new Set(this.all.map((each) => each.frame).filter(Boolean))];
    const poses = new Map(await Promise.all(frames.map(async (name) => [name, await poseOf(this.dive, name)] as const)));
    const features = this.all.map((each) => {
      const pose = poses.get(each.frame);
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

const nextId = (all: Measure[]) => 1 + Math.max(0, ...all.map((each) => each.id));
const newKey = () => `${Date.now().toString(36)}-${Math.random().toString(36).slice(2)}`;

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
