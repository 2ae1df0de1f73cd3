// Orthomosaic and terrain from above, with deep zoom.

import OpenSeadragon from "openseadragon";
import type { About } from "./scene";

const TILE_PX = 512;
const FIRST_LEVEL = 8;

/** A viewer of the mosaic, or of the terrain; a click gives the spot in the world. */
export class Mosaic {
  private readonly viewer: OpenSeadragon.Viewer;

  constructor(
    root: HTMLElement,
    private readonly about: About,
    clicked: (x_m: number, y_m: number) => void,
  ) {
    this.viewer = OpenSeadragon({
      element: root,
      drawer: "canvas", // the others read pixels back, which pages from files may not
      showNavigationControl: false,
      showNavigator: false,
      gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true },
      maxZoomPixelRatio: 8,
      visibilityRatio: 0.3,
      crossOriginPolicy: false,
    });
    this.viewer.addHandler("canvas-click", (event) => {
      if (!event.quick) return;
      const item = this.viewer.world.getItemAt(0);
      const place = this.terrain ? this.about.terrain : this.about.mosaic;
      if (!item || !place) return;
      const pixel = item.viewerElementToImageCoordinates(event.position);
      const size = item.getContentSize();
      clicked(place.west_m + (pixel.x / size.x) * place.width * place.pixel_m, place.north_m - (pixel.y / size.y) * place.height * place.pixel_m);
    });
  }

  private terrain = false;

  /** Show the mosaic or the terrain. */
  show(terrain: boolean): void {
    this.terrain = terrain;
    const image = (url: string) => ({ type: "image", url, crossOriginPolicy: false, buildPyramid: false });
    this.viewer.open((terrain ? image("page/map/terrain.webp") : this.about.mosaic ? this.tiles() : image(this.about.preview)) as never);
  }

  zoom(factor: number): void {
    this.viewer.viewport.zoomBy(factor);
    this.viewer.viewport.applyConstraints();
  }

  private tiles(): object {
    const { width, height } = this.about.mosaic ?? { width: 1, height: 1 };
    return {
      width,
      height,
      tileSize: TILE_PX,
      minLevel: Math.min(FIRST_LEVEL, Math.ceil(Math.log2(Math.max(width, height)))),
      getTileUrl: (level: number, x: number, y: number) => `page/map/mosaic/${level}/${x}_${y}.webp`,
    };
  }
}
