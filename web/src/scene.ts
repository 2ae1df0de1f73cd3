// The reef in three dimensions: coarse as a whole, fine where the viewer is near; the track above it.

import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  Color,
  Group,
  ColorManagement,
  Line,
  LinearSRGBColorSpace,
  LineBasicMaterial,
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
import type { About, Piece } from "./about";
import { posesOf } from "./blocks";
import type { Dive } from "./dive";
import { Detail, vector } from "./lod";

ColorManagement.enabled = false; // colors are drawn as they are stored: to turn each pixel's into linear light and back takes a tenth of a picture where there is no graphics card

const STILL_PX = 4;
const TRACK_STEP_PX = 150;
const MOST_WHOLE = 4; // blocks of the track: lines side by side are hundreds

/** Levels of detail: so coarse may a cell of the mesh be on the screen; more where drawing is slow and the view moves. */
const FINEST_PX = 1.6;
const COARSEST_PX = 24;
const SLOW_MS = 36; // thirty pictures a second are not slow
const QUICK_MS = 25;
const STILL_RATIO = 2; // pixels of the drawing to one of the page: smooth edges, once nothing moves, on any graphics card
const MOVING_RATIOS: [number, number][] = [[12, 1 / 3], [5, 0.5], [2.5, 0.75], [0, 1]]; // from so coarse a mesh on, so many pixels to one of the screen
const STILL_MS = 400;
const AIM_MS = 150; // between two looks for the reef: one takes some ms on a large map
const MOST_COARSER = 2; // at once: one slow picture may have had another cause

/** A spot of the mesh under the pointer. cell_m: how fine the mesh is there. pixel_m: how large a pixel of the screen. */
export interface Hit {
  spot_m: [number, number, number];
  cell_m: number;
  pixel_m: number;
}

/** The line of sight through a place of the window: where it begins, and its direction. */
export interface Sight {
  origin_m: number[];
  direction: number[];
}

const SLANT = new Vector3(-0.25, -0.75, 0.85);
const CENTERINGS = 4;
const MOST_CORNERED = 256; // pieces: of a map of 100,000 frames, all corners take minutes
const FULL = 0.98; // so much of the drawing's half width and height the whole map takes

/** The track of a block of frames, by some of its places, and by all once they are loaded. next: the first place of the next block. */
interface TrackPart {
  number: number;
  next: number[][];
  whole: boolean; // some are all
  some: Group;
  all: Group | null;
  places: Vector3[];
  step_m: number; // between two of them, the median
}

export class Scene {
  readonly root: HTMLElement;
  private readonly scene = new Three();
  private readonly camera = new PerspectiveCamera(45, 1, 0.05, 2000);
  private readonly renderer = renderer();
  private readonly controls: MapControls;
  private readonly plain = new MeshBasicMaterial({ vertexColors: true, side: 2 });
  private readonly shaded = new MeshLambertMaterial({ color: 0xb9c4c6, flatShading: true, side: 2 });
  private readonly colored: Detail;
  private readonly textured: Detail | null;
  private detail: Detail;
  private readonly track = new Three();
  private readonly trackParts: TrackPart[] = [];
  private readonly spot: Points;
  private relief = false;
  private raw = false;
  private waiting = false;
  private moving_px = FINEST_PX;
  private drawn_ms = 0;
  private still = 0;
  private moving = false;
  private fitted = false;
  private atHome = true;
  private aimed_ms = -Infinity;

  constructor(
    private readonly about: About,
    private readonly dive: Dive,
    private readonly label: string,
    private readonly clicked: (hit: Hit) => void,
    private readonly missed: (sight: Sight) => void,
    private readonly drawn: () => void,
  ) {
    this.renderer.setPixelRatio(STILL_RATIO);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
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
    this.controls.addEventListener("change", () => this.move());
    const sun = new DirectionalLight(0xffffff, 1.55);
    sun.position.set(-0.5, 0.5, 0.8);
    this.scene.add(this.track, sun, new AmbientLight(0xffffff, 1.57));
    this.spot = dots([[0, 0, 0]], 0xffd23f, 14);
    this.spot.visible = false;
    this.scene.add(this.spot);
    this.addTrack();
    this.listen();
    this.colored = new Detail(about.pieces, this.plain, () => this.loaded());
    this.textured = about.textured ? new Detail(about.textured, this.plain, () => this.loaded()) : null;
    this.detail = this.textured ?? this.colored;
    this.scene.add(this.detail.root);
  }

  /** Fit the drawing to its place. */
  resize(width: number, height: number): void {
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    if (this.atHome) this.home();
    else this.draw();
  }

  /** Look at all of the map from a slant. */
  home(): void {
    const box = new Box3();
    for (const each of Object.values(this.about.pieces)) box.expandByPoint(vector(each.low_m)).expandByPoint(vector(each.high_m));
    const center = box.getCenter(new Vector3());
    const size = Math.max(box.getSize(new Vector3()).length(), 0.1);
    this.camera.near = size / 2000;
    this.camera.far = size * 20;
    const corners = this.outline();
    for (let turn = 0; turn < CENTERINGS; turn++) this.fit(center, size, corners);
    this.controls.target.copy(center);
    this.controls.update();
    this.draw();
  }

  /** Go so far away from a point that all corners are seen, and move the point to their middle on the screen. */
  private fit(center: Vector3, size: number, corners: Vector3[]): void {
    const seen = () => corners.map((corner) => corner.clone().project(this.camera));
    this.camera.updateProjectionMatrix();
    for (let away = 0.3; away < 5; away *= 1.06) {
      this.camera.position.copy(center).addScaledVector(SLANT, size * away);
      this.camera.lookAt(center);
      this.camera.updateMatrixWorld();
      if (seen().every(({ x, y }) => Math.max(Math.abs(x), Math.abs(y)) < FULL)) break;
    }
    const box = new Box3().setFromPoints(seen());
    const middle = box.getCenter(new Vector3());
    const half_m = this.camera.position.distanceTo(center) * Math.tan((this.camera.fov * Math.PI) / 360);
    const [right, up] = [0, 1].map((column) => new Vector3().setFromMatrixColumn(this.camera.matrixWorld, column));
    const moved = right.multiplyScalar(middle.x * half_m * this.camera.aspect).addScaledVector(up, middle.y * half_m);
    center.add(moved);
    this.camera.position.add(moved);
  }

  /** What the view of the whole map must hold: its vertices once it is loaded coarsely, else the corners of the finest pieces of which there are few enough. */
  private outline(): Vector3[] {
    const loaded = this.detail.outline() ?? this.textured?.outline() ?? this.colored.outline();
    if (loaded) return loaded;
    const levels = new Map<number, Piece[]>();
    for (const each of Object.values(this.about.pieces)) {
      const level = levels.get(each.cell_m) ?? [];
      level.push(each);
      levels.set(each.cell_m, level);
    }
    const few = [...levels].filter(([, pieces]) => pieces.length <= MOST_CORNERED).sort(([a], [b]) => a - b);
    return (few[0]?.[1] ?? []).flatMap(({ low_m, high_m }) => cornersOf(low_m, high_m));
  }

  /** The whole map is there, if coarsely: the view fits it, if nobody has moved it yet. */
  private loaded(): void {
    if (!this.fitted && this.atHome && this.detail.outline()) {
      this.fitted = true;
      this.home();
    } else this.draw();
  }

  /** Colors of the reef, or its relief alone. */
  showRelief(relief: boolean): void {
    this.relief = relief;
    this.colored.setMaterial(relief ? this.shaded : this.plain);
    this.choose();
  }

  /** Colors as the camera saw them, or corrected. */
  showRaw(raw: boolean): void {
    this.raw = raw;
    this.choose();
  }

  /** The images lie on the reef where its corrected colors are shown. */
  private choose(): void {
    this.scene.remove(this.detail.root);
    this.detail = this.textured && !this.relief && !this.raw ? this.textured : this.colored;
    this.scene.add(this.detail.root);
    this.draw();
  }

  /** Where a point lies on the screen, in pixels of the drawing; null behind the viewer. */
  project(point_m: number[]): [number, number] | null {
    const place = vector(point_m).project(this.camera);
    const { clientWidth, clientHeight } = this.root;
    return place.z < 1 ? [((place.x + 1) / 2) * clientWidth, ((1 - place.y) / 2) * clientHeight] : null;
  }

  /** The spot of the reef at a place of the window; null beside it. */
  at(clientX: number, clientY: number): Hit | null {
    const hit = this.through(clientX, clientY).intersectObjects(this.detail.shown, false)[0];
    if (!hit) return null;
    return { spot_m: hit.point.toArray(), cell_m: this.detail.cell_m(hit.object), pixel_m: hit.distance / this.pixels };
  }

  private through(clientX: number, clientY: number): Raycaster {
    const box = this.root.getBoundingClientRect();
    const place = new Vector2(((clientX - box.left) / box.width) * 2 - 1, 1 - ((clientY - box.top) / box.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(place, this.camera);
    return ray;
  }

  /** How many pixels a meter is at a distance of a meter. */
  private get pixels(): number {
    return this.root.clientHeight / (2 * Math.tan((this.camera.fov * Math.PI) / 360));
  }

  /** Turn dragging on or off, while a point is dragged. */
  hold(held: boolean): void {
    this.controls.enabled = !held;
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

  private listen(): void {
    let down = new Vector2();
    this.root.addEventListener("pointerdown", () => this.aim(null), { capture: true });
    this.root.addEventListener("wheel", (event) => this.aim(event), { capture: true, passive: true });
    for (const touched of ["pointerdown", "wheel", "keydown"]) this.root.addEventListener(touched, () => (this.atHome = false));
    this.root.addEventListener("pointerdown", (event) => (down = new Vector2(event.clientX, event.clientY)));
    this.root.addEventListener("click", (event) => {
      if (down.distanceTo(new Vector2(event.clientX, event.clientY)) < STILL_PX) this.pick(event);
    });
  }

  /**
   * Let the controls turn around the reef in the middle of the view, and zoom by its distance or that of the reef under a pointer.
   * They keep a height of the whole map instead: near the reef the view would be thrown off it. The view stays as it is.
   */
  private aim(pointer: MouseEvent | null): void {
    const now_ms = performance.now();
    if (pointer && now_ms - this.aimed_ms < AIM_MS) return;
    this.aimed_ms = now_ms;
    const box = this.root.getBoundingClientRect();
    const middle = this.at(box.left + box.width / 2, box.top + box.height / 2);
    const hit = (pointer && this.at(pointer.clientX, pointer.clientY)) ?? middle;
    const spot = hit ? vector(hit.spot_m) : this.nearMiddle();
    if (!spot) return;
    const { position } = this.camera;
    const ahead = this.camera.getWorldDirection(new Vector3());
    this.controls.target.copy(position).addScaledVector(ahead, Math.max(spot.sub(position).dot(ahead), this.camera.near));
  }

  /** Where the reef is not in the middle of the view: the loaded vertex nearest to that on the screen. */
  private nearMiddle(): Vector3 | undefined {
    const far = (point: Vector3) => {
      const { x, y, z } = point.clone().project(this.camera);
      return z < 1 ? Math.hypot(x * this.camera.aspect, y) : Infinity;
    };
    const all = this.detail.sample().map((point): [number, Vector3] => [far(point), point]);
    return all.length ? all.reduce((best, each) => (each[0] < best[0] ? each : best))[1] : undefined;
  }

  private pick(event: MouseEvent): void {
    const hit = this.at(event.clientX, event.clientY);
    if (hit) this.clicked(hit);
    else {
      const { origin, direction } = this.through(event.clientX, event.clientY).ray;
      this.missed({ origin_m: origin.toArray(), direction: direction.toArray() });
    }
  }

  /** The track of each block of frames, as far as the next block. */
  private addTrack(): void {
    const { blocks } = this.dive;
    for (const [number, each] of blocks.entries()) {
      if (!each) continue;
      const next = blocks.slice(number + 1).find((other) => other)?.track.slice(0, 1) ?? [];
      const places = each.track.map(vector);
      const steps_m = places.slice(1).map((place, i) => place.distanceTo(places[i])).sort((a, b) => a - b);
      const part: TrackPart = { number, next, whole: places.length >= each.frames, some: trackOf(each.track, next), all: null, places, step_m: steps_m[steps_m.length >> 1] ?? 0 };
      this.trackParts.push(part);
      this.track.add(part.some);
    }
  }

  /** All places are drawn of the few nearest blocks, where some places are far from each other on the screen. */
  private refineTrack(): void {
    if (!this.track.visible) return;
    const away = this.trackParts.filter(({ whole }) => !whole).map((part) => {
      const nearest_m = part.places.reduce((least, place) => Math.min(least, place.distanceTo(this.camera.position)), Infinity);
      return { part, nearest_m };
    });
    away.sort((one, other) => one.nearest_m - other.nearest_m);
    for (const [order, { part, nearest_m }] of away.entries()) {
      const isNear = order < MOST_WHOLE && part.step_m * this.pixels > TRACK_STEP_PX * nearest_m;
      part.some.visible = !isNear || !part.all?.children.length;
      if (part.all) part.all.visible = isNear;
      else if (isNear) {
        const all = (part.all = new Group());
        this.track.add(all);
        void posesOf(this.dive, part.number).then((poses) => {
          all.add(...trackOf(poses.map(([, pose]) => [3, 7, 11].map((i) => pose[i])), part.next).children);
          this.draw();
        });
      }
    }
  }

  /** Draw while the view moves: coarser where that is slow, and as fine as may be once it stands still. */
  private move(): void {
    clearTimeout(this.still);
    this.moving = true;
    this.draw();
  }

  /** After a picture of a moving view: unless another movement follows, it stands still. */
  private rest(): void {
    clearTimeout(this.still);
    this.still = window.setTimeout(() => {
      this.moving = false;
      this.drawn_ms = 0;
      this.draw();
    }, STILL_MS);
  }

  private get coarsest_px(): number {
    return this.moving ? this.moving_px : FINEST_PX;
  }

  /** From picture to picture of a moving view: how long drawing takes tells how fine it can be; triangles go by its square. */
  private keepPace(): void {
    const now_ms = performance.now();
    const took_ms = now_ms - this.drawn_ms;
    if (this.moving && this.drawn_ms) {
      if (took_ms > SLOW_MS) this.moving_px = Math.min(this.moving_px * Math.min(Math.sqrt(took_ms / SLOW_MS), MOST_COARSER), COARSEST_PX);
      else if (took_ms < QUICK_MS) this.moving_px = Math.max(this.moving_px * 0.95, FINEST_PX);
    }
    this.drawn_ms = now_ms;
  }

  /** Fewer pixels where drawing is slow and the view moves. */
  private get ratio(): number {
    if (!this.moving) return STILL_RATIO;
    const [, part] = MOVING_RATIOS.find(([from_px]) => this.moving_px >= from_px) as [number, number];
    return part * Math.min(devicePixelRatio, STILL_RATIO);
  }

  /** Draw at the next frame; finer pieces are fetched where the viewer is near. */
  private draw(): void {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.keepPace();
      if (this.ratio !== this.renderer.getPixelRatio()) this.renderer.setPixelRatio(this.ratio);
      if (!this.moving) this.renderer.setClearColor(new Color(getComputedStyle(this.root).backgroundColor));
      this.refineTrack();
      this.detail.update(this.camera, this.pixels * Math.min(devicePixelRatio, 2), this.coarsest_px);
      this.renderer.render(this.scene, this.camera);
      this.root.dataset.triangles = String(this.detail.triangles);
      this.root.ariaBusy = String(this.moving || this.detail.busy);
      if (this.moving) this.rest();
      this.drawn();
    });
  }
}

/** Without multisampling, which takes half of the time where there is no graphics card, and opaque: to mix it with what lies below takes a third of the rest. */
function renderer(): WebGLRenderer {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("webgl2", { alpha: false, antialias: false });
  if (!context) throw new Error("no WebGL 2");
  const made = new WebGLRenderer({ canvas, context });
  made.outputColorSpace = LinearSRGBColorSpace; // as it is
  return made;
}

function cornersOf(low_m: number[], high_m: number[]): Vector3[] {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((i) => vector([0, 1, 2].map((axis) => ((i >> axis) & 1 ? high_m : low_m)[axis])));
}

/** A line through places and on to a next one, with dots at the former. */
function trackOf(places: number[][], next: number[][]): Group {
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array([...places, ...next].flat()), 3));
  return new Group().add(new Line(geometry, new LineBasicMaterial({ color: 0x0a8f98 })), dots(places, 0x0a8f98, 6));
}

function dots(places: number[][], color: number, size: number): Points {
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(places.flat()), 3));
  return new Points(geometry, new PointsMaterial({ color: new Color(color), size, sizeAttenuation: false, depthTest: size < 10 }));
}
