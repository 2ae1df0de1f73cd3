// Orthomosaic and terrain from above, with deep zoom; light and shade, and the squares of the metrics, over them.

import OpenSeadragon from "openseadragon";
import type { About, Place } from "./about";

const TILE_PX = 512;
const FIRST_LEVEL = 8;

export type Flat = "mosaic" | "raw" | "terrain";

/** A spot from above, in the map's own coordinates. pixel_m: how large a pixel of the screen is. */
export interface FlatHit {
  spot_m: [number, number];
  pixel_m: number;
}

/** A viewer of the mosaic, or of the terrain; a click gives the spot in the map. */
export class Mosaic {
  private readonly viewer: OpenSeadragon.Viewer;
  private readonly base: Place | undefined;
  private shown = "";

  constructor(
    private readonly root: HTMLElement,
    private readonly about: About,
    clicked: (hit: FlatHit) => void,
    drawn: () => void,
  ) {
    this.base = about.terrain ?? about.mosaic;
    this.viewer = OpenSeadragon({
      element: root,
      drawer: "canvas", // the others read pixels back, which pages from files may not
      showNavigationControl: false,
      showNavigator: false,
      gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: false },
      maxZoomPixelRatio: 8,
      visibilityRatio: 0.3,
      crossOriginPolicy: false,
      preserveViewport: true,
    });
    // else the viewer takes the focus at a click, and the page jumps to it
    root.addEventListener("pointerdown", () => this.viewer.canvas.focus({ preventScroll: true }), { capture: true });
    this.viewer.addHandler("canvas-click", (event) => {
      const hit = this.hit(event.position);
      if (event.quick && hit) clicked(hit);
    });
    for (const name of ["update-viewport", "open", "resize"] as const) this.viewer.addHandler(name, drawn);
  }

  /** Show a picture of the map, with or without light and shade over it. */
  show(flat: Flat, hillshade: boolean): void {
    const wanted = `${flat} ${hillshade}`;
    if (wanted === this.shown) return;
    this.shown = wanted;
    const { mosaic, raw, terrain, gaps, preview } = this.about;
    const place = { mosaic, raw, terrain }[flat];
    const layers = place ? [this.layer(flat, place)] : [{ tileSource: { type: "image", url: preview, crossOriginPolicy: false, buildPyramid: false } }];
    if (hillshade && terrain && place && flat !== "terrain") layers.push({ ...this.layer("hillshade", terrain), compositeOperation: "multiply" } as never);
    if (gaps && place) layers.push(this.layer("gaps", gaps));
    this.viewer.open(layers as never);
  }

  zoom(factor: number): void {
    this.viewer.viewport.zoomBy(factor);
    this.viewer.viewport.applyConstraints();
  }

  /** Move a spot into the middle. */
  center(x_m: number, y_m: number): void {
    const [base, { offset_m }] = [this.base, this.about];
    if (!base) return;
    const wide_m = base.width * base.pixel_m;
    this.viewer.viewport.panTo(new OpenSeadragon.Point((x_m + offset_m[0] - base.west_m) / wide_m, (base.north_m - y_m - offset_m[1]) / wide_m));
  }

  /** How large a pixel of the screen is, meters; 0 before anything is shown. */
  get pixel_m(): number {
    const { base, viewer } = this;
    return base && viewer.viewport && viewer.world.getItemCount() ? (base.width * base.pixel_m) / (viewer.viewport.getZoom(true) * this.root.clientWidth) : 0;
  }

  /** The spot at a place of the window. */
  at(clientX: number, clientY: number): FlatHit | null {
    const box = this.root.getBoundingClientRect();
    return this.hit(new OpenSeadragon.Point(clientX - box.left, clientY - box.top));
  }

  /** Where a spot lies on the screen, in pixels of the viewer. */
  project(x_m: number, y_m: number): [number, number] | null {
    const [base, { offset_m }, viewport] = [this.base, this.about, this.viewer.viewport];
    if (!base || !viewport) return null;
    const wide_m = base.width * base.pixel_m;
    const place = new OpenSeadragon.Point((x_m + offset_m[0] - base.west_m) / wide_m, (base.north_m - y_m - offset_m[1]) / wide_m);
    const { x, y } = viewport.viewportToViewerElementCoordinates(place);
    return [x, y];
  }

  /** Turn dragging on or off, while a point is dragged. */
  hold(held: boolean): void {
    this.viewer.setMouseNavEnabled(!held);
  }

  private hit(position: OpenSeadragon.Point): FlatHit | null {
    const [base, { offset_m }, viewport] = [this.base, this.about, this.viewer.viewport];
    if (!base || !viewport) return null;
    const wide_m = base.width * base.pixel_m;
    const { x, y } = viewport.viewerElementToViewportCoordinates(position);
    const spot_m: [number, number] = [base.west_m + x * wide_m - offset_m[0], base.north_m - y * wide_m - offset_m[1]];
    return { spot_m, pixel_m: wide_m / (viewport.getZoom(true) * this.root.clientWidth) };
  }

  private layer(name: string, place: Place): { tileSource: object } {
    const base = this.base as Place;
    const wide_m = base.width * base.pixel_m;
    const tileSource = {
      width: place.width,
      height: place.height,
      tileSize: TILE_PX,
      minLevel: Math.min(FIRST_LEVEL, Math.ceil(Math.log2(Math.max(place.width, place.height)))),
      getTileUrl: (level: number, x: number, y: number) => `page/map/${name}/${level}/${x}_${y}.webp`,
    };
    const where = { x: (place.west_m - base.west_m) / wide_m, y: (base.north_m - place.north_m) / wide_m, width: (place.width * place.pixel_m) / wide_m };
    return { tileSource, ...where };
  }
}
