import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { texter, type Dive } from "../src/dive";
import { takeBlocks } from "../src/blocks";
import { Measures, offBorders, placed, quoted, type Measure } from "../src/measures";

/** The camera of frame b stands at (1, 2, 3), turned by a quarter around z. */
const DIVE = {
  id: "dive", names: ["a", "b"], image_suffix: ".png", offset_m: [100, 200, 0], north: true,
  blocks: [{}],
} as unknown as Dive;
const POSE = [0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3];
takeBlocks(async () => ({ pose: (number) => (number === 1 ? POSE : null), plots: {} }));
const LENGTH: Omit<Measure, "id"> = {
  frame: "a", kind: "length", label: "Acropora", places: [[10, 20], [30, 15]], points: [[0, 0, 1], [0.25, 0, 1]],
  value: 0.25, std: 0.002, surface: 0.26, surface_std: 0.003,
};
const ON_MAP: Omit<Measure, "id"> = { ...LENGTH, frame: "", map: "m", kind: "point", label: "", places: [], points: [[1, 2, -3]], clicks_m: [0.01], surface: null, surface_std: null };

/** Measures without their keys and times. */
const plain = (list: readonly Measure[]) => list.map(({ key: _, changed_ms: __, ...each }) => each);

beforeEach(() => localStorage.clear());

test("measures are numbered, kept by the browser, and a removed number is not given to an older one", () => {
  const measures = new Measures(DIVE, () => undefined);
  assert.deepEqual([measures.put(LENGTH), measures.put(ON_MAP)], [1, 2]);
  measures.remove(1);
  assert.equal(measures.put(LENGTH), 3);
  assert.deepEqual(new Measures(DIVE, () => undefined).list, measures.list);
  assert.equal(new Measures({ ...DIVE, id: "other" }, () => undefined).list.length, 0);
});

test("every step can be taken back", () => {
  const measures = new Measures(DIVE, () => undefined);
  const before: string[] = [];
  const remember = () => before.push(JSON.stringify(plain(measures.list)));
  remember();
  const id = measures.put(LENGTH);
  remember();
  measures.put({ ...LENGTH, id, label: "Porites" });
  remember();
  measures.remove(id);
  while (measures.canUndo) {
    measures.undo();
    assert.equal(JSON.stringify(plain(measures.list)), before.pop());
  }
  assert.equal(before.length, 0);
});

test("what is typed is kept letter by letter, and taken back in one go", () => {
  const measures = new Measures(DIVE, () => undefined);
  const id = measures.put({ ...LENGTH, label: "" });
  for (const typed of ["P", "Po", "Porites"]) measures.write(id, "label", typed);
  for (const typed of ["b", "bleached"]) measures.write(id, "note", typed);
  assert.deepEqual(plain(new Measures(DIVE, () => undefined).list), [{ ...LENGTH, id, label: "Porites", note: "bleached" }]);
  measures.undo();
  assert.deepEqual([measures.list[0].label, measures.list[0].note], ["Porites", undefined]);
  measures.undo();
  assert.equal(measures.list[0].label, "");
  measures.write(id, "label", "A");
  measures.undo();
  assert.equal(measures.list[0].label, "");
});

test("two tabs keep what both measure and label, and each takes back its own", () => {
  const tabs = [0, 1].map(() => new Measures(DIVE, () => undefined));
  const tell = () => (globalThis as unknown as { tellOtherTabs: (key: string) => void }).tellOtherTabs("stereo-seecolor/dive");
  const [first, second] = [tabs[0].put(LENGTH), tabs[1].put(ON_MAP)]; // without a word between them
  assert.notEqual(first, second);
  tabs[0].write(second, "label", "Acropora");
  tabs[1].write(first, "note", "bleached");
  tell();
  for (const { list } of tabs) assert.deepEqual([list[0].note, list[1].label], ["bleached", "Acropora"]);
  tabs[1].undo();
  tabs[1].undo();
  tell();
  for (const { list } of tabs) assert.deepEqual(plain(list), [{ ...LENGTH, id: first }]);
});

test("measures go to another browser and back; the later change counts, and what was deleted there stays deleted", () => {
  const here = new Measures(DIVE, () => undefined);
  here.put(LENGTH);
  here.put(ON_MAP);
  const file = here.json();
  localStorage.clear();
  const there = new Measures({ ...DIVE, measures: JSON.parse(file).measures }, () => undefined);
  assert.deepEqual(there.list, here.list);
  there.write(2, "label", "Porites");
  there.remove(1);
  assert.equal(there.load(file), 1); // by hand: what was deleted comes back
  assert.equal(there.list[1].label, "Porites");
  there.remove(1);
  const again = new Measures({ ...DIVE, measures: JSON.parse(file).measures }, () => undefined);
  assert.deepEqual(again.list.map((each) => [each.id, each.label]), [[2, "Porites"]]);
  const third = { ...JSON.parse(file).measures[0], id: 2, key: "of a third browser" };
  assert.equal(again.load(JSON.stringify({ ...JSON.parse(file), measures: [third] })), 1);
  assert.deepEqual(again.list.map((each) => each.id), [2, 3]);
});

test("random points go to another browser with the measures; those that were changed later count, and the others come back", () => {
  const here = new Measures(DIVE, () => undefined);
  here.points.replace([{ spot_m: [1, 2], label: "" }, { spot_m: [3, 4], label: "" }]);
  here.points.give("Sand");
  const file = here.json();
  localStorage.clear();
  const there = new Measures({ ...DIVE, cover: JSON.parse(file).cover }, () => undefined);
  assert.deepEqual(there.points.list, [{ spot_m: [1, 2], label: "Sand" }, { spot_m: [3, 4], label: "" }]);
  assert.deepEqual(new Measures(DIVE, () => undefined).points.list, there.points.list);
  there.points.give("Rock");
  assert.equal(there.load(file), 0); // labelled later here
  assert.deepEqual(there.points.list.map((each) => each.label), ["Sand", "Rock"]);
  assert.equal(here.load(there.json()), 2);
  assert.deepEqual(here.points.list.map((each) => each.label), ["Sand", "Rock"]);
  here.points.back();
  here.points.back();
  here.points.back();
  assert.deepEqual(here.points.list.map((each) => each.label), ["Sand", ""]); // as they were here before
});

test("points as earlier pages kept them are found", () => {
  localStorage.setItem("stereo-seecolor/cover/dive", JSON.stringify([{ spot_m: [1, 2], label: "Sand" }]));
  assert.equal(new Measures(DIVE, () => undefined).points.list[0].label, "Sand");
});

test("a file of something else, or of another dive, is refused", () => {
  const measures = new Measures(DIVE, () => undefined);
  assert.throws(() => measures.load("{}"), /not a file of measures/);
  assert.throws(() => measures.load("places,"), SyntaxError);
  assert.throws(() => measures.load(new Measures({ ...DIVE, id: "other" }, () => undefined).json()), /of another dive/);
});

test("a table has a row for each point, in the map's world or the frame's camera", () => {
  const measures = new Measures(DIVE, () => undefined);
  measures.put(LENGTH);
  measures.put(ON_MAP);
  const [head, ...rows] = measures.csv().trimEnd().split("\r\n").map((row) => row.split(","));
  const column = (name: string) => rows.map((row) => row[head.indexOf(name)]);
  assert.deepEqual(column("measure"), ["1", "1", "2"]);
  assert.deepEqual(column("x_px"), ["10.00", "30.00", ""]);
  assert.deepEqual(column("x_m"), ["0.000000", "0.250000", "101.000000"]);
  assert.deepEqual(column("click_m"), ["", "", "0.01000"]);
});

test("features lie where the camera saw them, and say in which axes", async () => {
  const measures = new Measures(DIVE, () => undefined);
  measures.put({ ...LENGTH, frame: "b" });
  measures.put(LENGTH);
  measures.put({ ...ON_MAP, kind: "area", points: [[0, 0, 0], [1, 0, 0], [1, 1, 0]] });
  const [onMap, inCamera, area] = JSON.parse(await measures.geojson()).features;
  assert.deepEqual(onMap.geometry, { type: "LineString", coordinates: [[101, 202, 4], [101, 202.25, 4]] });
  assert.match(onMap.properties.axes, /^map: x east/);
  assert.deepEqual(inCamera.geometry.coordinates, LENGTH.points);
  assert.match(inCamera.properties.axes, /^rectified left camera/);
  assert.deepEqual(area.geometry.coordinates[0], [[100, 200, 0], [101, 200, 0], [101, 201, 0], [100, 200, 0]]);
});

test("VIAME's detections have millimeters, a box, head and tail", () => {
  const measures = new Measures(DIVE, () => undefined);
  measures.put(LENGTH);
  measures.put(ON_MAP);
  const rows = measures.viame().trimEnd().split("\n").slice(1);
  assert.deepEqual(rows, ["1,a.png,0,10.00,15.00,30.00,20.00,1,250.00,Acropora,1,(kp) head 10.00 20.00,(kp) tail 30.00 15.00"]);
});

test("a cell is quoted where it must be, and is never a formula", () => {
  const cells: [string | number, string][] = [["a,b", '"a,b"'], ['say "a"', '"say ""a"""'], ["two\nlines", '"two\nlines"'], ["=1+1", "'=1+1"], [-2, "-2"], ["sand", "sand"]];
  for (const [value, cell] of cells) assert.equal(quoted(value), cell);
});

test("a point of the camera is placed by its pose", () => {
  assert.deepEqual(placed(POSE, [1, 0, 0]), [1, 3, 3]);
});

test("texts are filled by name, and what has no value stays", () => {
  const text = texter({ greeting: "{count} frames of {dive}" });
  assert.equal(text("greeting", { count: 3 }), "3 frames of {dive}");
  assert.equal(text("unknown"), "unknown");
});

test("a place on the map stays in its cell when the table rounds it", () => {
  for (const meters of [1.685, -0.035, 1.515 + 1e-12, -1e-9]) {
    const moved = offBorders(meters);
    assert.ok(Math.abs(moved - meters) <= 5.001e-6);
    assert.equal(Number(moved.toFixed(6)) % 0.005 === 0, false);
    assert.ok(Math.abs(Number((100 + moved).toFixed(6)) - 100 - moved) < 1e-9);
  }
});
