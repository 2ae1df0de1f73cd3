// One frame, large: before and after, range, confidence, mask.

import { address, has, picture, type Dive, type Text } from "./dive";
import { Choice, element } from "./elements";
import { drawConfidence, drawMask, drawRange, limits, MASK_COLORS } from "./layers";
import { Measuring } from "./measuring";
import type { MeasureTable } from "./measuretable";
import { ranges, STD_BLOCK_PX, type Ranges } from "./ranges";
import { scaleBar } from "./scale";
import { slider } from "./slider";
import { White } from "./white";

type View = "compare" | "white" | "measure" | "range" | "confidence" | "mask";

export class Viewer {
  readonly root: HTMLElement;
  private readonly stage = element("div", { class: "stage" });
  private readonly legend = element("div", { class: "legend" });
  private readonly readout = element("output", { class: "readout", "aria-live": "off" });
  private readonly choice: Choice;
  private readonly measuring: Measuring;
  private readonly white: White;
  private view: View = "compare";
  private name = "";

  constructor(
    private readonly dive: Dive,
    private readonly text: Text,
    table: MeasureTable,
  ) {
    this.measuring = new Measuring(dive, text, table);
    this.white = new White(dive, text);
    const views: [View, string][] = [["compare", text("view.compare")]];
    if (dive.water) views.push(["white", text("view.white")]);
    if (dive.geometry) views.push(["measure", text("view.measure")], ["range", text("view.range")], ["confidence", text("view.confidence")], ["mask", text("view.mask")]);
    this.choice = new Choice(text("view.name"), views, (view) => {
      this.view = view as View;
      this.draw();
    });
    this.choice.show(this.view);
    this.root = element("div", { class: "viewer" }, this.measuring.tools, this.white.root, this.stage, this.legend, this.readout, this.measuring.root);
    this.measuring.root.hidden = this.measuring.tools.hidden = this.white.root.hidden = true;
  }

  /** The buttons that choose what is shown. */
  get choices(): HTMLElement {
    return this.choice.root;
  }

  /** Show a frame. */
  show(name: string, status: string): void {
    this.name = name;
    if (this.picture) this.draw();
    else {
      this.stage.replaceChildren(element("p", { class: "empty" }, this.text("frames.no_picture", { status })));
      this.legend.replaceChildren();
      this.readout.textContent = "";
    }
  }

  private get picture(): string {
    return picture(this.dive, this.dive.names.indexOf(this.name), "after");
  }

  private draw(): void {
    this.readout.textContent = "";
    const isMeasured = this.view === "measure" && has(this.dive, this.name, "ranges");
    this.measuring.root.hidden = this.measuring.tools.hidden = !isMeasured;
    this.white.root.hidden = this.view !== "white" || !this.picture;
    this.root.classList.toggle("is-measured", isMeasured);
    if (!this.picture) return;
    if (this.view === "compare") {
      this.legend.replaceChildren();
      if (has(this.dive, this.name, "before")) {
        this.stage.replaceChildren(slider(address(this.dive, "before", this.name), this.picture, this.name, this.text));
      } else {
        this.stage.replaceChildren(element("img", { src: this.picture, alt: this.name }));
        this.legend.textContent = this.text("view.no_before");
      }
    } else if (this.view === "white") {
      this.legend.replaceChildren();
      this.white.show(this.stage, this.name, this.picture);
    } else if (isMeasured) {
      this.legend.replaceChildren();
      void this.measuring.show(this.stage, this.name, this.picture);
    } else void this.drawLayer(this.view, this.name);
  }

  private async drawLayer(view: View, name: string): Promise<void> {
    if (!has(this.dive, name, "ranges")) {
      this.stage.replaceChildren(element("p", { class: "empty" }, this.text("view.no_ranges")));
      this.legend.replaceChildren();
      return;
    }
    this.stage.classList.add("loading");
    const data = await ranges(this.dive, name);
    this.stage.classList.remove("loading");
    if (this.name !== name || this.view !== view) return;
    const canvas = element("canvas", { role: "img", "aria-label": `${this.text(`view.${view}`)}: ${name}` });
    this.legend.replaceChildren();
    if (view === "range") {
      const [low, high] = limits(data);
      drawRange(canvas, data, [low, high]);
      this.legend.append(scaleBar(low, high, this.text("view.range_unit"), true));
    } else if (view === "confidence") {
      drawConfidence(canvas, data);
      this.legend.append(scaleBar(0, 1, this.text("view.confidence_unit"), false));
    } else {
      drawMask(canvas, data);
      this.legend.append(this.maskLegend());
    }
    canvas.addEventListener("pointermove", (event) => this.read(event, canvas, data));
    canvas.addEventListener("pointerleave", () => (this.readout.textContent = ""));
    this.stage.replaceChildren(canvas);
  }

  private maskLegend(): HTMLElement {
    const items = MASK_COLORS.map(([r, g, b], code) =>
      element("li", {}, element("span", { class: "swatch", style: `background:rgb(${r} ${g} ${b})` }), this.text(`mask.${code}`)),
    );
    return element("ul", { class: "swatches" }, ...items);
  }

  private read(event: PointerEvent, canvas: HTMLCanvasElement, data: Ranges): void {
    const box = canvas.getBoundingClientRect();
    const x = Math.floor(((event.clientX - box.left) / box.width) * data.width);
    const y = Math.floor(((event.clientY - box.top) / box.height) * data.height);
    const range = data.range_m[y * data.width + x];
    const block = Math.floor(y / STD_BLOCK_PX) * Math.ceil(data.width / STD_BLOCK_PX) + Math.floor(x / STD_BLOCK_PX);
    this.readout.textContent =
      range > 0 ? this.text("view.cursor", { range: range.toFixed(3), std: (1000 * data.std_m[block]).toFixed(1) }) : this.text("view.unknown");
  }
}
