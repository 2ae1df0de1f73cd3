import assert from "node:assert/strict";
import { test } from "node:test";
import type { About } from "../src/about";
import { readPoints, textOf, tiles, writePoints } from "../src/coralnet";
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

test("tables are read as CoralNet and spreadsheets write them", async () => {
  const read = async (text: string) => (await readPoints(text, DIVE, ABOUT)).map(({ spot_m, label }) => [spot_m.map((value) => value.toFixed(3)).join(" "), label]);
  const expected = [["95.045 42.975", "Porit"], ["140.015 42.985", ""]]; // pixels (4, 2) of one tile and (1, 1) of the other
  assert.deepEqual(await read("Name,Row,Column,Label\n0_0.png,2,4,Porit\n0_1.png,1,1,\n"), expected);
  assert.deepEqual(await read("name,row,column,label code,Label ID\r\n0_0,2,4,Porit,82\r\n0_1.JPG,1.0,1.0,,\r\n"), expected);
  assert.deepEqual(await read('\uFEFFNAME;Date annotated;Row;Column;Label;Machine confidence 1\r\ndive/0_0.png;"2024-05-13; noon";2;4;Porit;93\r\nD:\\dive\\0_1.png;;1;1;;\r\n;;;;;\r\n'), expected);
  assert.deepEqual(await read('Name\tComments\tRow \t Column\tLabel\tLabel code\r0_0.png\t"two ""lines"",\nand a comma"\t2\t4\t\tPorit\r0_1.png\t6" pipe\t1\t1\t\t\r'), expected);
});

test("a table is text in any usual encoding", async () => {
  const wide = (text: string) => Uint8Array.from([0xff, 0xfe, ...[...text].flatMap((each) => [each.charCodeAt(0) & 255, each.charCodeAt(0) >> 8])]);
  assert.equal(await textOf(new Blob([wide("Müller")])), "Müller");
  assert.equal(await textOf(new Blob(["Müller"])), "Müller");
  assert.equal(await textOf(new Blob([Uint8Array.from([0x4d, 0xfc])])), "Mü");
});

test("what cannot be used is named", async () => {
  await assert.rejects(readPoints("Name,Row\n", DIVE, ABOUT), /line 1: columns Name, Row, Column and Label/);
  await assert.rejects(readPoints("Name,Row,Column,Label\n0_0.png,50,3,a\n", DIVE, ABOUT), /line 2: 0_0.png, row 50, column 3 is not a pixel/);
  const twice = "Name,Row,Column,Label\n0_0.png,5,3,\n0_0.png,5,3,a\n0_0.png,5,3,a\n";
  assert.deepEqual((await readPoints(twice, DIVE, ABOUT)).map(({ label }) => label), ["a"]);
  await assert.rejects(readPoints(`${twice}0_0.png,5,3,b\n`, DIVE, ABOUT), /line 5: labels a point as "b" that is "a"/);
});
