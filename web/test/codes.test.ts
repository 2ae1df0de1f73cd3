import assert from "node:assert/strict";
import { test } from "node:test";
import { unpacked } from "../src/codes";
import { fromText } from "../src/ranges";

test("errors of predictions are unpacked from halves of bytes, and large ones from the end", () => {
  const errors = [0, 14, 15, 300, 1, 65535, 7];
  const halves = errors.map((each) => Math.min(each, 15)).concat(0);
  const pairs = [0, 2, 4, 6].map((i) => halves[i] | (halves[i + 1] << 4));
  const large = errors.filter((each) => each >= 15);
  const bytes = Uint8Array.from([...pairs, ...large.map((each) => each & 255), ...large.map((each) => each >> 8)]);
  const planes = unpacked(bytes, errors.length);
  assert.deepEqual(errors.map((_, i) => planes[i] | (planes[errors.length + i] << 8)), errors);
});

test("bytes of a script are those that were written as base85", () => {
  assert.deepEqual([...fromText("")], []);
  assert.deepEqual([...fromText("as")], [114]);
  assert.equal(Buffer.from(fromText("a%E*^AYpVMH6U#")).toString(), "reef at 5 m");
  assert.deepEqual([...fromText("|NZ~~0R")], [255, 254, 0, 0, 1]);
});
