// Pieces of the map's mesh: loaded as scripts, inflated, and made into geometry (stereo_seecolor/report/map_mesh.py).

import { Box3, BufferAttribute, BufferGeometry, LinearMipmapNearestFilter, Mesh, MeshBasicMaterial, Sphere, Texture, Vector3, type Material } from "three";
import type { Piece } from "./about";
import { fromText, numbers } from "./codes";
import { script } from "./scripts";
import { seecolor } from "./shared";

const BLOCK_TRIANGLES = 4000; // drawn in a millisecond without a graphics card

interface Surface {
  low_m: number[];
  step_m: number[];
  positions: string;
  corners: string;
}

interface Packed extends Surface {
  colors: string;
}

/** A page of texture and its triangles. uv: places in it, in steps of a pixel, from its upper left corner. */
interface Page extends Surface {
  uv: string;
  uv_steps: number;
  size: [number, number];
  jpeg: string;
}

/** The finer pieces that show the same, by their names: only the script of a piece lists them, since a map may have hundreds of thousands. */
type Finer = Record<string, Piece>;

/** What the script of a piece holds, as geometry. */
export interface Loaded {
  meshes: Mesh[];
  finer: Finer;
}

const received = new Map<string, [(Page | Packed)[], Finer]>();
seecolor.mesh = (name: string, packed: Packed, finer: Finer) => received.set(name, [[packed], finer]);
seecolor.textured = (name: string, parts: (Page | Packed)[], finer: Finer) => received.set(name, [parts, finer]);

/** A piece, in the map's own coordinates: a part for each page of texture, and one in the colors of its vertices. */
export async function loaded(name: string, material: Material): Promise<Loaded> {
  await script(`page/map/${encodeURIComponent(name)}.js`);
  const found = received.get(name);
  if (!found) throw new Error(`${name} is not a piece of the map`);
  received.delete(name);
  const [parts, finer] = found;
  const made = parts.map(async (part) => ("jpeg" in part ? blocks(await withPlaces(part), await painted(part.jpeg)) : blocks(await withColors(part), material)));
  return { meshes: (await Promise.all(made)).flat(), finer };
}

/** Free what a piece holds on the graphics card. material: that of all pieces, which stays. */
export function dispose(parts: Mesh[], material: Material): void {
  for (const { geometry, material: own } of parts) {
    geometry.dispose();
    if (own === material || !(own instanceof MeshBasicMaterial)) continue;
    own.map?.dispose();
    own.dispose();
  }
}

async function withColors(packed: Packed): Promise<BufferGeometry> {
  const [geometry, colors] = await Promise.all([surface(packed), numbers(packed.colors)]);
  return geometry.setAttribute("color", new BufferAttribute(opaque(colors), 4, true));
}

async function withPlaces(page: Page): Promise<BufferGeometry> {
  const [geometry, steps] = await Promise.all([surface(page), numbers(page.uv)]);
  const uv = placed(steps, [0, 0], page.size.map((size) => 1 / page.uv_steps / size));
  return geometry.setAttribute("uv", new BufferAttribute(uv, 2));
}

/** A texture as a material. Pages opened from a file may give graphics cards no image of a file: it comes in the script. */
async function painted(jpeg: string): Promise<Material> {
  const bitmap = await createImageBitmap(new Blob([fromText(jpeg)], { type: "image/jpeg" }));
  const texture = new Texture(bitmap);
  texture.minFilter = LinearMipmapNearestFilter; // of one level: two take longer without a graphics card, and at rest four pixels are mixed
  texture.flipY = false;
  texture.needsUpdate = true;
  texture.onUpdate = () => bitmap.close(); // the graphics card has its own copy
  return new MeshBasicMaterial({ map: texture, side: 2 });
}

async function surface(packed: Surface): Promise<BufferGeometry> {
  const [positions, corners] = await Promise.all([packed.positions, packed.corners].map(numbers));
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(placed(positions, packed.low_m, packed.step_m), 3));
  geometry.setIndex(new BufferAttribute(Uint32Array.from(corners), 1));
  return geometry;
}

/** A surface in square blocks with the same vertices: those out of sight are neither drawn nor searched for what was clicked. */
function blocks(whole: BufferGeometry, material: Material): Mesh[] {
  const position = whole.getAttribute("position") as BufferAttribute;
  const index = (whole.index as BufferAttribute).array;
  const count = index.length / 3;
  const { min, max } = new Box3().setFromBufferAttribute(position);
  const across = Math.ceil(Math.sqrt(count / BLOCK_TRIANGLES));
  const place = (value: number, low: number, high: number) => Math.min(Math.floor(((value - low) / (high - low || 1)) * across), across - 1);
  const block = Uint16Array.from({ length: count }, (_, i) => {
    const corner = index[3 * i];
    return place(position.getX(corner), min.x, max.x) + across * place(position.getY(corner), min.y, max.y);
  });
  const ends = new Uint32Array(across ** 2 + 1);
  for (const number of block) ends[number + 1]++;
  for (let number = 0; number < across ** 2; number++) ends[number + 1] += ends[number];
  const next = ends.slice();
  const sorted = new Uint32Array(index.length);
  block.forEach((number, i) => sorted.set([index[3 * i], index[3 * i + 1], index[3 * i + 2]], 3 * next[number]++));
  return [...ends.subarray(1)]
    .map((end, number) => sorted.subarray(3 * ends[number], 3 * end))
    .filter((corners) => corners.length)
    .map((corners) => {
      const geometry = new BufferGeometry();
      for (const [name, values] of Object.entries(whole.attributes)) geometry.setAttribute(name, values);
      geometry.setIndex(new BufferAttribute(corners, 1));
      const box = new Box3();
      const point = new Vector3();
      for (const corner of corners) box.expandByPoint(point.fromBufferAttribute(position, corner));
      geometry.boundingBox = box;
      geometry.boundingSphere = box.getBoundingSphere(new Sphere());
      return new Mesh(geometry, material);
    });
}

/** Values of each vertex, from steps axis after axis. */
function placed(steps: Int32Array, low: number[], step: number[]): Float32Array {
  const count = steps.length / low.length;
  const values = new Float32Array(steps.length);
  low.forEach((from, axis) => {
    for (let i = 0; i < count; i++) values[low.length * i + axis] = from + steps[axis * count + i] * step[axis];
  });
  return values;
}

/** Colors of 64 steps, channel after channel, red and blue as their differences from green; opaque, so that each takes a whole word of memory. */
function opaque(steps: Int32Array): Uint8Array {
  const count = steps.length / 3;
  const colors = new Uint8Array(4 * count).fill(255);
  const shown = (step: number) => 4 * step + 2;
  for (let i = 0; i < count; i++) {
    const green = steps[count + i];
    colors.set([shown(green + steps[i]), shown(green), shown(green + steps[2 * count + i])], 4 * i);
  }
  return colors;
}
