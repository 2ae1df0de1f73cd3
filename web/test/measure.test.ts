import assert from "node:assert/strict";
import { test } from "node:test";
import type { Geometry } from "../src/dive";
import { lengthAlong, nearer, offInFrame, pick, planarArea, profile, rangeOf, straightLength, surfaceArea, totalStd, unseenStd, type Pick, type Placed } from "../src/measure";
import { crossesItself, inside, planeThrough, polygonArea, type Flat, type Vector } from "../src/outlines";
import type { Ranges } from "../src/ranges";

const near = (found: number, expected: number, within = 1e-9) => assert.ok(Math.abs(found - expected) <= within, `${found} for ${expected}`);
const SQUARE: Flat[] = [[0, 0], [2, 0], [2, 2], [0, 2]];
const GEOMETRY: Geometry = { focal_px: 200, cx_left_px: 80, cx_right_px: 80, cy_px: 64, baseline_m: 0.1, image_size: [160, 128] };
const STD_M = 0.004;

/** A point that is known equally well in all directions. */
const ACROSS = 1.25 * Math.SQRT2; // variances in two directions, which count over the length
const at = (point_m: Vector, std_m = 0): Placed => ({ point_m, covariance: [1, 0, 0, 0, 1, 0, 0, 0, 1].map((value) => value * std_m ** 2), gap_m: 0 });

/** Ranges of a surface of this depth at a pixel, meters. */
function seen(depth_m: (x: number, y: number) => number): Ranges {
  const [width, height] = GEOMETRY.image_size;
  const range_m = Float32Array.from({ length: width * height }, (_, i) => {
    const [x, y] = [i % width, Math.floor(i / width)];
    return depth_m(x, y) * Math.hypot(1, (x - GEOMETRY.cx_left_px) / GEOMETRY.focal_px, (y - GEOMETRY.cy_px) / GEOMETRY.focal_px);
  });
  const blocks = Math.ceil(width / 4) * Math.ceil(height / 4);
  return { width, height, range_m, std_m: new Float32Array(blocks).fill(STD_M), confidence: new Uint8Array(), mask: new Uint8Array() };
}

const picked = (ranges: Ranges, x: number, y: number) => {
  const found = pick(ranges, GEOMETRY, x, y);
  assert.ok(found);
  return found;
};

test("a plane is found exactly, and is level where its points lie on a line", () => {
  const cells = SQUARE.map(([x, y]): Vector => [x, y, 3 + 0.5 * x - 0.25 * y]);
  const found = planeThrough(cells, 4, () => 1e-9);
  [3, 0.5, -0.25].forEach((value, i) => near(found[i], value));
  const line = [0, 1, 2, 3].map((x): Vector => [x, 2 * x, x]);
  assert.deepEqual(planeThrough(line, 4, () => 1e-9), [1.5, 0, 0]);
  assert.deepEqual(planeThrough(cells.slice(0, 3), 4, () => 1e-9).slice(1), [0, 0]);
});

test("areas and insides of outlines, whichever way round", () => {
  assert.equal(polygonArea(SQUARE), 4);
  assert.equal(polygonArea([...SQUARE].reverse()), 4);
  assert.ok(inside(SQUARE, 1, 1) && inside([...SQUARE].reverse(), 1, 1));
  assert.ok(!inside(SQUARE, 3, 1) && !inside(SQUARE, 1, -1));
});

test("an outline that crosses itself is told from one that is only bent", () => {
  assert.ok(crossesItself([SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]]));
  assert.ok(!crossesItself(SQUARE));
  assert.ok(!crossesItself([[0, 0], [2, 0], [1, 0.5], [2, 2], [0, 2]]));
});

test("a length and its standard error: of each end, and of a corner on the way by its angle", () => {
  const straight = straightLength([at([0, 0, 1], 0.01), at([3, 4, 1], 0.02)]);
  near(straight.value, 5);
  near(straight.std, Math.hypot(0.01, 0.02, (ACROSS * 0.0005) / 5)); // across the line to second order
  const bent = straightLength([at([0, 0, 1]), at([1, 0, 1], 0.01), at([1, 1, 1])]);
  near(bent.value, 2);
  near(bent.std, Math.hypot(Math.SQRT2 * 0.01, 1e-4, ACROSS * 1e-4));
  const middle = straightLength([at([0, 0, 1]), at([1, 0, 1], 0.01), at([2, 0, 1])]);
  near(middle.std, Math.hypot(1e-4, ACROSS * 1e-4)); // a point that moves along a straight line changes nothing
});

test("the calibration's error grows with the power of the length", () => {
  near(totalStd({ value: 2, std: 0.03, power: 1 }, 0.02), 0.05);
  near(totalStd({ value: 2, std: 0, power: 2 }, 0.01), 0.04);
  near(totalStd({ value: 2, std: 0.03, power: 0 }, 0.5), 0.03);
});

test("the area of an outline is that in its own plane", () => {
  const tilted = planarArea(([[0, 0, 1], [2, 0, 1], [2, 2, 3], [0, 2, 3]] as Vector[]).map((point) => at(point, 0.01)));
  near(tilted.value, 4 * Math.SQRT2);
  assert.ok(tilted.std > 0);
  assert.equal(planarArea(([[0, 0, 1], [1, 1, 1], [2, 2, 1]] as Vector[]).map((point) => at(point))).value, 0);
});

test("heights of a profile are above the line from its first to its last point", () => {
  const [along, heights] = profile([at([0, 0, 0]), at([1, 0, 0.5]), at([2, 0, 0])], [0, 0, 1]);
  assert.deepEqual(along, [0, 1, 2]);
  assert.deepEqual(heights, [0, 0.5, 0]);
});

test("a click on a tilted plane hits it, and on a level one its range is surer than that of a pixel", () => {
  const ranges = seen((x) => 1 / (0.5 + 0.001 * (x - 80)));
  const found = picked(ranges, 100, 64);
  near(found.point_m[2], 1 / 0.52, 1e-5);
  near(found.slope[0], 0.001, 1e-6);
  const level = rangeOf(picked(seen(() => 2), 80, 64));
  near(level.value, 2, 1e-5);
  near(level.std, 0.45 * STD_M, 1e-6);
});

test("what the surface departs from a plane is in the error of a point, and a step in that of a length", () => {
  const wavy = picked(seen((x) => 2 + 0.03 * Math.sin(x)), 80, 64);
  assert.ok(wavy.range_std_m > 3 * picked(seen(() => 2), 80, 64).range_std_m);
  const ends = (depth_m: (x: number) => number) => {
    const ranges = seen(depth_m);
    return [picked(ranges, 40, 64), picked(ranges, 120, 64)];
  };
  const std = (line: Pick[]) => lengthAlong(line, offInFrame).std;
  near(std(ends(() => 2)), straightLength(ends(() => 2)).std, 1e-6);
  near(std(ends((x) => (x < 80 ? 2 : 2.5))), 0.12 * 0.5, 0.02);
});

test("nothing is measured where no range is known", () => {
  const ranges = seen((x) => (x < 80 ? 2 : NaN));
  assert.equal(pick(ranges, GEOMETRY, 120, 64), null);
  assert.equal(pick(ranges, GEOMETRY, -1, 64), null);
});

test("a place beside something near is told by its depth", () => {
  const ranges = seen((x) => (x < 60 ? 1.2 : 2));
  near(nearer(ranges, GEOMETRY, picked(ranges, 64, 64)) ?? NaN, 1.2, 1e-5);
  assert.equal(nearer(ranges, GEOMETRY, picked(ranges, 120, 64)), null);
});

test("the surface of a level outline is its plan, and of a tilted one that of its plane", () => {
  const corners: Flat[] = [[42, 32], [118, 34], [114, 98], [38, 94]];
  const measured = (depth_m: (x: number, y: number) => number) => {
    const ranges = seen(depth_m);
    const picks: Pick[] = corners.map(([x, y]) => picked(ranges, x, y));
    return { surface: surfaceArea(ranges, GEOMETRY, picks), plane: planarArea(picks) };
  };
  for (const depth_m of [() => 2, (x: number) => 1 / (0.5 + 0.001 * (x - 80))]) {
    const { surface, plane } = measured(depth_m);
    near(surface[0].value / plane.value, 1, 0.01);
    assert.equal(surface[1], 1);
  }
});

test("what was not seen adds to an area's error as its parts differ", () => {
  near(unseenStd([1, 1, 1], 0.5), 0);
  near(unseenStd([1, 3], 0.5), 0.25);
  near(unseenStd([1, 3], 1), 0);
});
