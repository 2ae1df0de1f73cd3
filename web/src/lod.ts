// Levels of detail: which pieces of the mesh are drawn, so that none is coarser on the screen than a few pixels.

import { Box3, Frustum, Group, Matrix4, Vector3, type Material, type Mesh, type Object3D, type PerspectiveCamera } from "three";
import type { Piece } from "./about";
import { dispose, loaded } from "./pieces";

const FILL_CELLS = 1.5;
const TEXELS_PER_CELL = 4; // of a textured piece: its texture hides that cells are coarser than a pixel, but for outlines
const MOST_TRIANGLES = 3_000_000; // in memory: 40 bytes each
const MOST_TEXELS = 64_000_000; // 4 bytes each, and a third more for coarser copies
const SAMPLE = 1000; // vertices of a piece: its outline to a few percent
const AT_ONCE = 3; // pieces that are fetched at a time

/** How fine a piece is as it is seen. */
function fineness_m({ cell_m, texel_m }: Piece): number {
  return texel_m ? Math.max(texel_m, cell_m / TEXELS_PER_CELL) : cell_m;
}

/** What pieces weigh in memory, as a fraction of what there is room for. */
function weight(pieces: Piece[]): number {
  const sum = (of: (each: Piece) => number) => pieces.reduce((total, each) => total + of(each), 0);
  return Math.max(sum((each) => each.triangles) / MOST_TRIANGLES, sum((each) => each.texels ?? 0) / MOST_TEXELS);
}

export class Detail {
  /** Everything that is loaded, to be put into a scene. */
  readonly root = new Group();
  private readonly parts = new Map<string, Group>();
  private readonly loading = new Set<string>();
  private readonly missing = new Set<string>(); // whose files cannot be read
  private readonly used = new Map<string, number>();
  private readonly boxes = new Map<string, Box3>();
  private readonly roots: string[];
  private drawn = new Set<string>();
  private clock = 0;

  constructor(
    private readonly pieces: Record<string, Piece>,
    private material: Material,
    private readonly changed: () => void,
  ) {
    this.list(pieces);
    const below = new Set(Object.values(pieces).flatMap((each) => each.finer));
    this.roots = Object.keys(pieces).filter((name) => !below.has(name));
  }

  private list(pieces: Record<string, Piece>): void {
    Object.assign(this.pieces, pieces);
    for (const [name, { low_m, high_m }] of Object.entries(pieces)) this.boxes.set(name, new Box3(vector(low_m), vector(high_m)));
  }

  /** All that is drawn now, without what only fills cracks. */
  get shown(): Mesh[] {
    return [...this.drawn].flatMap((name) => this.meshes(name));
  }

  private meshes(name: string): Mesh[] {
    return (this.parts.get(name)?.children ?? []) as Mesh[];
  }

  /** Whether pieces are being fetched. */
  get busy(): boolean {
    return this.loading.size > 0;
  }

  get triangles(): number {
    return this.shown.reduce((sum, mesh) => sum + (mesh.geometry.index?.count ?? 0) / 3, 0);
  }

  /** Some vertices of the whole map, from its coarsest pieces, which are always the same; null until all of them are loaded. */
  outline(): Vector3[] | null {
    return this.roots.every((name) => this.parts.has(name)) ? this.sample(this.roots) : null;
  }

  /** Some vertices of pieces: of all that are loaded, unless some are named. */
  sample(names: Iterable<string> = this.parts.keys()): Vector3[] {
    return [...names].flatMap((name) => (this.parts.get(name)?.userData.sample as Vector3[] | undefined) ?? []);
  }

  /** How fine the piece of a drawn mesh is. */
  cell_m(mesh: Object3D): number {
    return this.pieces[mesh.parent?.name ?? ""]?.cell_m ?? 0;
  }

  /** Of the pieces that have the colors of their vertices. */
  setMaterial(material: Material): void {
    for (const mesh of [...this.parts.keys()].flatMap((name) => this.meshes(name))) if (mesh.material === this.material) mesh.material = material;
    this.material = material;
  }

  /**
   * Draw what is wanted of what is there, and fetch what is missing, the coarsest on the screen first.
   * pixels: of a meter at a meter. coarsest_px: a cell or texel of a piece on the screen; finer ones are drawn where it is larger.
   */
  update(camera: PerspectiveCamera, pixels: number, coarsest_px: number): void {
    this.clock++;
    const wanted = new Map<string, number>();
    this.drawn = new Set<string>();
    const parents = new Map<string, string>();
    const eye = camera.position;
    camera.updateMatrixWorld();
    const sight = new Frustum().setFromProjectionMatrix(new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    const visit = (name: string, parent: string) => {
      const each = this.pieces[name];
      this.used.set(name, this.clock);
      const tooCoarse = (fineness_m(each) * pixels) / Math.max(this.away_m(name, eye, sight), camera.near);
      const finer = each.finer;
      if (tooCoarse > coarsest_px && finer.length) {
        if (finer.every((child) => this.parts.has(child))) {
          for (const child of finer) visit(child, name);
          return;
        }
        for (const child of finer) {
          this.used.set(child, this.clock);
          if (!this.parts.has(child)) wanted.set(child, tooCoarse);
        }
      }
      this.drawn.add(name);
      if (parent) parents.set(name, parent);
    };
    for (const root of this.roots) {
      if (this.parts.has(root)) visit(root, "");
      else wanted.set(root, Infinity);
    }
    // between pieces of two levels are cracks: what is one level coarser than the finer one shows there
    const filling = new Set([...parents].filter(([name]) => this.isBesideCoarser(name)).map(([, parent]) => parent));
    for (const [name, part] of this.parts) {
      const drawn = this.drawn.has(name);
      part.visible = drawn || filling.has(name);
      const away = drawn ? 0 : this.behindBy(name, camera);
      part.scale.setScalar(1 + away); // around the eye: farther away, and at the same place of the screen
      part.position.copy(eye).multiplyScalar(-away);
    }
    this.forget();
    const room = AT_ONCE - this.loading.size;
    const next = [...wanted].filter(([name]) => !this.loading.has(name) && !this.missing.has(name)).sort((a, b) => b[1] - a[1]);
    for (const [name] of next.slice(0, Math.max(room, 0))) if (this.hasRoom(name)) void this.load(name);
  }

  /** How far away a piece is where it is in sight, by some of its vertices; without any in sight, by the boxes around its blocks, which may reach up to the viewer. */
  private away_m(name: string, eye: Vector3, sight: Frustum): number {
    const nearest_m = this.sample([name]).reduce((least, point) => (sight.containsPoint(point) ? Math.min(least, point.distanceTo(eye)) : least), Infinity);
    if (nearest_m < Infinity) return nearest_m;
    const boxes = this.meshes(name).map(({ geometry }) => geometry.boundingBox as Box3);
    return boxes.reduce((least, box) => (sight.intersectsBox(box) ? Math.min(least, box.distanceToPoint(eye)) : least), Infinity);
  }

  /** Whether a drawn piece touches one of a coarser level. */
  private isBesideCoarser(name: string): boolean {
    const { cell_m } = this.pieces[name];
    const around = (this.boxes.get(name) as Box3).clone().expandByScalar(cell_m);
    return [...this.drawn].some((other) => this.pieces[other].cell_m > cell_m && around.intersectsBox(this.boxes.get(other) as Box3));
  }

  /** So much farther away is a piece that fills cracks, that its coarser surface does not show through the finer one. */
  private behindBy(name: string, camera: PerspectiveCamera): number {
    const distance_m = this.boxes.get(name)?.distanceToPoint(camera.position) ?? 0;
    return (FILL_CELLS * this.pieces[name].cell_m) / Math.max(distance_m, camera.near, this.pieces[name].cell_m);
  }

  private hasRoom(name: string): boolean {
    return this.roots.includes(name) || weight([...this.parts.keys(), ...this.loading, name].map((each) => this.pieces[each])) <= 1;
  }

  /** Drop what was not looked at for longest, once there is too much of it. */
  private forget(): void {
    const spare = [...this.parts.keys()].filter((name) => !this.roots.includes(name) && (this.used.get(name) ?? 0) < this.clock);
    spare.sort((a, b) => (this.used.get(a) ?? 0) - (this.used.get(b) ?? 0));
    while (spare.length && weight([...this.parts.keys(), ...this.loading].map((each) => this.pieces[each])) > 0.75) {
      const name = spare.shift() as string;
      const part = this.parts.get(name);
      if (!part) continue;
      dispose(this.meshes(name), this.material);
      this.root.remove(part);
      this.parts.delete(name);
    }
  }

  private async load(name: string): Promise<void> {
    this.loading.add(name);
    try {
      const { meshes, finer } = await loaded(name, this.material);
      this.list(finer);
      const part = new Group().add(...meshes);
      for (const mesh of meshes) mesh.material = mesh.geometry.hasAttribute("color") ? this.material : mesh.material;
      part.name = name;
      part.userData.sample = sampled(meshes);
      part.visible = false;
      this.parts.set(name, part);
      this.root.add(part);
    } catch {
      this.missing.add(name); // what is coarser shows instead
    } finally {
      this.loading.delete(name);
    }
    this.changed();
  }
}

/** Some vertices of a piece. */
function sampled(meshes: Mesh[]): Vector3[] {
  const found: Vector3[] = [];
  for (const position of new Set(meshes.map(({ geometry }) => geometry.getAttribute("position")))) {
    const step = Math.max(1, Math.floor(position.count / SAMPLE));
    for (let i = 0; i < position.count; i += step) found.push(new Vector3().fromBufferAttribute(position, i));
  }
  return found;
}

export function vector([x, y, z]: number[]): Vector3 {
  return new Vector3(x, y, z);
}
