// The white point of the dive's water: the whites within its standard error, and the file of a water with another one.

import type { Dive, Text } from "./dive";
import { button, element } from "./elements";
import { save } from "./measures";

const ERRORS = 2; // standard errors to either side
const UNKNOWN_ERROR = 0.2; // of red or blue over green, where the fit states none
const LUMINANCE = [0.2126, 0.7152, 0.0722];
const SVG = "http://www.w3.org/2000/svg";
const FILTER = "white-point";

/** Two sliders, red and blue against green, and a picture as it would be with that white. */
export class White {
  readonly root = element("div", { class: "white" });
  private readonly matrix = document.createElementNS(SVG, "feColorMatrix");
  private readonly spot = element("output", { class: "readout" });
  private readonly sliders: HTMLInputElement[];

  constructor(
    private readonly dive: Dive,
    private readonly text: Text,
  ) {
    this.sliders = ["red", "blue"].map(() => element("input", { type: "range", min: -ERRORS, max: ERRORS, step: 0.05, value: 0 }));
    const labels = this.sliders.map((slider, i) => {
      slider.addEventListener("input", () => this.draw());
      return element("label", { class: "field" }, element("span", {}, text(i ? "white.blue" : "white.red")), slider);
    });
    const back = button(text("white.fitted"), () => {
      for (const slider of this.sliders) slider.value = "0";
      this.draw();
    });
    const file = button(text("white.save"), () => save("water_white.json", `${JSON.stringify(this.water(), null, 1)}\n`));
    this.root.append(
      this.filter(),
      element("div", { class: "toolbar" }, ...labels, back, file),
      element("p", { class: "hint" }, text("white.hint")),
      this.spot,
    );
  }

  /** Show a frame; a click names its place for ``water --white``. */
  show(stage: HTMLElement, name: string, picture: string): void {
    const image = element("img", { src: picture, alt: name, style: `filter:url(#${FILTER})` });
    image.addEventListener("click", (event) => {
      const box = image.getBoundingClientRect();
      const [width, height] = this.dive.geometry?.image_size ?? [image.naturalWidth, image.naturalHeight];
      const x = Math.floor(((event.clientX - box.left) / box.width) * width);
      const y = Math.floor(((event.clientY - box.top) / box.height) * height);
      this.spot.textContent = this.text("white.spot", { place: quoted(`${name}:${x},${y}`) });
    });
    this.spot.textContent = "";
    stage.replaceChildren(image);
    this.draw();
  }

  /** The white point that the sliders choose, at the level of the fitted one. */
  private get white(): number[] {
    const errors = (this.dive.white_errors ?? []).map((error) => error ?? UNKNOWN_ERROR);
    const [red, blue] = this.sliders.map((slider, i) => Number(slider.value) * errors[i]);
    return this.fitted.map((value, i) => value * Math.exp([red, 0, blue][i] - (red + blue) / 3));
  }

  private get fitted(): number[] {
    return this.dive.water?.white as number[];
  }

  /** The gain of each channel with that white, as bright as before (``with_white`` of the program). */
  private get gains(): number[] {
    const ratios = this.white.map((value, i) => this.fitted[i] / value);
    const brighter = ratios.reduce((sum, ratio, i) => sum + LUMINANCE[i] * ratio, 0);
    return ratios.map((ratio) => ratio / brighter);
  }

  private draw(): void {
    const rows = this.gains.map((gain, i) => [0, 1, 2, 3, 4].map((j) => (i === j ? gain : 0)).join(" "));
    this.matrix.setAttribute("values", [...rows, "0 0 0 1 0"].join(" "));
  }

  /** The file that ``run --water`` takes. What is chosen by eye has no standard error. */
  private water(): object {
    const water = this.dive.water as Record<string, unknown>;
    const brighter = (this.gains[1] * this.white[1]) / this.fitted[1];
    const exposure = typeof water.exposure === "number" ? water.exposure * brighter : null;
    const standard_errors = { ...(water.standard_errors as object), white: [null, null, null] };
    return { format: "stereo-seecolor/water", version: 1, water: { ...water, white: this.white, exposure, standard_errors } };
  }

  private filter(): SVGElement {
    const [svg, filter] = ["svg", "filter"].map((name) => document.createElementNS(SVG, name));
    for (const [key, value] of Object.entries({ width: "0", height: "0", "aria-hidden": "true" })) svg.setAttribute(key, value);
    filter.setAttribute("id", FILTER);
    filter.setAttribute("color-interpolation-filters", "linearRGB"); // gains of light, not of encoded values
    filter.append(this.matrix);
    svg.append(filter);
    return svg;
  }
}

/** A word as a shell takes it. */
function quoted(word: string): string {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replace(/'/g, `'"'"'`)}'`;
}
