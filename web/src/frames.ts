// The frames of the dive: filters, one frame large, and the strip of all.

import { block, placeOf } from "./blocks";
import { fullSize, picture, type Dive, type Text } from "./dive";
import { button, element, readable, select } from "./elements";
import type { MeasureTable } from "./measuretable";
import { Strip } from "./strip";
import { Viewer } from "./viewer";

const LEAST_SHOWN = 0.001;

export class Frames {
  private readonly strip: Strip;
  private readonly viewer: Viewer;
  private readonly title = element("h2", { class: "frame-name" });
  private readonly about = element("div", { class: "about" });
  private readonly count = element("span", { class: "count", role: "status" });
  private status = "all";
  private problem = -1;
  private current = -1;

  constructor(
    section: HTMLElement,
    private readonly dive: Dive,
    private readonly text: Text,
    private readonly chosen: (name: string) => void,
    table: MeasureTable,
  ) {
    this.viewer = new Viewer(dive, text, table);
    this.strip = new Strip(dive, text("frames.strip"), (frame) => chosen(dive.names[frame]));
    const previous = button("‹", () => this.step(-1), { "aria-label": text("frames.previous"), class: "step" });
    const next = button("›", () => this.step(1), { "aria-label": text("frames.next"), class: "step" });
    section.append(
      element("div", { class: "toolbar" }, ...this.filters(), this.count),
      this.strip.root,
      element("div", { class: "frame-head" }, previous, next, this.title, this.viewer.choices),
      this.viewer.root,
      this.about,
    );
    this.filter();
  }

  /** Look at a frame; without a name at the first that went through. */
  show(name: string): void {
    const found = this.dive.names.indexOf(name);
    const first = this.dive.status.indexOf("ok");
    this.current = found >= 0 ? found : Math.max(first, 0);
    const shown = this.dive.names[this.current] ?? "";
    this.title.textContent = shown;
    this.viewer.show(shown, this.text(`frames.${this.dive.status[this.current]}`));
    this.strip.choose(this.current);
    this.describe(shown);
  }

  private describe(name: string): void {
    const said = [this.dive.errors[this.current], ...(this.dive.problems_of[this.current] ?? []).map((i) => this.dive.problems[i])];
    const lines = [...new Set(said.filter(Boolean))].map((line) => element("li", {}, line as string));
    this.about.replaceChildren();
    if (lines.length) this.about.append(element("ul", { class: "said" }, ...lines));
    const facts = element("dl", { class: "facts small" });
    this.about.append(facts);
    void this.describeNumbers(facts);
    if (this.dive.status[this.current] === "ok") {
      this.about.append(element("a", { href: fullSize(this.dive, name) }, this.text("frames.open_full")));
    }
  }

  private async describeNumbers(facts: HTMLElement): Promise<void> {
    const [number, place] = placeOf(this.current);
    if (!this.dive.blocks.length) return;
    const { plots } = await block(number);
    const numbers = Object.entries(plots).flatMap(([plot, curves]) => {
      const values = Object.values(curves);
      const value = values.length === 1 ? values[0][place] : null;
      return value === null || value === undefined
        ? []
        : [element("div", {}, element("dt", {}, this.text(`plots.${plot}`)), element("dd", {}, Math.abs(value) < LEAST_SHOWN && value !== 0 ? `< ${LEAST_SHOWN}` : readable(value, 4)))];
    });
    facts.replaceChildren(...numbers);
  }

  private filters(): HTMLElement[] {
    const statuses = ["ok", "failed", "pending", "unpaired"].filter((status) => this.dive.status.includes(status));
    const byStatus = select(
      this.text("frames.status"),
      [["all", this.text("frames.all")], ...statuses.map((status): [string, string] => [status, this.text(`frames.${status}`)])],
      (status) => {
        this.status = status;
        this.filter();
      },
    );
    const byProblem = select(
      this.text("frames.warning"),
      [["-1", this.text("frames.any_warning")], ...this.dive.problems.map((what, i): [string, string] => [String(i), what])],
      (number) => {
        this.problem = Number(number);
        this.filter();
      },
    );
    return this.dive.problems.length ? [byStatus, byProblem] : statuses.length > 1 ? [byStatus] : [];
  }

  private filter(): void {
    const fits = (frame: number) =>
      (this.status === "all" || this.dive.status[frame] === this.status) &&
      (this.problem < 0 || (this.dive.problems_of[frame] ?? []).includes(this.problem));
    const shown = this.dive.names.map((_, frame) => frame).filter(fits);
    this.count.textContent = shown.length
      ? this.text("frames.count", { shown: shown.length, total: this.dive.names.length })
      : this.text("frames.none");
    this.strip.show(shown);
    if (shown.length && !shown.includes(this.current) && this.current >= 0) this.chosen(this.dive.names[shown[0]]);
  }

  private step(step: number): void {
    const next = this.strip.neighbor(step);
    if (next >= 0) this.chosen(this.dive.names[next]);
  }

  /** Load the neighbors' pictures before they are asked for. */
  preload(): void {
    for (const step of [-1, 1]) {
      const frame = this.strip.neighbor(step);
      const source = frame >= 0 ? picture(this.dive, frame, "after") : "";
      if (source) new Image().src = source;
    }
  }
}
