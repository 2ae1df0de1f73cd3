// The scale beside a colored map: a bar of its colors with round numbers.

import { css } from "./colors";
import { element } from "./elements";

/** Round numbers between two values, about as many as asked for. */
export function ticks(low: number, high: number, about = 5): number[] {
  const rough = (high - low) / about;
  if (!(rough > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((value) => value >= rough) ?? rough;
  const made: number[] = [];
  for (let value = Math.ceil(low / step - 1e-9) * step; value <= high + step * 1e-6; value += step) made.push(+value.toPrecision(6));
  return made;
}

/** The colors of the terrain's tiles, low to high (OpenCV's cividis). */
export const HEIGHT_COLORS = "#00224e,#123570,#3b496c,#575d6d,#707173,#8a8678,#a59c74,#c3b369,#e1cc55,#fee838";

/** A bar from low to high; near is bright where the colors run the other way round. */
export function scaleBar(low: number, high: number, unit: string, turned: boolean, colors = ""): HTMLElement {
  const stops = colors || Array.from({ length: 17 }, (_, i) => css(turned ? 1 - i / 16 : i / 16)).join(",");
  const marks = ticks(low, high).map((value) =>
    element("span", { class: "tick", style: `left:${(100 * (value - low)) / (high - low || 1)}%` }, String(value)),
  );
  return element(
    "div",
    { class: "scale" },
    element("div", { class: "bar", style: `background:linear-gradient(to right,${stops})` }),
    element("div", { class: "ticks", "aria-hidden": "true" }, ...marks),
    element("div", { class: "unit" }, unit),
  );
}
