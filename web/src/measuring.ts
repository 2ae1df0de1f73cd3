// Measuring in a frame: points are clicked on the picture, dragged, and listed with what they measure.

import type { Dive, Text } from "./dive";
import { button, Choice, DoublePress, element, withError } from "./elements";
import { alongSurface, lengthAlong, nearer, offInFrame, pick, planarArea, profile, rangeOf, straightLength, surfaceArea, totalStd, type Pick } from "./measure";
import type { Kind, Measure, Measures } from "./measures";
import type { MeasureTable } from "./measuretable";
import { crossesItself } from "./outlines";
import { drawProfile } from "./profile";
import { ranges, type Ranges } from "./ranges";

const SVG = "http://www.w3.org/2000/svg";
const NEAR_PX = 12;
const MOVED_PX = 5;
const MOST_ZOOM = 16;
const LEAST: Record<Kind, number> = { point: 1, length: 2, area: 3 };

export class Measuring {
  /** The tools, which stand above the picture. */
  readonly tools = element("div", { class: "measuring" });
  /** What stands below it. */
  readonly root = element("div", { class: "measuring" });
  private readonly overlay = document.createElementNS(SVG, "svg");
  private readonly said = element("output", { class: "readout" });
  private readonly chart = element("div", { class: "profile" });
  private readonly undo: HTMLButtonElement;
  private readonly finish: HTMLButtonElement;
  private readonly measures: Measures;
  private kind: Kind = "length";
  private places: [number, number][] = [];
  private dragged: { id: number; vertex: number } | null = null;
  private readonly sheet = element("div", { class: "sheet" });
  private readonly press = new DoublePress();
  private readonly touching = new Map<number, [number, number]>();
  private pressed: { x: number; y: number; moved: boolean } | null = null;
  private zoomed: { scale: number; x: number; y: number } = { scale: 1, x: 0, y: 0 };
  private cursor: [number, number] = [0, 0];
  private frame = "";
  private data: Ranges | null = null;

  constructor(
    private readonly dive: Dive,
    private readonly text: Text,
    private readonly table: MeasureTable,
  ) {
    this.measures = table.measures;
    const kinds = (["point", "length", "area"] as const).map((kind): [string, string] => [kind, text(`measure.${kind}`)]);
    const tool = new Choice(text("measure.tool"), kinds, (kind) => {
      this.kind = kind as Kind;
      this.drop();
    });
    tool.show(this.kind);
    this.finish = button(text("measure.finish"), () => this.end());
    this.undo = button(text("measure.undo"), () => (this.places.length ? this.stepBack() : this.measures.undo()));
    const zoom = element(
      "span",
      { class: "pair" },
      button("+", () => this.zoom(1.5), { "aria-label": text("map.closer") }),
      button("−", () => this.zoom(1 / 1.5), { "aria-label": text("map.farther") }),
    );
    this.tools.append(element("div", { class: "toolbar" }, tool.root, this.finish, this.undo, zoom, this.said));
    this.root.append(element("p", { class: "hint" }, text("measure.hint")), this.chart);
    table.watch(() => this.draw());
    this.overlay.setAttribute("class", "overlay");
    this.overlay.setAttribute("tabindex", "0");
    this.overlay.setAttribute("role", "application");
    this.overlay.setAttribute("aria-label", text("measure.overlay"));
    this.overlay.addEventListener("pointerdown", (event) => this.down(event));
    this.overlay.addEventListener("pointermove", (event) => this.move(event));
    this.overlay.addEventListener("pointerup", (event) => this.up(event));
    this.overlay.addEventListener("pointercancel", (event) => this.leave(event));
    this.overlay.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.overlay.addEventListener("keydown", (event) => this.key(event));
  }

  /** Measure in a frame: its picture goes into the stage, what is drawn over it too. */
  async show(stage: HTMLElement, name: string, source: string): Promise<void> {
    this.drop();
    this.root.append(this.table.root);
    this.frame = name;
    this.data = null;
    const [width, height] = this.dive.geometry?.image_size ?? [1, 1];
    this.cursor = [Math.round(width / 2), Math.round(height / 2)];
    this.overlay.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.sheet.replaceChildren(element("img", { src: source, alt: name, draggable: "false" }), this.overlay);
    stage.replaceChildren(this.sheet);
    this.look(1, 0, 0);
    this.draw();
    const data = await ranges(this.dive, name);
    if (this.frame === name) this.data = data;
  }

  private get geometry() {
    if (!this.dive.geometry) throw new Error("no camera");
    return this.dive.geometry;
  }

  /** The place of the image under the pointer: the center of the top left pixel is (0, 0). */
  private place(event: MouseEvent): [number, number] {
    const box = this.overlay.getBoundingClientRect();
    const [width, height] = this.geometry.image_size;
    return [((event.clientX - box.left) / box.width) * width - 0.5, ((event.clientY - box.top) / box.height) * height - 0.5];
  }

  private down(event: PointerEvent): void {
    this.overlay.focus({ preventScroll: true });
    this.overlay.setPointerCapture(event.pointerId);
    this.touching.set(event.pointerId, [event.clientX, event.clientY]);
    const place = this.place(event);
    const near = (NEAR_PX * this.geometry.image_size[0]) / this.overlay.getBoundingClientRect().width;
    for (const each of this.measures.list.filter((measure) => measure.frame === this.frame)) {
      const vertex = each.places.findIndex(([x, y]) => Math.hypot(x - place[0], y - place[1]) < near);
      if (vertex >= 0 && !this.places.length) {
        this.dragged = { id: each.id, vertex };
        return;
      }
    }
    this.pressed = this.touching.size > 1 ? null : { x: event.clientX, y: event.clientY, moved: false };
  }

  private up(event: PointerEvent): void {
    const { pressed } = this;
    this.leave(event);
    if (!pressed || pressed.moved) return;
    if (this.press.again(event.clientX, event.clientY)) this.end();
    else this.add(this.place(event));
  }

  private leave(event: PointerEvent): void {
    this.touching.delete(event.pointerId);
    this.dragged = this.pressed = null;
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.zoom(Math.exp(-event.deltaY / 500), [event.clientX, event.clientY]);
  }

  /** Zoom by a factor around a place of the window, or the middle of the picture. */
  private zoom(factor: number, around?: [number, number]): void {
    const box = this.sheet.getBoundingClientRect();
    const view = (this.sheet.parentElement ?? this.sheet).getBoundingClientRect();
    const [x, y] = around ?? [view.left + view.width / 2, view.top + view.height / 2];
    const scale = Math.min(Math.max(this.zoomed.scale * factor, 1), MOST_ZOOM);
    const ratio = scale / this.zoomed.scale;
    this.look(scale, x - (x - box.left) * ratio - view.left, y - (y - box.top) * ratio - view.top);
  }

  /** Show the picture enlarged, its corner at a place of the stage: the stage stays full. */
  private look(scale: number, x: number, y: number): void {
    const { clientWidth: width, clientHeight: height } = this.sheet;
    const within = (value: number, size: number) => Math.min(Math.max(value, size * (1 - scale)), 0);
    this.zoomed = { scale, x: within(x, width), y: within(y, height) };
    this.sheet.style.transform = `translate(${this.zoomed.x}px, ${this.zoomed.y}px) scale(${scale})`;
    this.draw();
  }

  /** Two fingers zoom, one pans. */
  private pinch(event: PointerEvent): boolean {
    const before = this.touching.get(event.pointerId);
    if (!before) return false;
    const other = [...this.touching].find(([id]) => id !== event.pointerId)?.[1];
    this.touching.set(event.pointerId, [event.clientX, event.clientY]);
    if (other) {
      const far = ([x, y]: [number, number]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
      this.zoom(far([event.clientX, event.clientY]) / far(before), other);
      return true;
    }
    const { pressed } = this;
    if (!pressed) return false;
    pressed.moved ||= Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) > MOVED_PX;
    if (!pressed.moved) return false;
    this.look(this.zoomed.scale, this.zoomed.x + event.clientX - before[0], this.zoomed.y + event.clientY - before[1]);
    return true;
  }

  private move(event: PointerEvent): void {
    if (!this.dragged && this.pinch(event)) return;
    const place = this.place(event);
    if (this.dragged && this.data) {
      const old = this.measures.list.find((each) => each.id === this.dragged?.id);
      if (!old) return;
      const places = old.places.map((each, i) => (i === this.dragged?.vertex ? place : each));
      const made = this.made(places, old.kind, old.label);
      if (made) this.measures.put({ ...made, id: old.id, note: old.note });
      return;
    }
    this.cursor = place;
    this.sayUnder(place);
  }

  private sayUnder([x, y]: [number, number]): void {
    const found = this.data ? pick(this.data, this.geometry, x, y) : null;
    this.said.textContent = found
      ? `${withError(rangeOf(found).value, totalStd(rangeOf(found), this.dive.calibration_std))} m`
      : this.text("view.unknown");
  }

  private key(event: KeyboardEvent): void {
    const step = event.shiftKey ? 10 : 1;
    const moves: Record<string, [number, number]> = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
    if (event.key in moves) {
      const [width, height] = this.geometry.image_size;
      this.cursor = [
        Math.min(Math.max(this.cursor[0] + moves[event.key][0], 0), width - 1),
        Math.min(Math.max(this.cursor[1] + moves[event.key][1], 0), height - 1),
      ];
      this.sayUnder(this.cursor);
    } else if (event.key === " ") this.add(this.cursor);
    else if (event.key === "Enter") this.end();
    else if (event.key === "Escape") this.drop();
    else if (event.key === "Backspace") this.stepBack();
    else if (event.key === "+") this.zoom(1.5);
    else if (event.key === "-") this.zoom(1 / 1.5);
    else if (event.key === "z" && (event.ctrlKey || event.metaKey)) this.measures.undo();
    else return;
    event.preventDefault();
    this.draw();
  }

  private add(place: [number, number]): void {
    if (!this.data) return;
    const found = pick(this.data, this.geometry, ...place);
    const near_m = found && nearer(this.data, this.geometry, found);
    if (!found || near_m !== null) {
      const step = { far: found?.point_m[2].toFixed(2) ?? "", near: near_m?.toFixed(2) ?? "" };
      this.said.textContent = found ? this.text("measure.step", step) : this.text("view.unknown");
      return;
    }
    this.places.push(place);
    if (this.kind === "point") this.end();
    else this.draw();
  }

  private stepBack(): void {
    this.places.pop();
    this.draw();
  }

  private drop(): void {
    this.places = [];
    this.draw();
  }

  private end(): void {
    const places = this.places;
    if (places.length < LEAST[this.kind]) return;
    if (this.kind === "area" && crossesItself(places)) {
      this.said.textContent = this.text("measure.crosses");
      return;
    }
    this.places = [];
    const made = this.made(places, this.kind, "");
    if (made) this.measures.put(made);
  }

  private made(places: [number, number][], kind: Kind, label: string): Omit<Measure, "id"> | null {
    const { data, geometry } = this;
    if (!data) return null;
    const picks = places.map(([x, y]) => pick(data, geometry, x, y)).filter((each): each is Pick => each !== null);
    if (picks.length < places.length || picks.some((each) => nearer(data, geometry, each) !== null)) return null;
    if (kind === "area" && crossesItself(places)) return null;
    const straight = kind === "point" ? rangeOf(picks[0]) : kind === "length" ? straightLength(picks) : planarArea(picks);
    const [surface, known] =
      kind === "point" ? [null, 1] : kind === "length" ? [lengthAlong(alongSurface(data, geometry, picks), offInFrame), 1] : surfaceArea(data, geometry, picks);
    const points = picks.map((each) => each.point_m);
    const both = { value: straight.value, std: totalStd(straight, this.dive.calibration_std), surface: surface?.value ?? null, surface_std: surface ? totalStd(surface, this.dive.calibration_std) : null };
    return { frame: this.frame, kind, label, places, points, known, ...both };
  }

  private draw(): void {
    if (!this.undo) return; // not yet built
    this.undo.disabled = !this.places.length && !this.measures.canUndo;
    this.finish.disabled = this.places.length < LEAST[this.kind];
    this.finish.hidden = this.kind === "point";
    const here = this.measures.list.filter((each) => each.frame === this.frame);
    this.overlay.replaceChildren(...here.flatMap((each) => this.shape(each.places, each.kind, each.id)), ...this.shape(this.places, this.kind, null));
    if (document.activeElement === this.overlay && this.overlay.matches(":focus-visible")) this.overlay.append(this.cross(this.cursor, "cursor"));
    const last = [...here].reverse().find((each) => each.kind === "length");
    this.drawProfile(last ?? null);
  }

  private shape(places: [number, number][], kind: Kind, id: number | null): SVGElement[] {
    const points = places.map(([x, y]) => `${x + 0.5},${y + 0.5}`).join(" ");
    const line = document.createElementNS(SVG, kind === "area" ? "polygon" : "polyline");
    line.setAttribute("points", points);
    line.setAttribute("class", id === null ? "line open" : "line");
    const dots = places.map((place) => this.cross(place, "dot"));
    const number = document.createElementNS(SVG, "text");
    if (id !== null && places.length) {
      const { scale } = this.zoomed;
      number.setAttribute("x", String(places[0][0] + 8 / scale));
      number.setAttribute("y", String(places[0][1] - 6 / scale));
      number.setAttribute("style", `font-size: ${14 / scale}px; stroke-width: ${3 / scale}px`);
      number.textContent = String(id);
    }
    return [line, ...dots, number];
  }

  private cross([x, y]: [number, number], name: string): SVGElement {
    const dot = document.createElementNS(SVG, "circle");
    dot.setAttribute("cx", String(x + 0.5));
    dot.setAttribute("cy", String(y + 0.5));
    dot.setAttribute("r", String((name === "cursor" ? 7 : 4) / this.zoomed.scale));
    dot.setAttribute("class", name);
    return dot;
  }

  private drawProfile(length: Measure | null): void {
    this.chart.replaceChildren();
    if (!length || !this.data) return;
    const { data, geometry } = this;
    const picks = length.places.map(([x, y]) => pick(data, geometry, x, y)).filter((each): each is Pick => each !== null);
    if (picks.length < 2) return;
    drawProfile(this.chart, this.text("measure.profile", { id: length.id }), this.text("measure.profile_along"), profile(alongSurface(data, geometry, picks)));
  }
}
