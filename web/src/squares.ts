// The metrics of the reef, square by square, as colors over the map.

import type { Squares } from "./about";
import { css } from "./colors";
import { withError } from "./elements";

const ALPHA = 0.5;
const LEAST_TEXT_PX = 44;
const LEAST_ERROR_PX = 90;

/** Draw one metric of all squares; project: where a spot of the world lies on the canvas. */
export function drawSquares(canvas: HTMLCanvasElement, squares: Squares, metric: number, project: (x_m: number, y_m: number) => [number, number] | null): void {
  const scale = devicePixelRatio;
  canvas.width = canvas.clientWidth * scale;
  canvas.height = canvas.clientHeight * scale;
  const context = canvas.getContext("2d");
  if (!context) return;
  context.scale(scale, scale);
  const [low, high] = span(squares, metric);
  const half = squares.edge_m / 2;
  context.font = "600 13px system-ui";
  context.textAlign = "center";
  for (const [number, row] of squares.rows.entries()) {
    const [x, y] = row as [number, number];
    const value = row[2 + metric];
    const [from, to] = [project(x - half, y + half), project(x + half, y - half)];
    if (value === null || !from || !to || to[0] < 0 || to[1] < 0 || from[0] > canvas.clientWidth || from[1] > canvas.clientHeight) continue;
    const size = [to[0] - from[0], to[1] - from[1]];
    context.globalAlpha = ALPHA;
    context.fillStyle = css((value - low) / (high - low || 1));
    context.fillRect(from[0] + 1, from[1] + 1, size[0] - 2, size[1] - 2);
    if (size[0] < LEAST_TEXT_PX) continue;
    context.globalAlpha = 1;
    context.lineWidth = 3;
    context.strokeStyle = "rgb(0 0 0 / 65%)";
    context.fillStyle = "#fff";
    const text = withError(value, size[0] < LEAST_ERROR_PX ? null : squares.std[number][metric]);
    context.strokeText(text, from[0] + size[0] / 2, from[1] + size[1] / 2);
    context.fillText(text, from[0] + size[0] / 2, from[1] + size[1] / 2);
  }
}

/** Lowest and highest of a metric. */
export function span(squares: Squares, metric: number): [number, number] {
  const known = squares.rows.map((row) => row[2 + metric]).filter((value): value is number => value !== null);
  return known.length ? [Math.min(...known), Math.max(...known)] : [0, 1];
}
