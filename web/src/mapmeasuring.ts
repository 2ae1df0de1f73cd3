// Measuring on the map, in three dimensions and from above: spots are clicked, dragged, and measured on the terrain at full precision.

import { button, Choice, DoublePress, element } from "./elements";
import type { Dive, Text } from "./dive";
import { Heights } from "./heights";
import type { About } from "./about";
import { planarArea, profile, straightLength, totalStd, type Measured } from "./measure";
import { offBorders, type Kind, type Measure, type Measures } from "./measures";
import type { MeasureTable } from "./measuretable";
import { crossesItself, type Flat, type Vector } from "./outlines";
import { drawProfile } from "./profile";
import { Ground, type Spot } from "./terrain";
import { volumeAbove } from "./volume";

const SVG = "http://www.w3.org/2000/svg";
const CLICK_PX = 0.5;
const NEAR_CELLS = 2;
const LEAST: Record<Kind, number> = { point: 1, length: 2, area: 3 };

/** What was clicked: x, y and, in three dimensions, z; how fine that is, and how large a pixel of the screen. */
export interface Clicked {
  spot_m: number[];
  cell_m: number;
  pixel_m: number;
}

/** What the map's views do for measuring. */
export interface View {
  project: (point_m: number[]) => [number, number] | null;
  at: (clientX: number, clientY: number) => Clicked | null;
  hold: (held: boolean) => void;
}

interface Placed {
  point_m: number[];
  click_m: number;
}

export class MapMeasuring {
  readonly root = element("div", { class: "measuring", hidden: true });
  readonly tool: HTMLElement;
  readonly overlay = document.createElementNS(SVG, "svg");
  readonly ground: Ground;
  private readonly said = element("output", { class: "readout" });
  private readonly chart = element("div", { class: "profile" });
  private readonly finish: HTMLButtonElement;
  private readonly undo: HTMLButtonElement;
  private kind: Kind | "look" = "look";
  private open: Placed[] = [];
  private readonly press = new DoublePress();
  private adding: Promise<void> = Promise.resolve();
  private dragged: { id: number; vertex: number } | null = null;
  private charted = "";

  constructor(
    private readonly about: About,
    private readonly dive: Dive,
    private readonly text: Text,
    private readonly table: MeasureTable,
    private readonly view: View,
  ) {
    const terrain = about.terrain as NonNullable<About["terrain"]>;
    this.ground = new Ground(new Heights(terrain, about.offset_m), terrain.std_m, terrain.correlation_m);
    const kinds = (["look", "point", "length", "area"] as const).map((kind): [string, string] => [kind, text(`measure.${kind}`)]);
    const choice = new Choice(text("measure.click"), kinds, (kind) => this.choose(kind as Kind | "look"));
    choice.show(this.kind);
    this.tool = choice.root;
    this.finish = button(text("measure.finish"), () => void this.end());
    this.undo = button(text("measure.undo"), () => this.stepBack());
    this.root.append(element("div", { class: "toolbar" }, this.finish, this.undo, this.said), element("p", { class: "hint" }, text("measure.map_hint")), this.chart);
    this.overlay.setAttribute("class", "overlay map-overlay");
    this.overlay.addEventListener("pointerdown", (event) => this.down(event));
    this.overlay.addEventListener("pointermove", (event) => void this.drag(event));
    this.overlay.addEventListener("pointerup", () => this.drop());
    table.watch(() => this.draw());
    this.draw();
  }

  get measures(): Measures {
    return this.table.measures;
  }

  /** True where a click measures, and does not look for frames. */
  get isOn(): boolean {
    return this.kind !== "look";
  }

  /** Take over the table of measures, which frames and map share. */
  show(): void {
    this.root.append(this.table.root);
    this.draw();
  }

  /** The terrain's height at a spot, NaN where it is unknown. */
  async height(x_m: number, y_m: number): Promise<number> {
    await this.ground.heights.load([[x_m, y_m]]);
    return this.ground.pick(x_m, y_m, null, 0)?.point_m[2] ?? NaN;
  }

  /** A spot of the map was clicked; the second click of a double click ends the measure. */
  add(clicked: Clicked): Promise<void> {
    const [x, y] = clicked.spot_m.map((value) => value / clicked.pixel_m);
    const again = this.press.again(x, y);
    this.adding = this.adding.then(() => (again ? this.end() : this.addSpot(clicked)));
    return this.adding;
  }

  private async addSpot(clicked: Clicked): Promise<void> {
    const placed = await this.placed(clicked);
    this.said.textContent = placed ? this.where(placed.point_m) : this.text("measure.no_ground");
    if (!placed) return;
    this.open.push(placed);
    if (this.kind === "point") await this.end();
    else this.draw();
  }

  /** Keys that set, end and drop; true where one was meant for measuring. */
  key(event: KeyboardEvent, middle: Clicked | null): boolean {
    if (!this.isOn) return false;
    if (event.key === " ") {
      if (middle) void this.add(middle);
    } else if (event.key === "Enter") void this.end();
    else if (event.key === "Escape") this.clear();
    else if (event.key === "Backspace") this.stepBack();
    else if (event.key === "z" && (event.ctrlKey || event.metaKey)) this.table.measures.undo();
    else return false;
    return true;
  }

  async end(): Promise<void> {
    if (this.kind === "look" || this.open.length < LEAST[this.kind]) return;
    const [kind, open] = [this.kind, this.open];
    this.open = [];
    const made = await this.made(open, kind);
    if (made) this.table.measures.put(made);
    else if (!this.open.length && this.kind === kind) {
      this.open = open; // what was clicked stays: its last corner can be taken back
      this.draw();
    }
  }

  /** Draw everything where the map is now. */
  draw(): void {
    this.undo.disabled = !this.open.length && !this.table.measures.canUndo;
    this.finish.hidden = this.kind === "point";
    this.finish.disabled = this.kind === "look" || this.open.length < LEAST[this.kind];
    const open = this.kind === "look" ? [] : this.shape(this.open.map((each) => each.point_m), this.kind, null);
    this.overlay.replaceChildren(...this.mine.flatMap((each) => this.shape(each.points, each.kind, each.id)), ...open);
    void this.drawChart();
  }

  private get mine(): Measure[] {
    return this.table.measures.list.filter((each) => !each.frame && each.map === this.about.id);
  }

  private choose(kind: Kind | "look"): void {
    this.kind = kind;
    this.root.hidden = kind === "look";
    this.clear();
  }

  private clear(): void {
    this.open = [];
    this.draw();
  }

  private stepBack(): void {
    if (this.open.length) this.open.pop();
    else this.table.measures.undo();
    this.draw();
  }

  /** On the terrain at full precision where it runs there; on the mesh where that stands over or under it. */
  private async placed({ spot_m: [east, north, z], cell_m, pixel_m }: Clicked): Promise<Placed | null> {
    const [x, y] = [east, north].map(offBorders);
    await this.ground.heights.load([[x, y]]);
    const click_m = CLICK_PX * Math.max(pixel_m, this.about.mosaic?.pixel_m ?? 0);
    const found = this.ground.pick(x, y, null, click_m);
    if (z === undefined) return found && { point_m: found.point_m, click_m };
    const near_m = NEAR_CELLS * Math.max(cell_m, this.ground.heights.place.pixel_m) * Math.hypot(1, ...(found?.slope ?? [0]));
    if (found && Math.abs(found.point_m[2] - z) <= near_m) return { point_m: found.point_m, click_m };
    return { point_m: [x, y, z], click_m: Math.max(click_m, cell_m / 2) };
  }

  private async made(placed: Placed[], kind: Kind): Promise<Omit<Measure, "id"> | null> {
    await this.ground.heights.load(placed.map((each) => each.point_m));
    const spots = placed.map(({ point_m: [x, y, z], click_m }) => this.ground.pick(x, y, z, click_m)).filter((spot): spot is Spot => spot !== null);
    if (spots.length < placed.length) return null;
    if (kind === "area" && crossesItself(spots.map((each): Flat => [each.point_m[0], each.point_m[1]]))) {
      this.said.textContent = this.text("measure.crosses");
      return null;
    }
    const [straight, surface, known] = this.values(spots, kind);
    const both = { value: straight.value, std: totalStd(straight, this.dive.calibration_std), surface: surface?.value ?? null, surface_std: surface ? totalStd(surface, this.dive.calibration_std) : null };
    const points = placed.map((each) => each.point_m);
    const volume = kind === "area" && surface ? volumeAbove(this.ground, spots) : null;
    const inLiters = kind === "area" ? { volume_l: volume?.value ?? null, volume_std_l: volume && totalStd(volume, this.dive.calibration_std) } : {};
    return { frame: "", map: this.about.id, kind, label: "", places: [], points, clicks_m: placed.map((each) => each.click_m), known, ...both, ...inLiters };
  }

  private values(spots: Spot[], kind: Kind): [Measured, Measured | null, number] {
    if (kind === "point") return [{ value: spots[0].point_m[2] + this.dive.offset_m[2], std: Math.sqrt(spots[0].covariance[8]), power: 0 }, null, 1];
    if (kind === "area") return [planarArea(spots), ...(this.ground.area(spots) ?? ([null, 1] as [null, number]))];
    return [straightLength(spots), this.ground.length(spots), 1];
  }

  private where(point_m: number[]): string {
    const [x, y, z] = point_m.map((value, i) => (value + this.dive.offset_m[i]).toFixed(3));
    return this.text("measure.place", { x, y, z });
  }

  private down(event: PointerEvent): void {
    const { id, vertex } = (event.target as SVGElement).dataset;
    if (id === undefined || vertex === undefined || this.open.length) return;
    event.stopPropagation();
    this.dragged = { id: Number(id), vertex: Number(vertex) };
    this.overlay.setPointerCapture(event.pointerId);
    this.view.hold(true);
  }

  private async drag(event: PointerEvent): Promise<void> {
    const { dragged } = this;
    if (!dragged) return;
    const old = this.mine.find((each) => each.id === dragged.id);
    const clicked = this.view.at(event.clientX, event.clientY);
    const placed = clicked && (await this.placed(clicked));
    if (!old || !placed) return;
    const all = old.points.map((point_m, i) => (i === dragged.vertex ? placed : { point_m, click_m: old.clicks_m?.[i] ?? 0 }));
    const made = await this.made(all, old.kind);
    if (made && this.dragged) this.table.measures.put({ ...made, id: old.id, label: old.label, note: old.note });
  }

  private drop(): void {
    if (this.dragged) this.view.hold(false);
    this.dragged = null;
  }

  private shape(points: number[][], kind: Kind, id: number | null): SVGElement[] {
    const places = points.map(this.view.project);
    if (!places.length || places.some((place) => place === null)) return [];
    const known = places as [number, number][];
    const line = node(kind === "area" ? "polygon" : "polyline", { points: known.map(String).join(" "), class: id === null ? "line open" : "line" });
    const dots = known.map(([cx, cy], vertex) => node("circle", { cx, cy, r: 6, class: "dot", ...(id === null ? {} : { "data-id": id, "data-vertex": vertex }) }));
    if (id === null) return [line, ...dots];
    const number = node("text", { x: known[0][0] + 10, y: known[0][1] - 8 });
    number.textContent = String(id);
    return [line, ...dots, number];
  }

  private async drawChart(): Promise<void> {
    const last = [...this.mine].reverse().find((each) => each.kind === "length");
    const shown = last ? JSON.stringify(last.points) : "";
    if (shown === this.charted || this.root.hidden) return;
    this.charted = shown;
    this.chart.replaceChildren();
    if (!last) return;
    await this.ground.heights.load(last.points);
    const spots = last.points.map(([x, y, z]) => this.ground.pick(x, y, z, 0)).filter((spot): spot is Spot => spot !== null);
    const line = spots.length > 1 ? this.ground.along(spots) : null;
    const up: Vector = [0, 0, 1];
    if (line && shown === this.charted) drawProfile(this.chart, this.text("measure.profile", { id: last.id }), this.text("measure.profile_along"), profile(line, up));
  }
}

function node(name: string, attributes: Record<string, string | number>): SVGElement {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  return made;
}
