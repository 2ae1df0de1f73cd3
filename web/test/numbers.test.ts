import assert from "node:assert/strict";
import { test } from "node:test";
import { wilson } from "../src/cover";
import { COLORS } from "../src/colors";
import { readable, withError } from "../src/elements";
import { ticks } from "../src/scale";

test("numbers are shown without powers of ten", () => {
  const shown: [number, string][] = [[0.00001364, "0.0000136"], [5.67e-17, "0"], [1234567, "1230000"], [-0.5, "-0.5"], [12, "12"]];
  for (const [value, text] of shown) assert.equal(readable(value), text);
});

test("a value is shown to two digits of its standard error", () => {
  assert.equal(withError(1.70934, 0.00213), "1.7093 ± 0.0021");
  assert.equal(withError(0.28061, 0.0334, 100), "28.1 ± 3.3");
  assert.equal(withError(1234.4, 56), "1234 ± 56");
  assert.equal(withError(1.5, null), "1.5");
  assert.equal(withError(1.5, NaN), "1.5");
});

test("Wilson's interval holds the fraction, and has closed forms at its ends", () => {
  const z2 = 1.96 ** 2;
  for (const of of [1, 5, 100]) {
    const [none, all] = [wilson(0, of), wilson(of, of)];
    assert.equal(none[0], 0);
    assert.ok(Math.abs(none[1] - z2 / (of + z2)) < 1e-12);
    assert.ok(Math.abs(all[0] - of / (of + z2)) < 1e-12);
    assert.ok(Math.abs(all[1] - 1) < 1e-12);
  }
  const [low, high] = wilson(30, 100);
  assert.ok(low < 0.3 && 0.3 < high && high - low < 2 * 1.96 * Math.sqrt((0.3 * 0.7) / 100));
});

test("ticks are round, and lie between the ends", () => {
  assert.deepEqual(ticks(0, 1), [0, 0.2, 0.4, 0.6, 0.8, 1]);
  assert.deepEqual(ticks(-3.2, 4.1), [-2, 0, 2, 4]);
  assert.deepEqual(ticks(2, 2), [2]);
});

test("the color map rises in lightness", () => {
  const luminance = (i: number) => {
    const linear = [0, 1, 2].map((channel) => {
      const value = COLORS[3 * i + channel] / 255;
      return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  for (let i = 8; i < 256; i += 8) assert.ok(luminance(i) > luminance(i - 8));
});
