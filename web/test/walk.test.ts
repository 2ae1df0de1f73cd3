import assert from "node:assert/strict";
import { test } from "node:test";
import { walked } from "../src/walk";

/** Steps, three a byte, as stereo_seecolor/report/mesh_code.py packs them; numbers, the lowest byte of all first. */
const packed = (steps: number[]) => Uint8Array.from({ length: Math.ceil(steps.length / 3) }, (_, i) => (steps[3 * i] ?? 0) + 5 * (steps[3 * i + 1] ?? 0) + 25 * (steps[3 * i + 2] ?? 0));
const named = (far: number[]) => Uint8Array.from([...far, ...far.map(() => 0), ...far.map(() => 0)]);

test("a ring of triangles around a hole closes, and another part shares a vertex with it", () => {
  // as Walk.over gives it for the eight outer cells of 3x3, two triangles each, and a triangle at their last corner
  const steps = [3, 0, 3, 0, 0, 3, 0, 0, 3, 0, 3, 3, 0, 3, 0, 0, 3, 3, 0, 4, 3, 0, 3, 3, 0, 3, 2, 3, 0, 3, 3, 3, 3, 3];
  const order = [0, 1, 4, 5, 2, 8, 6, 9, 3, 12, 7, 13, 10, 11, 14, 15, 16, 17];
  const { indices, beside } = walked(packed(steps), named([0, 0, 0, 1, 1, 0, 0]), 18, 17);
  assert.deepEqual([...beside], [-1, 0, 1, 2, 3, 2, 3, 5, 6, 5, 6, 9, 6, 12, 11, 14, 15, 16]);
  const found = Array.from({ length: 17 }, (_, i) => fromLeast([...indices.subarray(3 * i, 3 * i + 3)].map((index) => order[index])));
  const cells = [0, 1, 2, 4, 6, 8, 9, 10];
  const expected = [...cells.flatMap((a) => [[a, a + 1, a + 4], [a + 1, a + 5, a + 4]]), [15, 16, 17]].map(fromLeast);
  assert.deepEqual(found.sort(), expected.sort());
});

/** A triangle, turned so that its least corner comes first. */
function fromLeast(corners: number[]): string {
  const first = corners.indexOf(Math.min(...corners));
  return [...corners.slice(first), ...corners.slice(0, first)].map((each) => String(each).padStart(2, "0")).join(" ");
}
