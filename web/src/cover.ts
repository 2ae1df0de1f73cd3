// Cover by random points on the map: each is labelled, and counts give fractions of what was seen with binomial intervals.

import type { About } from "./about";
import { readPoints, textOf, writePoints } from "./coralnet";
import type { CoverPoints } from "./coverpoints";
import type { Dive, Text } from "./dive";
import { button, element, readable, redraw, select } from "./elements";
import type { Heights } from "./heights";
import { labelList, LABELS } from "./labels";
import type { LabelledSpot } from "./kept";
import { quoted, save, type Measures } from "./measures";

const MOST_POINTS = 2000;
const TRIES = 200; // a point on a map of which a two hundredth is known
const Z95 = 1.96;

/** Wilson's interval of 95 % for a fraction (Wilson 1927, J. American Statistical Association 22). */
export function wilson(count: number, of: number): [number, number] {
  const p = count / of;
  const center = (p + Z95 ** 2 / (2 * of)) / (1 + Z95 ** 2 / of);
  const half = (Z95 * Math.sqrt((p * (1 - p)) / of + Z95 ** 2 / (4 * of ** 2))) / (1 + Z95 ** 2 / of);
  return [Math.max(center - half, 0), Math.min(center + half, 1)];
}

export class Cover {
  readonly root = element("div", { class: "cover" });
  /** What labels a point: it stands at the map, so that both are in sight. */
  readonly bar = element("div", { class: "cover cover-bar" });
  private readonly again = element("div", { class: "again" });
  private readonly rows = element("tbody");
  private readonly said = element("output", { class: "readout" });
  private readonly problem = element("output", { class: "readout" });
  private readonly label: HTMLInputElement;
  constructor(
    private readonly about: About,
    private readonly dive: Dive,
    private readonly text: Text,
    private readonly heights: Heights,
    private readonly measures: Measures,
    private readonly changed: (spot_m: [number, number] | null) => void,
  ) {
    const count = element("input", { type: "number", min: 10, max: MOST_POINTS, value: 100, "aria-label": text("cover.count") });
    this.label = element("input", { type: "text", list: "cover-labels", "aria-label": text("cover.label"), placeholder: text("cover.label") });
    this.label.addEventListener("focus", () => this.current && this.changed(this.current));
    this.label.addEventListener("keydown", (event) => event.key === "Enter" && this.give(this.label.value.trim()));
    const names = labelList("cover-labels", LABELS.CATAMI);
    const sets = Object.keys(LABELS).map((name): [string, string] => [name, name]);
    const set = select(text("cover.set"), sets, (name) => names.replaceChildren(...labelList("", LABELS[name]).children));
    const heads = ["label", "points", "cover", "interval"].map((key) => element("th", { scope: "col" }, text(`cover.${key}_head`)));
    this.root.append(
      element("h2", {}, text("cover.title")),
      element("p", { class: "hint" }, text("cover.hint")),
      element("div", { class: "toolbar" }, count, button(text("cover.throw"), () => void this.scatter(Number(count.value))), set),
      element("div", { class: "scroll" }, element("table", { class: "tally" }, element("thead", {}, element("tr", {}, ...heads)), this.rows)),
      element("div", { class: "toolbar" }, button(text("cover.json"), () => save("measures.json", measures.json())), button(text("cover.csv"), () => save("cover_points.csv", this.csv())), ...(about.mosaic ? [button(text("cover.save_coralnet"), () => save("coralnet_points.csv", writePoints(this.points.list, about)))] : []), this.fileField()),
      this.problem,
      element("p", { class: "hint" }, text("cover.json_hint")),
    );
    this.bar.append(
      element("div", { class: "toolbar" }, this.label, names, button(text("measure.undo"), () => this.move(() => this.points.back()), { "aria-label": text("cover.back") }), this.said),
      this.again,
    );
    this.draw();
  }

  private get points(): CoverPoints {
    return this.measures.points;
  }

  /** The point that is to be labelled. */
  get current(): [number, number] | null {
    return this.points.current?.spot_m ?? null;
  }

  /** Points that are evenly distributed over what the map shows. */
  private async scatter(count: number): Promise<void> {
    const { width, height } = this.heights.place;
    const points = new Map<number, LabelledSpot>(); // by cell: none is chosen twice
    const wanted = Math.min(Math.max(Math.round(count) || 0, 1), MOST_POINTS);
    for (let tries = 0; points.size < wanted && tries < TRIES * wanted; tries++) {
      const cell: [number, number] = [Math.floor(Math.random() * width), Math.floor(Math.random() * height)];
      const spot_m = this.heights.center(...cell);
      await this.heights.load([spot_m]);
      if (!Number.isNaN(this.heights.at(...cell))) points.set(cell[1] * width + cell[0], { spot_m, label: "" });
    }
    this.move(() => this.points.replace([...points.values()]));
    this.label.focus({ preventScroll: true });
  }

  /** Change the points, and show the one that is to be labelled now. */
  private move(change: () => void): void {
    change();
    this.changed(this.current);
  }

  private fileField(): HTMLElement {
    const file = element("input", { type: "file", accept: ".csv,text/csv" });
    file.addEventListener("change", () => {
      if (file.files?.[0]) void this.load(file.files[0]);
      file.value = ""; // the same file can be chosen again
    });
    return element("label", { class: "field" }, element("span", {}, this.text("cover.load_coralnet")), file);
  }

  /** The points of CoralNet's table that lie where the map shows the bottom. */
  private async load(file: File): Promise<void> {
    try {
      const all = await readPoints(await textOf(file), this.dive, this.about);
      const known: LabelledSpot[] = [];
      for (const each of all) {
        if (each.spot_m.some(Number.isNaN)) continue;
        await this.heights.load([each.spot_m]);
        const [x, y] = this.heights.cell(...each.spot_m).map(Math.round);
        if (!Number.isNaN(this.heights.at(x, y))) known.push(each);
      }
      this.problem.textContent = this.text("cover.loaded", { count: known.length, total: all.length });
      if (known.length) this.move(() => this.points.replace(known));
    } catch (error) {
      this.problem.textContent = `${file.name}: ${(error as Error).message}`;
    }
  }

  private give(label: string): void {
    if (!this.current || !label) return;
    this.label.value = "";
    this.move(() => this.points.give(label));
  }

  /** Draw the table and the field anew: points were changed, here, in another tab or by a file. */
  draw(): void {
    const given = this.points.list.filter((each) => each.label);
    const counts = new Map<string, number>();
    for (const { label } of given) counts.set(label, (counts.get(label) ?? 0) + 1);
    const percent = (value: number) => readable(100 * value);
    this.rows.replaceChildren(
      ...[...counts].sort((a, b) => b[1] - a[1]).map(([label, count]) => {
        const [low, high] = wilson(count, given.length);
        const cells = [label, `${count}`, `${percent(count / given.length)} %`, this.text("cover.interval", { low: percent(low), high: percent(high) })];
        return element("tr", {}, ...cells.map((cell) => element("td", {}, cell)));
      }),
    );
    const labels = [...counts.keys()].sort();
    redraw(this.again, labels.map((label) => button(label, () => this.give(label), { "aria-label": this.text("cover.again", { label }) })));
    const total = this.points.list.length;
    this.bar.hidden = !total;
    this.said.textContent = total ? this.text("cover.done", { done: given.length, total }) : "";
  }

  private csv(): string {
    const rows = this.points.list.map(({ spot_m, label }, i) => [i + 1, ...spot_m.map((value, axis) => (value + this.dive.offset_m[axis]).toFixed(4)), label]);
    return [["point", "x_m", "y_m", "label"], ...rows].map((row) => row.map(quoted).join(",") + "\r\n").join("");
  }
}
