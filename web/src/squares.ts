// The metrics of the reef, square by square, as colors over the map.

import { fromText } from "./codes";
import { css } from "./colors";
import { withError } from "./elements";
import { script } from "./scripts";
import { seecolor } from "./shared";

const ALPHA = 0.5;
const LEAST_TEXT_PX = 44;
const LEAST_ERROR_PX = 90;

/** A square: its center in the map's own coordinates, a metric and its standard error, NaN where unknown. */
export type Square = [x_m: number, y_m: number, value: number, std: number];

const received = new Map<number, Square[]>();
seecolor.squares = (metric: number, content: string) => {
  const values = new Float32Array(fromText(content).buffer);
  received.set(metric, Array.from({ length: values.length / 4 }, (_, i) => [...values.subarray(4 * i, 4 * i + 4)] as Square));
};

/** A metric of all squares (stereo_seecolor/report/map_files.py). */
export async function squaresOf(metric: number): Promise<Square[]> {
  if (!received.has(metric)) await script(`page/map/squares/${metric}.js`);
  return received.get(metric) ?? [];
}

/** Draw a metric of squares with an edge; project: where a spot of the map lies on the canvas. */
export function drawSquares(canvas: HTMLCanvasElement, squares: Square[], edge_m: number, project: (x_m: number, y_m: number) => [number, number] | null): void {
  const scale = devicePixelRatio;
  canvas.width = canvas.clientWidth * scale;
  canvas.height = canvas.clientHeight * scale;
  const context = canvas.getContext("2d");
  if (!context) return;
  context.scale(scale, scale);
  const [low, high] = span(squares);
  const half = edge_m / 2;
  context.font = "600 13px system-ui";
  context.textAlign = "center";
  for (const [x, y, value, std] of squares) {
    const [from, to] = [project(x - half, y + half), project(x + half, y - half)];
    if (Number.isNaN(value) || !from || !to || to[0] < 0 || to[1] < 0 || from[0] > canvas.clientWidth || from[1] > canvas.clientHeight) continue;
    const size = [to[0] - from[0], to[1] - from[1]];
    context.globalAlpha = ALPHA;
    context.fillStyle = css((value - low) / (high - low || 1));
    context.fillRect(from[0] + 1, from[1] + 1, size[0] - 2, size[1] - 2);
    if (size[0] < LEAST_TEXT_PX) continue;
    context.globalAlpha = 1;
    context.lineWidth = 3;
    context.strokeStyle = "rgb(0 0 0 / 65%)";
    context.fillStyle = "#fff";
    const text = withError(value, size[0] < LEAST_ERROR_PX || Number.isNaN(std) ? null : std);
    context.strokeText(text, from[0] + size[0] / 2, from[1] + size[1] / 2);
    context.fillText(text, from[0] + size[0] / 2, from[1] + size[1] / 2);
  }
}

/** Lowest and highest of a metric. */
export function span(squares: Square[]): [number, number] {
  let [low, high] = [Infinity, -Infinity];
  for (const [, , value] of squares) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low <= high ? [low, high] : [0, 1];
}
