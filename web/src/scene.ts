// The reef in three dimensions: coarse as a whole, fine where the viewer is near; the track above it.

import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  Color,
  Line,
  LineBasicMaterial,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  DirectionalLight,
  AmbientLight,
  PerspectiveCamera,
  Points,
  PointsMaterial,
  Raycaster,
  Scene as Three,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { MapControls } from "three/addons/controls/MapControls.js";
import type { Dive } from "./dive";
import { piece } from "./pieces";

export interface About {
  pieces: Record<string, { low_m: number[]; high_m: number[]; triangles: number }>;
  whole?: string;
  mosaic?: Place;
  terrain?: Place & { low_m: number; high_m: number };
  preview: string;
  offset_m: number[];
}

export interface Place {
  width: number;
  height: number;
  west_m: number;
  north_m: number;
  pixel_m: number;
}

const MOST_FINE_TRIANGLES = 3_000_000;
const STILL_PX = 4;

export class Scene {
  readonly root: HTMLElement;
  private readonly scene = new Three();
  private readonly camera = new PerspectiveCamera(45, 1, 0.05, 2000);
  private readonly renderer = new WebGLRenderer({ antialias: true, alpha: true });
  private readonly controls: MapControls;
  private readonly plain = new MeshBasicMaterial({ vertexColors: true, side: 2 });
  private readonly shaded = new MeshLambertMaterial({ color: 0xb9c4c6, flatShading: true, side: 2 });
  private readonly meshes = new Map<string, Mesh>();
  private readonly loading = new Set<string>();
  private readonly track = new Three();
  private readonly spot: Points;
  private relief = false;
  private waiting = false;
  private placed = false;

  constructor(
    private readonly about: About,
    dive: Dive,
    private readonly label: string,
    private readonly clicked: (spot_m: number[]) => void,
  ) {
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.root = this.renderer.domElement;
    this.root.tabIndex = 0;
    this.root.setAttribute("role", "img");
    this.root.setAttribute("aria-label", this.label);
    this.camera.up.set(0, 0, 1);
    this.controls = new MapControls(this.camera, this.root);
    this.controls.zoomToCursor = true;
    this.controls.maxPolarAngle = Math.PI;
    this.controls.listenToKeyEvents(this.root);
    this.controls.keyPanSpeed = 30;
    this.controls.addEventListener("change", () => this.draw());
    const sun = new DirectionalLight(0xffffff, 2.4);
    sun.position.set(-0.5, 0.5, 0.8);
    this.scene.add(this.track, sun, new AmbientLight(0xffffff, 0.7));
    this.spot = dots([[0, 0, 0]], 0xffd23f, 14);
    this.spot.visible = false;
    this.scene.add(this.spot);
    this.addTrack(dive);
    this.listen();
    void this.load(about.whole ?? "");
  }

  /** Fit the drawing to its place. */
  resize(width: number, height: number): void {
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    if (!this.placed) this.home();
    this.placed = true;
    this.draw();
  }

  /** Look at all of the map from a slant. */
  home(): void {
    const box = new Box3();
    for (const each of Object.values(this.about.pieces)) box.expandByPoint(vector(each.low_m)).expandByPoint(vector(each.high_m));
    const center = box.getCenter(new Vector3());
    const size = Math.max(box.getSize(new Vector3()).length(), 0.1);
    this.controls.target.copy(center);
    this.camera.position.copy(center).add(new Vector3(-0.25, -0.75, 0.85).multiplyScalar(size * 0.8 * Math.max(1, 1.2 / this.camera.aspect)));
    this.camera.near = size / 2000;
    this.camera.far = size * 20;
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }

  /** Colors of the reef, or its relief alone. */
  showRelief(relief: boolean): void {
    this.relief = relief;
    for (const mesh of this.meshes.values()) mesh.material = this.material;
    this.draw();
  }

  showTrack(shown: boolean): void {
    this.track.visible = shown;
    this.draw();
  }

  /** Mark a spot, and bring it to the middle. */
  mark(spot_m: number[]): void {
    this.spot.position.set(spot_m[0], spot_m[1], spot_m[2]);
    this.spot.visible = true;
    this.draw();
  }

  private get material() {
    return this.relief ? this.shaded : this.plain;
  }

  private listen(): void {
    let down = new Vector2();
    this.root.addEventListener("pointerdown", (event) => (down = new Vector2(event.clientX, event.clientY)));
    this.root.addEventListener("click", (event) => {
      if (down.distanceTo(new Vector2(event.clientX, event.clientY)) < STILL_PX) this.pick(event);
    });
  }

  private pick(event: MouseEvent): void {
    const box = this.root.getBoundingClientRect();
    const place = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(place, this.camera);
    const hit = ray.intersectObjects([...this.meshes.values()].filter((mesh) => mesh.visible))[0];
    if (!hit) return;
    const spot = hit.point.toArray();
    this.mark(spot);
    this.clicked(spot);
  }

  private addTrack(dive: Dive): void {
    const places = dive.names.filter((name) => name in dive.poses).map((name) => [3, 7, 11].map((i) => dive.poses[name][i]));
    if (!places.length) return;
    const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(places.flat()), 3));
    this.track.add(new Line(geometry, new LineBasicMaterial({ color: 0x0a8f98 })), dots(places, 0x0a8f98, 6));
  }

  private async load(name: string): Promise<void> {
    if (!(name in this.about.pieces) || this.loading.has(name) || this.meshes.has(name)) return;
    this.loading.add(name);
    try {
      const mesh = new Mesh(await piece(name), this.material);
      this.meshes.set(name, mesh);
      this.scene.add(mesh);
    } finally {
      this.loading.delete(name);
    }
    this.draw();
  }

  /** Draw at the next frame; fine tiles are fetched where the viewer is near. */
  private draw(): void {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.refine();
      this.renderer.render(this.scene, this.camera);
    });
  }

  private refine(): void {
    const whole = this.meshes.get(this.about.whole ?? "");
    const tiles = Object.entries(this.about.pieces).filter(([name]) => name !== this.about.whole);
    if (!tiles.length || !whole) return;
    const distance = ([, each]: (typeof tiles)[number]) => new Box3(vector(each.low_m), vector(each.high_m)).distanceToPoint(this.camera.position);
    let budget = MOST_FINE_TRIANGLES;
    const wanted = new Set<string>();
    for (const tile of tiles.sort((a, b) => distance(a) - distance(b))) {
      const size = vector(tile[1].high_m).distanceTo(vector(tile[1].low_m));
      budget -= tile[1].triangles;
      if (budget < 0 || distance(tile) > 2 * size) break;
      wanted.add(tile[0]);
    }
    for (const [name, mesh] of this.meshes) {
      if (mesh === whole || wanted.has(name)) continue;
      mesh.geometry.dispose();
      this.scene.remove(mesh);
      this.meshes.delete(name);
    }
    for (const name of wanted) void this.load(name);
    const fine = [...this.meshes.keys()].filter((name) => name !== this.about.whole);
    whole.visible = fine.length < tiles.length;
    whole.material = fine.length && !this.relief ? this.behind : this.material;
  }

  /** The coarse surface a little behind the fine one, so that it does not shine through. */
  private readonly behind = new MeshBasicMaterial({ vertexColors: true, side: 2, polygonOffset: true, polygonOffsetFactor: 4, polygonOffsetUnits: 400 });
}

function dots(places: number[][], color: number, size: number): Points {
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(places.flat()), 3));
  return new Points(geometry, new PointsMaterial({ color: new Color(color), size, sizeAttenuation: false, depthTest: size < 10 }));
}

function vector([x, y, z]: number[]): Vector3 {
  return new Vector3(x, y, z);
}
