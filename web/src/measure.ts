// Points, lengths, areas and profiles on a frame's surface, as picking.py and lengths_and_areas.py of stereo_seecolor/extras/reef compute them (a test compares both).

import type { Geometry } from "./dive";
import { inside, planeThrough, polygonArea, type Flat, type Vector } from "./outlines";
import { STD_BLOCK_PX, type Ranges } from "./ranges";

const HALF_WINDOW_PX = 3;
const LEAST_PIXELS = 10;
const LAYER_GAP = 0.02;
const LAYER_GAP_STDS = 6;
export const CLICK_STD_PX = 0.5; // how well a person hits a point
const OF_RANGE = 0.45;
const OF_MISFIT = 0.3;
const OF_RAMP_PX = 0.35;
const SLOPE_OF_MISFIT = 0.131;
const OF_SLOPES = 0.15;
const OF_STEP = 0.16;
const OF_SQUARES = 5 / 4;
const LEAST_STEP_PX = 8;
const STEP_PX = 8;
const STEP = 0.1;
const STEP_STDS = 6;
const AREA_STEP_PX = 4;
const LEAST_SPAN = 1e-6;

/** A point with its covariance, 3x3, by row. gap_m: difference in depth or height beyond which two points lie on two things. */
export interface Placed {
  point_m: Vector;
  covariance: number[];
  gap_m: number;
}

/** A point of a frame's surface. slope: change of 1 / depth a pixel; slope_std: its standard error. pixel_std_m: of a range of one pixel. */
export interface Pick extends Placed {
  x_px: number;
  y_px: number;
  range_std_m: number;
  pixel_std_m: number;
  slope: [number, number];
  slope_std: number;
}

export interface Measured {
  value: number;
  std: number;
  power: 0 | 1 | 2 | 3; // of lengths, with which it grows: so much of the calibration's error it takes
}

const UNKNOWN: Measured = { value: NaN, std: NaN, power: 2 };

const dot = (a: Vector, b: Vector) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (a: Vector, k: number): Vector => [a[0] * k, a[1] * k, a[2] * k];
const norm = (a: Vector) => Math.sqrt(dot(a, a));
const cross = (a: Vector, b: Vector): Vector => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const middle = (all: Vector[]): Vector => times(all.reduce((sum, each) => [sum[0] + each[0], sum[1] + each[1], sum[2] + each[2]], [0, 0, 0]), 1 / all.length);
const outer = (a: Vector, b: Vector) => a.flatMap((x) => b.map((y) => x * y));
const quadratic = (m: number[], v: Vector) =>
  dot(v, [m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2], m[6] * v[0] + m[7] * v[1] + m[8] * v[2]]);

const product = (a: number[], b: number[]) => a.map((_, k) => [0, 1, 2].reduce((sum, i) => sum + a[k - (k % 3) + i] * b[3 * i + (k % 3)], 0));

/** Standard error by everything together. calibration_std: of a length, relative. */
export const totalStd = ({ value, std, power }: Measured, calibration_std: number) => Math.hypot(std, power * calibration_std * value);

/** The surface at a place of the image that was hit to within click_px; null where nothing was measured around it. */
export function pick(ranges: Ranges, g: Geometry, x_px: number, y_px: number, click_px = CLICK_STD_PX): Pick | null {
  const found = around(ranges, g, x_px, y_px, HALF_WINDOW_PX);
  if (!found) return null;
  const layer = nearestLayer(found.inverse, found.relativeStd);
  const cells = layer.map((i): Vector => [found.dx[i], found.dy[i], found.inverse[i]]);
  const plane = planeThrough(cells, LEAST_PIXELS, (n) => LEAST_SPAN * n ** 3);
  if (!(plane[0] > 0)) return null;
  const far = misfit(ranges, g, x_px, y_px, plane);
  const steep = ((plane[1] ** 2 + plane[2] ** 2) / plane[0] ** 2) * g.focal_px;
  const std = Math.hypot(OF_RANGE * found.relativeStd, OF_MISFIT * far, OF_RAMP_PX * steep) * leverage(cells);
  const ray: Vector = [(x_px - g.cx_left_px) / g.focal_px, (y_px - g.cy_px) / g.focal_px, 1];
  const depth = 1 / plane[0];
  const point_m = times(ray, depth);
  const along = times(point_m, std);
  const byX = minus([depth / g.focal_px, 0, 0], times(ray, depth ** 2 * plane[1]));
  const byY = minus([0, depth / g.focal_px, 0], times(ray, depth ** 2 * plane[2]));
  const [a, b, c] = [outer(along, along), outer(byX, byX), outer(byY, byY)];
  const covariance = a.map((value, i) => value + click_px ** 2 * (b[i] + c[i]));
  const range_m = norm(point_m);
  const errors = { range_std_m: std * range_m, pixel_std_m: found.relativeStd * range_m, slope_std: SLOPE_OF_MISFIT * far * plane[0] };
  const gap_m = Math.max(LAYER_GAP, LAYER_GAP_STDS * found.relativeStd) * depth;
  return { x_px, y_px, point_m, covariance, gap_m, slope: [plane[1], plane[2]], ...errors };
}

/** Root mean square of what 1 / depth within STEP_PX departs from a plane, as a fraction of it; another layer counts as the beginning of a step. */
function misfit(ranges: Ranges, g: Geometry, x_px: number, y_px: number, [value, bx, by]: Vector): number {
  const found = around(ranges, g, x_px, y_px, STEP_PX);
  if (!found) return 0;
  const most = 2 * Math.max(LAYER_GAP, LAYER_GAP_STDS * found.relativeStd);
  return Math.sqrt(mean(found.inverse.map((each, i) => Math.min(Math.abs(each - value - bx * found.dx[i] - by * found.dy[i]) / value, most) ** 2)));
}

/** How many times as large the standard error of a plane's value at (0, 0) is as with a full window. */
function leverage(cells: Vector[]): number {
  const full = (2 * HALF_WINDOW_PX + 1) ** 2;
  const [n, sx, sy, sxx, sxy, syy] = cells.reduce(([n, a, b, c, d, e], [x, y]) => [n + 1, a + x, b + y, c + x * x, d + x * y, e + y * y], [0, 0, 0, 0, 0, 0]);
  const minor = sxx * syy - sxy * sxy;
  const det = n * minor - sx * (sx * syy - sxy * sy) + sy * (sx * sxy - sxx * sy);
  return n < LEAST_PIXELS || !(det > LEAST_SPAN * n ** 3) ? Math.sqrt(full / n) : Math.sqrt(Math.max((full * minor) / det, 1));
}

/** Offsets from a place, 1 / depth, and the relative standard error of a range, of the known pixels around it. */
function around(ranges: Ranges, g: Geometry, x_px: number, y_px: number, half: number) {
  const column = Math.floor(x_px + 0.5);
  const row = Math.floor(y_px + 0.5);
  if (column < 0 || row < 0 || column >= ranges.width || row >= ranges.height) return null;
  const dx: number[] = [];
  const dy: number[] = [];
  const inverse: number[] = [];
  const relative: number[] = [];
  for (let y = Math.max(row - half, 0); y < Math.min(row + half + 1, ranges.height); y++) {
    for (let x = Math.max(column - half, 0); x < Math.min(column + half + 1, ranges.width); x++) {
      const range = ranges.range_m[y * ranges.width + x];
      if (!(range > 0)) continue;
      dx.push(x - x_px);
      dy.push(y - y_px);
      inverse.push(Math.sqrt(1 + ((x - g.cx_left_px) / g.focal_px) ** 2 + ((y - g.cy_px) / g.focal_px) ** 2) / range);
      const block = Math.floor(y / STD_BLOCK_PX) * Math.ceil(ranges.width / STD_BLOCK_PX) + Math.floor(x / STD_BLOCK_PX);
      const std = ranges.std_m[block] / range;
      if (Number.isFinite(std)) relative.push(std);
    }
  }
  if (inverse.length < LEAST_PIXELS) return null;
  relative.sort((a, b) => a - b);
  return { dx, dy, inverse, relativeStd: relative.length ? relative[relative.length >> 1] : 0 };
}

/** Numbers of the values that belong to the nearest layer that holds enough of them; of the largest where none does. */
function nearestLayer(inverse: number[], relativeStd: number): number[] {
  const order = inverse.map((_, i) => i).sort((a, b) => inverse[b] - inverse[a] || a - b);
  const gap = Math.max(LAYER_GAP, LAYER_GAP_STDS * relativeStd);
  const layers: number[][] = [[order[0]]];
  for (let i = 1; i < order.length; i++) {
    const before = inverse[order[i - 1]];
    if (before - inverse[order[i]] > gap * before) layers.push([]);
    layers[layers.length - 1].push(order[i]);
  }
  return layers.find((layer) => layer.length >= LEAST_PIXELS) ?? layers.reduce((a, b) => (b.length > a.length ? b : a));
}

/** The distance along the ray, with the error of the click. */
export function rangeOf(picked: Pick): Measured {
  const value = norm(picked.point_m);
  return { value, std: Math.sqrt(quadratic(picked.covariance, times(picked.point_m, 1 / value))), power: 1 };
}

/** Twice the variance that errors (covariance) of a vector of a size add to that size where they lie across it, which count squared over twice the size. Of the largest of several OF_SQUARES counts, since squares of errors have long tails; those of a sum of many are short. */
function squared(covariance: number[], unit: Vector, size: number): number {
  const across = outer(unit, unit).map((value, i) => (i % 4 ? 0 : 1) - value);
  const spread = product(product(across, covariance), across);
  const most = Math.max(size ** 2, spread[0] + spread[4] + spread[8]);
  return most > 0 ? spread.reduce((sum, value) => sum + value ** 2, 0) / most : 0;
}

/** Length of the straight lines through points. */
export function straightLength(picks: Placed[]): Measured {
  const steps = picks.slice(1).map((each, i) => minus(each.point_m, picks[i].point_m));
  const lengths = steps.map(norm);
  const units = steps.map((step, i) => (lengths[i] > 0 ? times(step, 1 / lengths[i]) : ([0, 0, 0] as Vector)));
  const none: Vector = [0, 0, 0];
  const variance = picks.reduce((sum, each, i) => sum + quadratic(each.covariance, minus(units[i] ?? none, units[i - 1] ?? none)), 0);
  const both = (i: number) => picks[i].covariance.map((value, k) => value + picks[i + 1].covariance[k]);
  const squares = steps.map((_, i) => squared(both(i), units[i], lengths[i]));
  const across = 0.5 * squares.reduce((sum, each) => sum + each, 0) + (OF_SQUARES ** 2 - 0.5) * Math.max(0, ...squares);
  const value = lengths.reduce((a, b) => a + b, 0);
  return { value, std: Math.sqrt(variance + across), power: 1 };
}

/** Length of a line of points on a surface; parts that cross a step carry a part of it in the standard error. off: how far a point lies off the plane of the surface at another. */
export function lengthAlong<P extends Placed>(line: P[], off: (a: P, b: P) => number): Measured {
  const straight = straightLength(line);
  const steps = line
    .slice(1)
    .map((b, i) => [Math.min(off(line[i], b), off(b, line[i])), Math.max(line[i].gap_m, b.gap_m)])
    .map(([off_m, gap_m]) => (off_m > gap_m ? off_m : 0));
  return { ...straight, std: Math.hypot(straight.std, OF_STEP * Math.hypot(...steps)) };
}

/** How far another point of a frame lies off the plane of the surface at one, in depth. */
export function offInFrame(a: Pick, b: Pick): number {
  const depth = b.point_m[2];
  return Math.abs(1 / depth - 1 / a.point_m[2] - a.slope[0] * (b.x_px - a.x_px) - a.slope[1] * (b.y_px - a.y_px)) * depth ** 2;
}

/** Points of the surface along the lines between picked ones. */
export function alongSurface(ranges: Ranges, g: Geometry, picks: Pick[]): Pick[] {
  const line = [picks[0]];
  for (let k = 1; k < picks.length; k++) {
    const [a, b] = [picks[k - 1], picks[k]];
    const pixel_m = Math.max(Math.min(a.point_m[2], b.point_m[2]) / g.focal_px, 1e-9);
    const step = Math.max(LEAST_STEP_PX, (STEP_STDS * Math.max(a.pixel_std_m, b.pixel_std_m)) / pixel_m);
    const count = Math.max(1, Math.floor(Math.hypot(b.x_px - a.x_px, b.y_px - a.y_px) / step));
    for (let i = 1; i < count; i++) {
      const between = pick(ranges, g, a.x_px + ((b.x_px - a.x_px) * i) / count, a.y_px + ((b.y_px - a.y_px) * i) / count, 0);
      if (between) line.push(between);
    }
    line.push(b);
  }
  return line;
}

/** Distance along the straight line from first to last point, and height above it, towards the camera or along ``above``. */
export function profile(line: Placed[], above: Vector | null = null): [number[], number[]] {
  const points = line.map((each) => each.point_m);
  const chord = minus(points[points.length - 1], points[0]);
  const along = times(chord, norm(chord) > 0 ? 1 / norm(chord) : 0);
  let up = above ?? times(middle(points), -1);
  up = minus(up, times(along, dot(up, along)));
  up = times(up, 1 / Math.max(norm(up), 1e-12));
  const offsets = points.map((point) => minus(point, points[0]));
  return [offsets.map((offset) => dot(offset, along)), offsets.map((offset) => dot(offset, up))];
}

/** Area of the polygon through points, seen along its mean normal. */
export function planarArea(picks: Placed[]): Measured {
  const points = picks.map((each) => each.point_m);
  const center = middle(points);
  const edges = points.map((point) => minus(point, center));
  const next = (i: number) => (i + 1) % points.length;
  const before = (i: number) => (i + points.length - 1) % points.length;
  const sum = edges.reduce<Vector>((total, edge, i) => minus(total, times(cross(edge, edges[next(i)]), -0.5)), [0, 0, 0]);
  const value = norm(sum);
  if (value === 0) return { value: 0, std: NaN, power: 2 };
  const unit = times(sum, 1 / value);
  const axes: Vector[] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const covariance = picks.reduce((total, each, i) => {
    const chord = minus(points[next(i)], points[before(i)]);
    const turned = axes.map((axis) => times(cross(chord, axis), 0.5)); // rows of by how much of the vector the corner's shift changes
    const own = product(product(turned.flat(), each.covariance), axes.flatMap((_, k) => turned.map((row) => row[k])));
    return total.map((value, k) => value + own[k]);
  }, new Array<number>(9).fill(0));
  return { value, std: Math.sqrt(quadratic(covariance, unit) + OF_SQUARES ** 2 * squared(covariance, unit, value)), power: 2 };
}

/** Area of the surface inside the outline of points, and the fraction of it that is known. */
export function surfaceArea(ranges: Ranges, g: Geometry, picks: Pick[]): [Measured, number] {
  const areas: number[] = [];
  const outline = picks.map((each): Flat => [each.x_px, each.y_px]);
  const [xs, ys] = [0, 1].map((axis) => outline.map((place) => place[axis]));
  const first = (values: number[]) => Math.ceil(Math.min(...values) / AREA_STEP_PX) * AREA_STEP_PX;
  let [total, relative, added] = [0, 0, 0];
  for (let y = first(ys); y <= Math.max(...ys); y += AREA_STEP_PX) {
    for (let x = first(xs); x <= Math.max(...xs); x += AREA_STEP_PX) {
      if (!inside(outline, x, y)) continue;
      total += 1;
      const found = pick(ranges, g, x, y);
      if (!found) continue;
      const [area, bySlope] = pixelArea(found, g);
      areas.push(area);
      added += bySlope;
      relative += found.range_std_m / norm(found.point_m);
    }
  }
  const known = areas.length;
  if (!known) return [UNKNOWN, 0];
  const value = mean(areas) * polygonArea(outline);
  const planar = planarArea(picks);
  const byRange = (2 * relative) / known / Math.sqrt(Math.max(1, (known * AREA_STEP_PX ** 2) / (2 * HALF_WINDOW_PX + 1) ** 2));
  const bySlopes = (OF_SLOPES * added) / known / mean(areas);
  const std = value * Math.hypot(planar.std / planar.value, byRange, bySlopes, unseenStd(areas, known / total));
  return [{ value, std, power: 2 }, known / total];
}

export const mean = (values: number[]) => values.reduce((a, b) => a + b, 0) / values.length;

/** Relative standard error of a mean of positive values of which a part was not seen, which may differ by their deviation. */
export function unseenStd(values: number[], known: number): number {
  const middle = mean(values);
  return ((1 - known) * Math.sqrt(mean(values.map((each) => (each - middle) ** 2)))) / middle;
}

/** Depth of a nearer surface within STEP_PX of a point, as beside a fish or a coral; null where there is none. */
export function nearer(ranges: Ranges, g: Geometry, picked: Pick): number | null {
  const found = around(ranges, g, picked.x_px, picked.y_px, STEP_PX);
  if (!found) return null;
  const off = (i: number) => 1 / picked.point_m[2] + picked.slope[0] * found.dx[i] + picked.slope[1] * found.dy[i];
  const limit = Math.max(STEP, LAYER_GAP_STDS * found.relativeStd);
  const near = found.inverse.filter((value, i) => value - off(i) > limit * off(i)).sort((a, b) => a - b);
  const half = near.length >> 1;
  return near.length >= LEAST_PIXELS ? 1 / (near.length % 2 ? near[half] : (near[half - 1] + near[half]) / 2) : null;
}

/** The area that a pixel sees, and what errors of the slopes had added to it, to second order. */
function pixelArea(found: Pick, g: Geometry): [number, number] {
  const depth = found.point_m[2];
  const [bx, by] = found.slope;
  const [x, y] = [found.x_px - g.cx_left_px, found.y_px - g.cy_px];
  const k: Vector = [bx * g.focal_px, by * g.focal_px, 1 / depth - bx * x - by * y];
  const size = norm(k);
  const bySlope: Vector[] = [[g.focal_px, 0, -x], [0, g.focal_px, -y]];
  const curvature = bySlope.reduce((sum, each) => sum + dot(each, each) - (dot(each, k) / size) ** 2, 0);
  const added = (0.5 * found.slope_std ** 2 * curvature) / size;
  const scale = depth ** 3 / g.focal_px ** 2;
  return [scale * (size - added), scale * added];
}
