// Levels of detail: which pieces of the mesh are drawn, so that none is coarser on the screen than a few pixels.

import { Box3, Mesh, Vector3, type Material, type Object3D, type PerspectiveCamera } from "three";
import type { About, Piece } from "./about";
import { piece, rawColors } from "./pieces";

const COARSEST_PX = 1.6; // a cell of a piece on the screen: finer ones are drawn where it is larger
const MOST_TRIANGLES = 3_000_000; // in memory: 40 bytes each
const AT_ONCE = 3; // pieces that are fetched at a time

export class Detail {
  private readonly meshes = new Map<string, Mesh>();
  private readonly loading = new Set<string>();
  private readonly used = new Map<string, number>();
  private readonly boxes: Map<string, Box3>;
  private readonly roots: string[];
  private clock = 0;
  private raw = false;

  constructor(
    private readonly about: About,
    private readonly parent: Object3D,
    private material: Material,
    private readonly changed: () => void,
  ) {
    const all = Object.entries(about.pieces);
    this.boxes = new Map(all.map(([name, { low_m, high_m }]) => [name, new Box3(vector(low_m), vector(high_m))]));
    const below = new Set(all.flatMap(([, each]) => each.finer));
    this.roots = all.map(([name]) => name).filter((name) => !below.has(name));
  }

  /** All that is drawn now. */
  get shown(): Mesh[] {
    return [...this.meshes.values()].filter((mesh) => mesh.visible);
  }

  get triangles(): number {
    return this.shown.reduce((sum, mesh) => sum + (mesh.geometry.index?.count ?? 0) / 3, 0);
  }

  /** How fine the piece of a drawn mesh is. */
  cell_m(mesh: Object3D): number {
    return this.about.pieces[mesh.name]?.cell_m ?? 0;
  }

  setMaterial(material: Material): void {
    this.material = material;
    for (const mesh of this.meshes.values()) mesh.material = material;
  }

  /** Colors as the camera saw them, or corrected. */
  setRaw(raw: boolean): void {
    this.raw = raw;
    for (const [name, mesh] of this.meshes) void this.paint(name, mesh);
  }

  /** Draw what is wanted of what is there, and fetch what is missing, the coarsest on the screen first. pixels: of a meter at a meter. */
  update(camera: PerspectiveCamera, pixels: number): void {
    this.clock++;
    const wanted = new Map<string, number>();
    const drawn = new Set<string>();
    const eye = camera.position;
    const coarseness = (name: string, each: Piece) => (each.cell_m * pixels) / Math.max(this.boxes.get(name)?.distanceToPoint(eye) ?? 0, camera.near);
    const visit = (name: string) => {
      const each = this.about.pieces[name];
      this.used.set(name, this.clock);
      const tooCoarse = coarseness(name, each);
      const finer = each.finer;
      if (tooCoarse > COARSEST_PX && finer.length) {
        if (finer.every((child) => this.meshes.has(child))) {
          finer.forEach(visit);
          return;
        }
        for (const child of finer) {
          this.used.set(child, this.clock);
          if (!this.meshes.has(child)) wanted.set(child, tooCoarse);
        }
      }
      drawn.add(name);
    };
    for (const root of this.roots) {
      if (this.meshes.has(root)) visit(root);
      else wanted.set(root, Infinity);
    }
    for (const [name, mesh] of this.meshes) mesh.visible = drawn.has(name);
    this.forget();
    const room = AT_ONCE - this.loading.size;
    const next = [...wanted].filter(([name]) => !this.loading.has(name)).sort((a, b) => b[1] - a[1]);
    for (const [name] of next.slice(0, Math.max(room, 0))) if (this.hasRoom(name)) void this.load(name);
  }

  private total(): number {
    let sum = 0;
    for (const name of [...this.meshes.keys(), ...this.loading]) sum += this.about.pieces[name].triangles;
    return sum;
  }

  private hasRoom(name: string): boolean {
    return this.roots.includes(name) || this.total() + this.about.pieces[name].triangles <= MOST_TRIANGLES;
  }

  /** Drop what was not looked at for longest, once there is too much of it. */
  private forget(): void {
    const spare = [...this.meshes.keys()].filter((name) => !this.roots.includes(name) && (this.used.get(name) ?? 0) < this.clock);
    spare.sort((a, b) => (this.used.get(a) ?? 0) - (this.used.get(b) ?? 0));
    while (spare.length && this.total() > 0.75 * MOST_TRIANGLES) {
      const name = spare.shift() as string;
      const mesh = this.meshes.get(name);
      if (!mesh) continue;
      mesh.geometry.dispose();
      this.parent.remove(mesh);
      this.meshes.delete(name);
    }
  }

  private async load(name: string): Promise<void> {
    this.loading.add(name);
    try {
      const mesh = new Mesh(await piece(name), this.material);
      mesh.name = name;
      mesh.visible = false;
      if (this.raw) await this.paint(name, mesh);
      this.meshes.set(name, mesh);
      this.parent.add(mesh);
    } finally {
      this.loading.delete(name);
    }
    this.changed();
  }

  private async paint(name: string, mesh: Mesh): Promise<void> {
    const { geometry } = mesh;
    const wanted = this.raw ? "raw" : "corrected";
    if (!geometry.userData.corrected) geometry.userData.corrected = geometry.getAttribute("color");
    if (this.raw) geometry.userData.raw ??= await rawColors(name, geometry.getAttribute("position").count).catch(() => null);
    const colors = geometry.userData[wanted];
    if (colors) geometry.setAttribute("color", colors);
    this.changed();
  }
}

export function vector([x, y, z]: number[]): Vector3 {
  return new Vector3(x, y, z);
}
