import assert from "node:assert/strict";
import { test } from "node:test";
import { decoded, fromText } from "../src/codes";

// as stereo_seecolor/report/templates.py and plane_code.py write them

test("whole numbers are predicted from their neighbors, with small and large errors", () => {
  const text = "1\ufcb5\uadbe\u0100\u40a7\uc009\u0100\u99ca\u0100\u4028\u6000\u45ef\u95c3\u0100\u4041\ufb00\u4796\u63dc\ud21c\ue81e\ub4d5\u92f6\u7e2a\uc80b\u3ff3\u0100\u401a";
  assert.deepEqual([...decoded(text, 5, 4)], [0, 1, 2, 3, 4, 0, 1, 65535, 3, 4, 7, 7, 7, 300, 7, 9, 8, 7, 6, 5]);
});

test("bytes of a script are those that were written, two a character, those that a text may not hold behind another", () => {
  assert.deepEqual([...fromText("0")], []);
  assert.deepEqual([...fromText("1\u0100\u4072")], [114]);
  assert.deepEqual([...fromText("0\u6572")], [114, 101]);
  assert.equal(Buffer.from(fromText("1\u6572\u6665\u6120\u2074\u2035\u0100\u406d")).toString(), "reef at 5 m");
  assert.deepEqual([...fromText("0\u0100\u4000\u0100\u4022\u0100\ubfff\u0100\u9800\u0100\u6028")], [0, 0, 34, 0, 255, 255, 0, 216, 40, 32]);
});
