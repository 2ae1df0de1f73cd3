import assert from "node:assert/strict";
import { test } from "node:test";
import type { About } from "../src/about";
import { readPoints, tiles, writePoints } from "../src/coralnet";
import type { Dive } from "../src/dive";

const ABOUT = { offset_m: [5, -3, 0], range_scale: 1, mosaic: { width: 9001, height: 50, west_m: 100, north_m: 40, pixel_m: 0.01 } } as unknown as About;
const DIVE = { names: [], blocks: [], geometry: null } as unknown as Dive;

test("tiles are those of export --to tiles: halves go to the even pixel, as in numpy", () => {
  assert.deepEqual(tiles(9001, 50).map(({ name, left, width }) => [name, left, width]), [["0_0.png", 0, 4500], ["0_1.png", 4500, 4501]]);
  assert.equal(tiles(8000, 16001).length, 3);
});

test("points that are written for CoralNet come back to half a pixel, with their labels", async () => {
  const points = [{ spot_m: [100.123, 42.7] as [number, number], label: 'a "b", c' }, { spot_m: [180.4, 42.51] as [number, number], label: "" }];
  const found = await readPoints(writePoints(points, ABOUT), DIVE, ABOUT);
  assert.deepEqual(found.map(({ label }) => label), points.map(({ label }) => label));
  found.forEach(({ spot_m }, i) => spot_m.forEach((value, axis) => assert.ok(Math.abs(value - points[i].spot_m[axis]) <= 0.005 + 1e-9)));
});

test("what cannot be used is named", async () => {
  await assert.rejects(readPoints("Name,Row\n", DIVE, ABOUT), /line 1: columns Name, Row, Column and Label/);
  await assert.rejects(readPoints("Name,Row,Column,Label\n0_0.png,50,3,a\n", DIVE, ABOUT), /line 2: 0_0.png, row 50, column 3 is not a pixel/);
});
