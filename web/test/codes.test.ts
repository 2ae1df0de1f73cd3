import assert from "node:assert/strict";
import { test } from "node:test";
import { decoded, fromText } from "../src/codes";

// as stereo_seecolor/report/templates.py and plane_code.py write them

test("whole numbers are predicted from their neighbors, with small and large errors", () => {
  const text = "0\u5bfe\u30ab\u35e0\u019c\u0756\u65a0\u0100\u61ef\u23e1\u6650\u2100\u10b9\u333e\u728c\u3aa4\u1fe8\u6bda\u3ea4\u464f\u61bc\u4899\u7d68";
  assert.deepEqual([...decoded(text, 5, 4)], [0, 1, 2, 3, 4, 0, 1, 65535, 3, 4, 7, 7, 7, 300, 7, 9, 8, 7, 6, 5]);
});

test("bytes of a script are those that were written, 15 bits a character", () => {
  assert.deepEqual([...fromText("0")], []);
  assert.deepEqual([...fromText("0\u3a00")], [114]);
  assert.deepEqual([...fromText("1\u3a32\u4100")], [114, 101]);
  assert.equal(Buffer.from(fromText("0\u3a32\u5a59\u450c\u1842\u02a9\u02b4")).toString(), "reef at 5 m");
  assert.deepEqual([...fromText("0\u80ff\u0100\u013f\u80e0\u0100\u08ff\u7d00\u0101")], [255, 254, 0, 0, 1, 255, 254, 0, 0, 1, 255, 254, 0, 0, 1]);
});
