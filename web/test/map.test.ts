import assert from "node:assert/strict";
import { mock, test } from "node:test";
import type { Dive } from "../src/dive";
import { DoublePress } from "../src/elements";
import { Heights } from "../src/heights";
import { seenFrom, sightings } from "../src/seen";
import { takeBlocks } from "../src/blocks";
import { span } from "../src/squares";

test("cells and their centers agree, with the map's own coordinates", () => {
  const place = { west_m: 500, north_m: 900, pixel_m: 0.02, width: 50, height: 40, tiles: [] };
  const heights = new Heights(place as never, [500, 880, 0]);
  const [x, y] = heights.center(10, 20);
  assert.ok(Math.abs(x - 0.21) < 1e-9 && Math.abs(y - 19.59) < 1e-9);
  heights.cell(x, y).forEach((value, i) => assert.ok(Math.abs(value - [10, 20][i]) < 1e-6));
  assert.ok(Number.isNaN(heights.at(10, 20))); // not loaded
});

test("frames that see a spot, nearest first; none behind the camera or beside the picture", () => {
  const down = (x: number, z: number) => [1, 0, 0, x, 0, -1, 0, 0, 0, 0, -1, z];
  const geometry = { focal_px: 200, cx_left_px: 80, cx_right_px: 80, cy_px: 64, baseline_m: 0.1, image_size: [160, 128] };
  const poses: [string, number[]][] = [["far", down(0, 4)], ["near", down(0, 2)], ["below", down(0, -1)], ["beside", down(3, 2)]];
  const found = seenFrom(geometry as never, poses, [0.1, 0, 0]).sort((a, b) => a.range_m - b.range_m);
  assert.deepEqual(found.map((each) => each.name), ["near", "far"]);
  assert.ok(Math.abs(found[0].x_px - 90) < 1e-9 && Math.abs(found[0].range_m - Math.hypot(2, 0.1)) < 1e-9);
});

test("a second press within 0.4 s at the same place is a double one, a third begins anew", () => {
  let now = 0;
  mock.method(performance, "now", () => now);
  const press = new DoublePress();
  const pressed = (at: number, x: number) => {
    now = at;
    return press.again(x, 0);
  };
  assert.deepEqual([pressed(0, 0), pressed(100, 3), pressed(200, 3)], [false, true, false]);
  assert.deepEqual([pressed(1000, 0), pressed(1500, 0)], [false, false]); // too late
  assert.deepEqual([pressed(3000, 0), pressed(3100, 20)], [false, false]); // elsewhere
  mock.restoreAll();
});

test("only blocks are loaded whose cameras may have seen a spot nearer than those that are found", async () => {
  const down = (x: number) => [1, 0, 0, x, 0, -1, 0, 0, 0, 0, -1, 2];
  const geometry = { focal_px: 200, cx_left_px: 80, cx_right_px: 80, cy_px: 64, baseline_m: 0.1, image_size: [160, 128] };
  const names = Array.from({ length: 4000 }, (_, i) => `f${i}`);
  const place = (x: number) => ({ frames: 1000, low_m: [x, 0, 2], high_m: [x + 1, 0, 2], track: [] });
  const loaded: number[] = [];
  takeBlocks(async (number) => {
    loaded.push(number);
    return { pose: (i) => (i < 20 ? down(number * 3 + i / 1000) : null), plots: {} };
  });
  const dive = { geometry, names, blocks: [place(0), place(3), null, place(90)] } as unknown as Dive;
  assert.deepEqual((await sightings(dive, [3, 0, 0])).map((each) => each.name), Array.from({ length: 12 }, (_, i) => `f${1000 + i}`));
  assert.deepEqual(loaded, [1]); // those of block 0 are farther away than a dozen of block 1
  assert.deepEqual(await sightings(dive, [45, 0, 0]), []);
  assert.deepEqual(loaded, [1]); // none is so near that it may have seen that
});

test("the span of a metric leaves out squares without it", () => {
  assert.deepEqual(span([[0, 0, 1.2, NaN], [0, 1, NaN, NaN], [1, 0, 1.6, 0.1]]), [1.2, 1.6]);
  assert.deepEqual(span([]), [0, 1]);
});
