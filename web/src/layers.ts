// Range, confidence and mask of a frame as pictures.

import { COLORS } from "./colors";
import { OVERLAY_STEP_PX, type Ranges } from "./ranges";

const UNKNOWN = [0, 0, 0, 0];
export const MASK_COLORS = [
  [38, 118, 112, 255],
  [40, 44, 52, 255],
  [224, 170, 62, 255],
  [196, 84, 72, 255],
];

/** Low and high of what is shown: 2nd and 98th percentile of the known ranges. */
export function limits(ranges: Ranges): [number, number] {
  const sample: number[] = [];
  for (let i = 0; i < ranges.range_m.length; i += 7) if (ranges.range_m[i] > 0) sample.push(ranges.range_m[i]);
  sample.sort((a, b) => a - b);
  if (!sample.length) return [0, 1];
  const low = sample[Math.floor(0.02 * (sample.length - 1))];
  const high = sample[Math.ceil(0.98 * (sample.length - 1))];
  return high > low ? [low, high] : [low * 0.99, low * 1.01];
}

/** The range map in colors, near bright; what is unknown is clear. */
export function drawRange(canvas: HTMLCanvasElement, ranges: Ranges, [low, high]: [number, number]): void {
  const scale = 255 / (high - low);
  draw(canvas, ranges.width, ranges.height, (i, pixels) => {
    const range = ranges.range_m[i];
    if (!(range > 0)) return put(pixels, i, UNKNOWN);
    const c = 3 * (255 - Math.round(Math.min(Math.max((range - low) * scale, 0), 255)));
    pixels.set([COLORS[c], COLORS[c + 1], COLORS[c + 2], 255], 4 * i);
  });
}

/** Confidence in colors, certain bright. */
export function drawConfidence(canvas: HTMLCanvasElement, ranges: Ranges): void {
  const [width, height] = overlaySize(ranges);
  draw(canvas, width, height, (i, pixels) => {
    const value = ranges.confidence[i];
    if (!value) return put(pixels, i, UNKNOWN);
    pixels.set([COLORS[3 * value], COLORS[3 * value + 1], COLORS[3 * value + 2], 255], 4 * i);
  });
}

/** The mask in four colors. */
export function drawMask(canvas: HTMLCanvasElement, ranges: Ranges): void {
  const [width, height] = overlaySize(ranges);
  draw(canvas, width, height, (i, pixels) => put(pixels, i, MASK_COLORS[ranges.mask[i]] ?? UNKNOWN));
}

function overlaySize(ranges: Ranges): [number, number] {
  return [Math.ceil(ranges.width / OVERLAY_STEP_PX), Math.ceil(ranges.height / OVERLAY_STEP_PX)];
}

function draw(canvas: HTMLCanvasElement, width: number, height: number, pixel: (i: number, pixels: Uint8ClampedArray) => void): void {
  canvas.width = width;
  canvas.height = height;
  const image = new ImageData(width, height);
  for (let i = 0; i < width * height; i++) pixel(i, image.data);
  canvas.getContext("2d")?.putImageData(image, 0, 0);
}

function put(pixels: Uint8ClampedArray, i: number, color: number[]): void {
  pixels.set(color, 4 * i);
}
