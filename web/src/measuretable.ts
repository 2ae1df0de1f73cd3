// All measures of the dive as a table, with labels, notes and files to save: one, shown wherever measuring goes on.

import type { Dive, Text } from "./dive";
import { button, element } from "./elements";
import { Measures, save, type Kind, type Measure } from "./measures";

const SAID_BELOW = 0.95; // of an outline in which the surface is known

export class MeasureTable {
  readonly root = element("div", { class: "measure-table" });
  readonly measures: Measures;
  private readonly list = element("tbody");
  private readonly watchers: (() => void)[] = [];

  constructor(
    dive: Dive,
    private readonly text: Text,
    private readonly look: (name: string) => void,
  ) {
    this.measures = new Measures(dive, () => this.draw());
    const heads = ["label", "kind", "value", "surface", "frame", "note"].map((key) => element("th", { scope: "col" }, text(`measure.${key}_head`)));
    const exports = (["csv", "geojson", "viame"] as const).map((format) =>
      button(text(`measure.${format}`), () => save(`measures${format === "viame" ? "_viame.csv" : `.${format}`}`, this.measures[format]())),
    );
    this.root.append(
      element("div", { class: "scroll" }, element("table", { class: "measures" }, element("thead", {}, element("tr", {}, ...heads, element("td"))), this.list)),
      element("div", { class: "toolbar" }, ...exports),
      element("p", { class: "hint" }, dive.calibration),
    );
    this.draw();
  }

  /** Call when a measure was added, changed or removed. */
  watch(changed: () => void): void {
    this.watchers.push(changed);
  }

  private draw(): void {
    this.list.replaceChildren(...this.measures.list.map((each) => this.row(each)));
    for (const changed of this.watchers) changed();
  }

  private row(each: Measure): HTMLElement {
    const where = element("button", { type: "button", class: "plain" }, each.frame || this.text("tab.map"));
    where.addEventListener("click", () => (each.frame ? this.look(each.frame) : (location.hash = "#map")));
    const cells: (string | Node)[] = [
      this.field(each, "label"),
      `${each.id} ${this.text(`measure.${each.kind}`)}`,
      shown(each.value, each.std, each.kind),
      each.surface === null ? "" : shown(each.surface, each.surface_std ?? NaN, each.kind) + this.partly(each),
      where,
      this.field(each, "note"),
      button("×", () => this.measures.remove(each.id), { "aria-label": this.text("measure.remove", { id: each.id }) }),
    ];
    return element("tr", {}, ...cells.map((cell) => element("td", {}, cell)));
  }

  private partly({ known = 1 }: Measure): string {
    return known < SAID_BELOW ? `, ${this.text("measure.partly", { percent: Math.round(100 * known) })}` : "";
  }

  private field(each: Measure, key: "label" | "note"): HTMLElement {
    const made = element("input", { type: "text", class: key, value: each[key] ?? "", "aria-label": this.text(`measure.${key}_of`, { id: each.id }) });
    made.addEventListener("change", () => this.measures.put({ ...each, [key]: made.value }));
    return made;
  }
}

function shown(value: number, std: number, kind: Kind): string {
  const [factor, unit] = kind === "area" ? (value < 0.1 ? [1e4, "cm²"] : [1, "m²"]) : Math.abs(value) < 1 ? [100, "cm"] : [1, "m"];
  const digits = std > 0 ? Math.max(0, Math.min(4, 1 - Math.floor(Math.log10(std * factor)))) : 3;
  return `${(value * factor).toFixed(digits)} ± ${(std * factor).toFixed(digits)} ${unit}`;
}
