// Levels of detail: which pieces of the mesh are drawn, so that none is coarser on the screen than a few pixels.

import { Box3, Frustum, Matrix4, Mesh, Vector3, type Material, type Object3D, type PerspectiveCamera } from "three";
import type { About, Piece } from "./about";
import { piece, rawColors } from "./pieces";

const FILL_CELLS = 1.5;
const MOST_TRIANGLES = 3_000_000; // in memory: 40 bytes each
const SAMPLE = 500; // vertices of a piece: its outline to a few percent
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
    private behind: Material,
    private readonly changed: () => void,
  ) {
    const all = Object.entries(about.pieces);
    this.boxes = new Map(all.map(([name, { low_m, high_m }]) => [name, new Box3(vector(low_m), vector(high_m))]));
    const below = new Set(all.flatMap(([, each]) => each.finer));
    this.roots = all.map(([name]) => name).filter((name) => !below.has(name));
  }

  /** All that is drawn now, without what only fills cracks. */
  get shown(): Mesh[] {
    return [...this.meshes.values()].filter((mesh) => mesh.visible && mesh.material === this.material);
  }

  get triangles(): number {
    return this.shown.reduce((sum, mesh) => sum + (mesh.geometry.index?.count ?? 0) / 3, 0);
  }

  /** Some vertices of all that is loaded. */
  sample(): Vector3[] {
    const found: Vector3[] = [];
    for (const mesh of this.meshes.values()) {
      const position = mesh.geometry.getAttribute("position");
      const step = Math.max(1, Math.floor(position.count / SAMPLE));
      for (let i = 0; i < position.count; i += step) found.push(new Vector3().fromBufferAttribute(position, i));
    }
    return found;
  }

  /** How fine the piece of a drawn mesh is. */
  cell_m(mesh: Object3D): number {
    return this.about.pieces[mesh.name]?.cell_m ?? 0;
  }

  /** behind: the same a little farther away, for the coarser pieces that fill cracks. */
  setMaterial(material: Material, behind: Material): void {
    this.material = material;
    this.behind = behind;
  }

  /** Colors as the camera saw them, or corrected. */
  setRaw(raw: boolean): void {
    this.raw = raw;
    for (const [name, mesh] of this.meshes) void this.paint(name, mesh);
  }

  /**
   * Draw what is wanted of what is there, and fetch what is missing, the coarsest on the screen first.
   * pixels: of a meter at a meter. coarsest_px: a cell of a piece on the screen; finer ones are drawn where it is larger.
   */
  update(camera: PerspectiveCamera, pixels: number, coarsest_px: number): void {
    this.clock++;
    const wanted = new Map<string, number>();
    const drawn = new Set<string>();
    const filling = new Set<string>(); // between pieces of two levels are cracks: what is one level coarser shows there
    const eye = camera.position;
    camera.updateMatrixWorld();
    const sight = new Frustum().setFromProjectionMatrix(new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    const coarseness = (box: Box3, each: Piece) => (each.cell_m * pixels) / Math.max(box.distanceToPoint(eye), camera.near);
    const visit = (name: string, parent: string) => {
      const each = this.about.pieces[name];
      this.used.set(name, this.clock);
      const box = this.boxes.get(name) as Box3;
      const tooCoarse = sight.intersectsBox(box) ? coarseness(box, each) : 0;
      const finer = each.finer;
      if (tooCoarse > coarsest_px && finer.length) {
        if (finer.every((child) => this.meshes.has(child))) {
          for (const child of finer) visit(child, name);
          return;
        }
        for (const child of finer) {
          this.used.set(child, this.clock);
          if (!this.meshes.has(child)) wanted.set(child, tooCoarse);
        }
      }
      drawn.add(name);
      if (parent) filling.add(parent);
    };
    for (const root of this.roots) {
      if (this.meshes.has(root)) visit(root, "");
      else wanted.set(root, Infinity);
    }
    for (const [name, mesh] of this.meshes) {
      mesh.visible = drawn.has(name) || filling.has(name);
      mesh.material = drawn.has(name) ? this.material : this.behind;
      const away = drawn.has(name) ? 0 : this.behindBy(name, camera);
      mesh.scale.setScalar(1 + away); // around the eye: farther away, and at the same place of the screen
      mesh.position.copy(eye).multiplyScalar(-away);
    }
    this.forget();
    const room = AT_ONCE - this.loading.size;
    const next = [...wanted].filter(([name]) => !this.loading.has(name)).sort((a, b) => b[1] - a[1]);
    for (const [name] of next.slice(0, Math.max(room, 0))) if (this.hasRoom(name)) void this.load(name);
  }

  /** So much farther away is a piece that fills cracks, that its coarser surface does not show through the finer one. */
  private behindBy(name: string, camera: PerspectiveCamera): number {
    const distance_m = this.boxes.get(name)?.distanceToPoint(camera.position) ?? 0;
    return (FILL_CELLS * this.about.pieces[name].cell_m) / Math.max(distance_m, camera.near, this.about.pieces[name].cell_m);
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
