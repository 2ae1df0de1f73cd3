// All measures of the dive as a table, with labels, notes and files to save: one, shown wherever measuring goes on.

import type { Dive, Text } from "./dive";
import { button, element, readable, redraw, withError } from "./elements";
import { labelList, LABELS } from "./labels";
import { polygonArea } from "./outlines";
import { Measures, save, type Kind, type Measure } from "./measures";

const SAID_BELOW = 0.95; // of an outline in which the surface is known

/** A row of the table, which stays in the page as long as its measure: what is typed or pressed in it is not lost when another changes. */
interface Row {
  root: HTMLTableRowElement;
  show: (measure: Measure) => void;
}

export class MeasureTable {
  readonly root = element("div", { class: "measure-table" });
  readonly measures: Measures;
  private readonly list = element("tbody");
  private readonly rows = new Map<number, Row>();
  private readonly sums = element("tbody");
  private readonly summed: HTMLElement;
  private readonly problem = element("output", { class: "readout" });
  private readonly watchers: (() => void)[] = [];

  constructor(
    private readonly dive: Dive,
    private readonly text: Text,
    private readonly look: (name: string) => void,
  ) {
    this.measures = new Measures(dive, () => this.draw());
    const heads = ["label", "kind", "value", "surface", "volume", "frame", "note"].map((key) => element("th", { scope: "col" }, text(`measure.${key}_head`)));
    const exports = (["csv", "geojson", "viame"] as const).map((format) =>
      button(text(`measure.${format}`), async () => save(`measures${format === "viame" ? "_viame.csv" : `.${format}`}`, await this.measures[format]())),
    );
    const sumHeads = ["label", "count", "plan", "seen", "outlined"].map((key) => element("th", { scope: "col" }, text(`measure.${key}_head`)));
    this.summed = element("div", { class: "scroll" }, element("table", { class: "tally" }, element("thead", {}, element("tr", {}, ...sumHeads, element("td"))), this.sums));
    this.root.append(
      labelList("labels", Object.values(LABELS).flat()),
      element("div", { class: "scroll" }, element("table", { class: "measures" }, element("thead", {}, element("tr", {}, ...heads, element("td"))), this.list)),
      this.summed,
      element("div", { class: "toolbar" }, ...exports, button(text("measure.json"), () => save("measures.json", this.measures.json())), this.fileField(), this.problem),
      element("p", { class: "hint" }, text("measure.json_hint")),
      element("p", { class: "hint" }, dive.calibration),
    );
    this.draw();
  }

  /** Call when a measure was added, changed or removed. */
  watch(changed: () => void): void {
    this.watchers.push(changed);
  }

  private fileField(): HTMLElement {
    const file = element("input", { type: "file", accept: ".json,application/json" });
    file.addEventListener("change", () => {
      if (file.files?.[0]) void this.load(file.files[0]);
      file.value = ""; // the same file can be chosen again
    });
    return element("label", { class: "field" }, element("span", {}, this.text("measure.load")), file);
  }

  private async load(file: File): Promise<void> {
    try {
      this.problem.textContent = this.text("measure.loaded", { count: this.measures.load(await file.text()) });
    } catch (error) {
      this.problem.textContent = `${file.name}: ${(error as Error).message}`;
    }
  }

  private draw(): void {
    this.drawRows();
    const labels = [...new Set(this.measures.list.map((each) => each.label))].filter(Boolean).sort();
    this.summed.hidden = !labels.length;
    redraw(this.sums, labels.map((label) => this.sum(label)));
    for (const changed of this.watchers) changed();
  }

  private drawRows(): void {
    const listed = new Set(this.measures.list.map((each) => each.id));
    for (const [id, row] of this.rows) {
      if (listed.has(id)) continue;
      row.root.remove();
      this.rows.delete(id);
    }
    this.measures.list.forEach((each, place) => {
      const row = this.rows.get(each.id) ?? this.row(each.id);
      this.rows.set(each.id, row);
      const there = this.list.children[place] ?? null;
      if (there !== row.root) this.list.insertBefore(row.root, there);
      row.show(each);
    });
  }

  /** How often a label was given, and what its areas on the map cover: of what was seen, and of all that is outlined. */
  private sum(label: string): HTMLElement {
    const mine = this.measures.list.filter((each) => each.label === label);
    const plan_m2 = planOf(mine);
    const outlined_m2 = planOf(this.measures.list);
    const percent = (of_m2: number | null) => (plan_m2 && of_m2 ? `${readable((100 * plan_m2) / of_m2)} %` : "");
    const cells = [label, String(mine.length), plan_m2 ? `${readable(plan_m2)} m²` : "", percent(this.dive.area_m2), percent(outlined_m2)];
    const last = mine[mine.length - 1];
    const undo = button(this.text("measure.undo"), () => this.measures.remove(last.id), { "aria-label": this.text("measure.undo_label", { label }) });
    return element("tr", {}, ...[...cells, undo].map((cell) => element("td", {}, cell)));
  }

  private row(id: number): Row {
    const where = element("button", { type: "button", class: "plain" });
    let frame = "";
    where.addEventListener("click", () => (frame ? this.look(frame) : (location.hash = "#map")));
    const [label, note] = [this.field(id, "label"), this.field(id, "note")];
    const [kind, value, surface, volume] = [0, 1, 2, 3].map(() => element("td"));
    const remove = button("×", () => this.measures.remove(id), { "aria-label": this.text("measure.remove", { id }) });
    const cell = (shown: Node) => element("td", {}, shown);
    const show = (each: Measure) => {
      frame = each.frame;
      kind.textContent = `${id} ${this.text(`measure.${each.kind}`)}`;
      value.textContent = shown(each.value, each.std, each.kind);
      surface.textContent = each.surface === null ? "" : shown(each.surface, each.surface_std ?? NaN, each.kind) + this.partly(each);
      volume.textContent = each.volume_l ? `${withError(each.volume_l, each.volume_std_l ?? NaN)} l` : "";
      where.textContent = frame || this.text("tab.map");
      for (const [field, text] of [[label, each.label], [note, each.note ?? ""]] as const) if (field.value !== text) field.value = text;
    };
    return { root: element("tr", {}, cell(label), kind, value, surface, volume, cell(where), cell(note), cell(remove)), show };
  }

  private partly({ known = 1 }: Measure): string {
    return known < SAID_BELOW ? `, ${this.text("measure.partly", { percent: Math.round(100 * known) })}` : "";
  }

  private field(id: number, key: "label" | "note"): HTMLInputElement {
    const made = element("input", { type: "text", class: key, "aria-label": this.text(`measure.${key}_of`, { id }), list: key === "label" ? "labels" : null });
    made.addEventListener("input", () => this.measures.write(id, key, made.value));
    return made;
  }
}

/** The area in plan of outlines on the map, square meters. */
function planOf(measures: readonly Measure[]): number {
  const areas = measures.filter((each) => each.map && each.kind === "area").map((each) => polygonArea(each.points));
  return areas.reduce((a, b) => a + b, 0);
}

function shown(value: number, std: number, kind: Kind): string {
  const [factor, unit] = kind === "area" ? (value < 0.1 ? [1e4, "cm²"] : [1, "m²"]) : Math.abs(value) < 1 ? [100, "cm"] : [1, "m"];
  return `${withError(value, std, factor)} ${unit}`;
}
