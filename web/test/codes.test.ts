import assert from "node:assert/strict";
import { test } from "node:test";
import { fromText, numbers } from "../src/codes";

// as stereo_seecolor/report/templates.py and number_code.py write them

test("whole numbers are the sums of their differences, which have either sign and three bytes", async () => {
  const text = "1\u0178\u6063\u0202\u4676\uef86\u6c4c\u0c0c\u9e5e\ufe9f\u4033\u7fc1\u2006\u6260\u5412\u8066\u2600\u0646\ua830\u02fa\ua800\u0651\u0100\u403c";
  assert.deepEqual([...(await numbers(text))], [0, 1, 2, 3, 4, 0, -1, 65535, 3, 4, 7, 7, 7, 300, 7, 4000000, -4000000]);
});

test("bytes of a script are those that were written, two a character, those that a text may not hold behind another", () => {
  assert.deepEqual([...fromText("0")], []);
  assert.deepEqual([...fromText("1\u0100\u4072")], [114]);
  assert.deepEqual([...fromText("0\u6572")], [114, 101]);
  assert.equal(Buffer.from(fromText("1\u6572\u6665\u6120\u2074\u2035\u0100\u406d")).toString(), "reef at 5 m");
  assert.deepEqual([...fromText("0\u0100\u4000\u0100\u4022\u0100\ubfff\u0100\u9800\u0100\u6028")], [0, 0, 34, 0, 255, 255, 0, 216, 40, 32]);
});
