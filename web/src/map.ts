// START HERE for the map: three dimensions, mosaic, terrain; a click on the reef shows the frames that saw the spot.

import type { About } from "./about";
import { takeBlocks } from "./blocks";
import type { Dive, Text } from "./dive";
import { picture } from "./dive";
import { Cover } from "./cover";
import { button, Choice, element, readable, select } from "./elements";
import { gapAt, gapOnSight } from "./gaps";
import { MapMeasuring, type Clicked } from "./mapmeasuring";
import { Mosaic, type Flat } from "./mosaic";
import { HEIGHT_COLORS, scaleBar } from "./scale";
import { Scene, type Sight } from "./scene";
import { seecolor } from "./shared";
import { isVisible, sightings, type Sighting } from "./seen";
import { drawSquares, span, squaresOf, type Square } from "./squares";

let about: About | null = null;
seecolor.map = (given: About) => (about = given);
seecolor.showMap = (section, dive, text, look) => {
  if (seecolor.blockOf) takeBlocks(seecolor.blockOf);
  if (about) new MapView(section, about, dive, text, look);
};

const BAR_PX = 120;

type View = "scene" | "relief" | "mosaic" | "terrain";

/** What belongs to which views. */
type Tools = Record<"scene" | "flat" | "shade" | "colors", HTMLElement[]>;

class MapView {
  private readonly stage = element("div", { class: "map-stage" });
  private readonly work = element("div", { class: "map-work" }, this.stage);
  private readonly flat = element("div", { class: "map-flat" });
  private readonly squares = element("canvas", { class: "map-squares", "aria-hidden": "true" });
  private readonly legend = element("div", { class: "legend" });
  private readonly marks = element("div", { class: "map-marks", "aria-hidden": "true" });
  private readonly cover: Cover | null;
  private spot_m: number[] | null = null;
  private readonly found = element("div", { class: "found", role: "status" });
  private readonly tools: Tools;
  private readonly measuring: MapMeasuring | null;
  private scene: Scene | null = null;
  private mosaic: Mosaic | null = null;
  private view: View = "mosaic";
  private raw = false;
  private hillshade = false;
  private metric = -1;
  private ofMetric: Square[] = [];
  private turn = 0;
  private readonly choice: Choice;

  constructor(
    section: HTMLElement,
    private readonly about: About,
    private readonly dive: Dive,
    private readonly text: Text,
    private readonly look: (name: string) => void,
  ) {
    this.measuring = about.terrain && seecolor.table ? new MapMeasuring(about, dive, text, seecolor.table, this.eye()) : null;
    this.cover = this.measuring ? new Cover(about, dive, text, this.measuring.ground.heights, this.measuring.measures, (spot_m) => this.showPoint(spot_m)) : null;
    seecolor.table?.watch(() => this.pointsChanged());
    if (this.cover) this.work.append(this.cover.bar);
    this.tools = this.madeTools();
    const views = this.views();
    const choice = (this.choice = new Choice(text("map.view"), views, (view) => this.show(view as View)));
    section.replaceChildren(
      element("div", { class: "toolbar" }, choice.root, ...this.tools.colors, ...this.tools.scene, ...this.tools.shade, ...this.tools.flat),
      ...(this.measuring ? [element("div", { class: "toolbar" }, this.measuring.tool)] : []),
      this.work,
      this.legend,
      element("p", { class: "hint" }, text("map.hint")),
      ...(this.measuring ? [this.measuring.root] : []),
      this.found,
      ...(this.cover ? [this.cover.root] : []),
    );
    new ResizeObserver(() => this.resized()).observe(this.stage);
    this.stage.addEventListener("keydown", (event) => this.key(event), true);
    addEventListener("hashchange", () => location.hash === "#map" && this.measuring?.show());
    this.measuring?.show();
    choice.show(views[0][0]);
    this.show(views[0][0]);
  }

  private views(): [View, string][] {
    const { about, text } = this;
    const views: [View, string][] = Object.keys(about.pieces).length ? [["scene", text("map.scene")], ["relief", text("map.relief")]] : [];
    views.push(["mosaic", text("map.mosaic_short")]);
    if (about.terrain) views.push(["terrain", text("map.terrain")]);
    return views;
  }

  private madeTools(): Tools {
    const { about, text } = this;
    const track = toggle(text("map.track"), true, (shown) => this.scene?.showTrack(shown));
    const zoom = [
      button("+", () => this.mosaic?.zoom(1.5), { "aria-label": text("map.closer") }),
      button("−", () => this.mosaic?.zoom(1 / 1.5), { "aria-label": text("map.farther") }),
    ];
    const raw = toggle(text("map.raw"), false, (shown) => {
      this.raw = shown;
      this.show(this.view);
    });
    const shade = toggle(text("map.hillshade"), false, (shown) => {
      this.hillshade = shown;
      this.show(this.view);
    });
    const squares = about.squares ? [this.metrics()] : [];
    return {
      scene: [track, button(text("map.home"), () => this.scene?.home())],
      shade: about.terrain ? [shade] : [],
      flat: [...squares, element("span", { class: "pair" }, ...zoom)],
      colors: about.raw ? [raw] : [],
    };
  }

  private metrics(): HTMLElement {
    const names = this.about.squares?.names ?? [];
    const options: [string, string][] = [["-1", this.text("map.no_squares")], ...names.map((name, i): [string, string] => [String(i), this.metricName(name)])];
    return select(this.text("map.squares"), options, (number) => {
      this.metric = Number(number);
      void this.loadSquares(this.metric);
    });
  }

  private async loadSquares(metric: number): Promise<void> {
    const loaded = metric < 0 ? [] : await squaresOf(metric);
    if (metric !== this.metric) return;
    this.ofMetric = loaded;
    this.drawOver();
  }

  /** Directions are named after the compass only where north is known. */
  private metricName(name: string): string {
    return this.text(name === "aspect_deg" && !this.dive.north ? "metric.aspect_local" : `metric.${name}`);
  }

  /** A random point, in the middle of the map from above, which is in sight as a whole. */
  private showPoint(spot_m: [number, number] | null): void {
    if (this.isSolid) this.choice.show("mosaic");
    if (this.isSolid) this.show("mosaic");
    if (spot_m) this.mosaic?.center(...spot_m);
    this.drawOver();
    this.work.scrollIntoView({ block: "nearest" });
  }

  /** The random points were changed, perhaps in another tab. */
  private pointsChanged(): void {
    this.cover?.draw();
    this.drawMarks();
  }

  /** The view that is shown, as measuring needs it. */
  private eye() {
    return {
      project: (point: number[]) => (this.isSolid ? (this.scene?.project(point) ?? null) : (this.mosaic?.project(point[0], point[1]) ?? null)),
      at: (x: number, y: number): Clicked | null => this.at(x, y),
      hold: (held: boolean) => {
        this.scene?.hold(held);
        this.mosaic?.hold(held);
      },
    };
  }

  private at(x: number, y: number): Clicked | null {
    if (this.isSolid) return this.scene?.at(x, y) ?? null;
    const hit = this.mosaic?.at(x, y);
    return hit ? { ...hit, cell_m: 0 } : null;
  }

  private get isSolid(): boolean {
    return this.view === "scene" || this.view === "relief";
  }

  private show(view: View): void {
    this.view = view;
    for (const tool of this.tools.scene) tool.hidden = !this.isSolid;
    for (const tool of this.tools.flat) tool.hidden = this.isSolid;
    for (const tool of this.tools.shade) tool.hidden = this.isSolid || view === "terrain" || !(this.raw ? this.about.raw : this.about.mosaic);
    for (const tool of this.tools.colors) tool.hidden = view === "relief" || view === "terrain";
    if (this.isSolid) this.showScene(view === "relief");
    else this.showFlat(view === "terrain" ? "terrain" : this.raw ? "raw" : "mosaic");
    this.drawOver();
  }

  private showScene(relief: boolean): void {
    try {
      this.scene ??= new Scene(this.about, this.dive, this.text("map.label"), (hit) => this.clicked(hit), (sight) => void this.missed(sight), () => this.drawOver());
    } catch {
      this.stage.replaceChildren(element("p", { class: "empty" }, this.text("map.no_webgl")));
      return;
    }
    this.stage.replaceChildren(this.scene.root, ...this.over());
    this.scene.showRelief(relief);
    this.scene.showRaw(this.raw);
    this.resized();
  }

  private showFlat(flat: Flat): void {
    this.stage.replaceChildren(this.flat, this.squares, ...this.over());
    const clicked = ({ spot_m, pixel_m }: { spot_m: number[]; pixel_m: number }) => this.clicked({ spot_m, pixel_m, cell_m: 0 });
    this.mosaic ??= new Mosaic(this.flat, this.about, clicked, () => this.drawOver());
    this.mosaic.show(flat, this.hillshade);
  }

  private over(): Element[] {
    return [...(this.measuring ? [this.measuring.overlay] : []), this.marks];
  }

  private resized(): void {
    this.scene?.resize(this.stage.clientWidth, this.stage.clientHeight);
    this.drawOver();
  }

  /** What lies over the view: the squares and the measures. */
  private drawOver(): void {
    this.measuring?.draw();
    const { squares } = this.about;
    const shown = !this.isSolid && squares !== undefined && this.metric >= 0;
    this.squares.hidden = !shown;
    this.legend.replaceChildren();
    this.drawMarks();
    const { terrain } = this.about;
    if (this.view === "terrain" && terrain && !shown) {
      this.legend.append(scaleBar(terrain.low_m, terrain.high_m, this.text("map.height_unit"), false, HEIGHT_COLORS));
    }
    if (!shown || !squares) return;
    drawSquares(this.squares, this.ofMetric, squares.edge_m, (x, y) => this.mosaic?.project(x, y) ?? null);
    this.legend.append(scaleBar(...span(this.ofMetric), this.squaresTitle(squares.names[this.metric], squares.scale_m), false));
  }

  private squaresTitle(name: string, scale_m: number): string {
    return this.text("map.at_scale", { metric: this.metricName(name), scale: readable(1000 * scale_m) });
  }

  /** The clicked spot and the random point; from above also a bar of round length, and north where it is known. */
  private drawMarks(): void {
    const mark = (spot_m: number[] | null, name: string) => {
      const place = spot_m && (this.isSolid ? this.scene?.project(spot_m) : this.mosaic?.project(spot_m[0], spot_m[1]));
      return place ? [element("span", { class: `spot ${name}`, style: `left:${place[0]}px;top:${place[1]}px` })] : [];
    };
    const pixel_m = this.isSolid ? 0 : (this.mosaic?.pixel_m ?? 0);
    const power = 10 ** Math.floor(Math.log10(BAR_PX * pixel_m || 1));
    const bar_m = (BAR_PX * pixel_m >= 5 * power ? 5 : BAR_PX * pixel_m >= 2 * power ? 2 : 1) * power;
    const bar = pixel_m ? [element("span", { class: "map-bar", style: `width:${bar_m / pixel_m}px` }, bar_m < 1 ? this.text("unit.cm", { value: readable(100 * bar_m) }) : this.text("unit.m", { value: readable(bar_m) }))] : [];
    const north = pixel_m && this.dive.north ? [element("span", { class: "map-north" }, this.text("map.north"))] : [];
    this.marks.replaceChildren(...mark(this.spot_m, "clicked"), ...(this.isSolid ? [] : mark(this.cover?.current ?? null, "point")), ...bar, ...north);
  }

  private clicked(hit: Clicked): void {
    if (this.measuring?.isOn) void this.measuring.add(hit);
    else void this.seen(hit.spot_m);
  }

  /** A click beside the reef in three dimensions: through a gap of it, perhaps. */
  private async missed(sight: Sight): Promise<void> {
    if (!this.measuring || this.measuring.isOn) return;
    const [low_m, high_m] = this.heights_m();
    const spot_m = await gapOnSight(this.measuring.ground.heights, sight, low_m, high_m);
    if (spot_m) void this.seen(spot_m);
  }

  private key(event: KeyboardEvent): void {
    const box = this.stage.getBoundingClientRect();
    if (!this.measuring?.key(event, this.at(box.left + box.width / 2, box.top + box.height / 2))) return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** A spot with its height: on the terrain where it was clicked from above, or on that around it. */
  private async onReef([x_m, y_m, z_m]: number[]): Promise<number[]> {
    const height_m = z_m ?? (await this.measuring?.height(x_m, y_m)) ?? NaN;
    if (!Number.isNaN(height_m)) return [x_m, y_m, height_m];
    const around_m = this.measuring?.ground.heights.nearest(x_m, y_m) ?? NaN;
    if (!Number.isNaN(around_m)) return [x_m, y_m, around_m];
    const [low_m, high_m] = this.heights_m();
    return [x_m, y_m, (low_m + high_m) / 2];
  }

  /** The lowest and the highest of the map. */
  private heights_m(): [number, number] {
    const all = Object.values(this.about.pieces);
    return [Math.min(...all.map((each) => each.low_m[2])), Math.max(...all.map((each) => each.high_m[2]))];
  }

  private async seen(clicked_m: number[]): Promise<void> {
    const turn = ++this.turn;
    const spot_m = await this.onReef(clicked_m);
    this.spot_m = spot_m;
    this.drawOver();
    const all = await sightings(this.dive, spot_m);
    const gap = this.measuring ? await gapAt(this.measuring.ground.heights, spot_m[0], spot_m[1]) : 0;
    const visible = await Promise.all(all.map((each) => isVisible(this.dive, each).catch(() => true)));
    if (turn !== this.turn) return;
    const shown = all.filter((_, i) => visible[i]);
    const place = spot_m.map((value, i) => (value + this.about.offset_m[i]).toFixed(2)).join(", ");
    const heading = gap ? "map.gap" : shown.length ? "map.seen" : "map.unseen";
    this.found.replaceChildren(
      element("h2", {}, this.text(heading, { count: shown.length, place })),
      ...(gap ? [element("p", {}, this.text(`map.gap_${gap}`))] : []),
      element("div", { class: "found-frames" }, ...shown.map((each) => this.card(each))),
    );
  }

  private card(each: Sighting): HTMLElement {
    const [width, height] = this.dive.geometry?.image_size ?? [1, 1];
    const source = picture(this.dive, this.dive.names.indexOf(each.name), "thumbnails");
    const mark = element("span", { class: "spot", style: `left:${(100 * each.x_px) / width}%;top:${(100 * each.y_px) / height}%` });
    const card = element("button", { type: "button", class: "card" });
    card.append(
      element("span", { class: "card-picture" }, source ? element("img", { src: source, alt: "" }) : "", mark),
      element("span", {}, each.name),
      element("span", { class: "soft" }, this.text("unit.m", { value: each.range_m.toFixed(2) })),
    );
    card.addEventListener("click", () => this.look(each.name));
    return card;
  }
}

/** A button that is on or off. */
function toggle(label: string, on: boolean, changed: (on: boolean) => void): HTMLButtonElement {
  const made = button(
    label,
    () => {
      const now = made.getAttribute("aria-pressed") !== "true";
      made.setAttribute("aria-pressed", String(now));
      changed(now);
    },
    { "aria-pressed": String(on), class: "toggle" },
  );
  return made;
}
