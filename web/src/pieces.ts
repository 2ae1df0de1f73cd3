// Pieces of the map's mesh: loaded as scripts, inflated, and made into geometry (stereo_seecolor/report/map_mesh.py).

import { Box3, BufferAttribute, BufferGeometry, LinearMipmapNearestFilter, Mesh, MeshBasicMaterial, Sphere, Texture, Vector3, type Material } from "three";
import type { Piece } from "./about";
import { fromText, inflated } from "./codes";
import { script } from "./scripts";
import { seecolor } from "./shared";

const BLOCK_TRIANGLES = 4000; // drawn in a millisecond without a graphics card

interface Surface {
  vertices: number;
  triangles: number;
  low_m: number[];
  step_m: number;
  positions: string;
  indices: string;
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
  const [geometry, colors] = await Promise.all([surface(packed), inflated(packed.colors)]);
  return geometry.setAttribute("color", new BufferAttribute(opaque(colors, packed.vertices), 4, true));
}

async function withPlaces(page: Page): Promise<BufferGeometry> {
  const [geometry, bytes] = await Promise.all([surface(page), inflated(page.uv)]);
  const steps = sums(bytes, 3, page.vertices);
  const uv = new Float32Array(2 * page.vertices);
  for (let axis = 0; axis < 2; axis++) {
    for (let i = 0; i < page.vertices; i++) uv[2 * i + axis] = steps[axis * page.vertices + i] / page.uv_steps / page.size[axis];
  }
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
  const [positions, indices] = await Promise.all([packed.positions, packed.indices].map(inflated));
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(placed(positions, packed), 3));
  geometry.setIndex(new BufferAttribute(counted(indices, 3 * packed.triangles), 1));
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

/** Numbers of either sign from their bytes, the lowest first, as running sums over rows of a length. */
function sums(bytes: Uint8Array, planes: number, rows: number): Int32Array {
  const count = bytes.length / planes;
  const values = new Int32Array(count);
  for (let i = 0; i < count; i++) {
    let folded = 0;
    for (let plane = 0; plane < planes; plane++) folded |= bytes[plane * count + i] << (8 * plane);
    const difference = (folded >>> 1) ^ -(folded & 1);
    values[i] = i % rows ? values[i - 1] + difference : difference;
  }
  return values;
}

function placed(bytes: Uint8Array, { vertices, low_m, step_m }: Surface): Float32Array {
  const steps = sums(bytes, 3, vertices);
  const positions = new Float32Array(3 * vertices);
  for (let axis = 0; axis < 3; axis++) {
    for (let i = 0; i < vertices; i++) positions[3 * i + axis] = low_m[axis] + steps[axis * vertices + i] * step_m;
  }
  return positions;
}

/** Each index is given as how far it lies before the next new vertex; 0 is that vertex itself. */
function counted(bytes: Uint8Array, count: number): Uint32Array {
  const indices = new Uint32Array(count);
  let next = 0;
  for (let i = 0; i < count; i++) {
    const back = bytes[i] | (bytes[count + i] << 8) | (bytes[2 * count + i] << 16);
    indices[i] = next - back;
    if (!back) next++;
  }
  return indices;
}

/** Colors of 8 bits; opaque, so that each takes a whole word of memory. */
function opaque(bytes: Uint8Array, vertices: number): Uint8Array {
  const colors = new Uint8Array(4 * vertices).fill(255);
  for (let channel = 0; channel < 3; channel++) {
    let value = 0;
    for (let i = 0; i < vertices; i++) {
      value = (value + bytes[channel * vertices + i]) & 255;
      colors[4 * i + channel] = value;
    }
  }
  return colors;
}
