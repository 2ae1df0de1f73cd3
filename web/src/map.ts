// START HERE for the map: three dimensions, mosaic, terrain; a click on the reef shows the frames that saw the spot.

import type { Dive, Text } from "./dive";
import { picture } from "./dive";
import { button, Choice, element } from "./elements";
import { Mosaic } from "./mosaic";
import { Scene, type About } from "./scene";
import { seecolor } from "./scripts";
import { isVisible, sightings, type Sighting } from "./seen";

let about: About | null = null;
seecolor.map = (given: About) => (about = given);
seecolor.showMap = (section, dive, text, look) => {
  if (about) new MapView(section, about, dive, text, look);
};

type View = "scene" | "relief" | "mosaic" | "terrain";

class MapView {
  private readonly stage = element("div", { class: "map-stage" });
  private readonly flat = element("div", { class: "map-flat" });
  private readonly found = element("div", { class: "found", role: "status" });
  private scene: Scene | null = null;
  private mosaic: Mosaic | null = null;
  private turn = 0;

  constructor(
    section: HTMLElement,
    private readonly about: About,
    private readonly dive: Dive,
    private readonly text: Text,
    private readonly look: (name: string) => void,
  ) {
    const views: [View, string][] = [];
    if (about.whole) views.push(["scene", text("map.scene")], ["relief", text("map.relief")]);
    views.push(["mosaic", text("map.mosaic_short")]);
    if (about.terrain) views.push(["terrain", text("map.terrain")]);
    const choice = new Choice(text("map.view"), views, (view) => this.show(view as View));
    const track = button(text("map.track"), () => this.toggleTrack(track), { "aria-pressed": "true", class: "toggle" });
    const zoom = [button("+", () => this.mosaic?.zoom(1.5), { "aria-label": text("map.closer") }), button("−", () => this.mosaic?.zoom(1 / 1.5), { "aria-label": text("map.farther") })];
    this.tools = { scene: [track, button(text("map.home"), () => this.scene?.home())], flat: zoom };
    section.replaceChildren(
      element("div", { class: "toolbar" }, choice.root, ...this.tools.scene, ...this.tools.flat),
      this.stage,
      element("p", { class: "hint" }, text("map.hint")),
      this.found,
    );
    new ResizeObserver(() => this.scene?.resize(this.stage.clientWidth, this.stage.clientHeight)).observe(this.stage);
    const first = views[0][0];
    choice.show(first);
    this.show(first);
  }

  private readonly tools: { scene: HTMLButtonElement[]; flat: HTMLButtonElement[] };

  private show(view: View): void {
    const solid = view === "scene" || view === "relief";
    for (const tool of this.tools.scene) tool.hidden = !solid;
    for (const tool of this.tools.flat) tool.hidden = solid;
    if (solid) this.showScene(view === "relief");
    else this.showFlat(view === "terrain");
  }

  private showScene(relief: boolean): void {
    try {
      this.scene ??= new Scene(this.about, this.dive, this.text("map.label"), (spot) => void this.seen(spot));
    } catch {
      this.stage.replaceChildren(element("p", { class: "empty" }, this.text("map.no_webgl")));
      return;
    }
    this.stage.replaceChildren(this.scene.root);
    this.scene.showRelief(relief);
    this.scene.resize(this.stage.clientWidth, this.stage.clientHeight);
  }

  private showFlat(terrain: boolean): void {
    this.stage.replaceChildren(this.flat);
    this.mosaic ??= new Mosaic(this.flat, this.about, (x, y) => void this.seen(this.onGround(x, y)));
    this.mosaic.show(terrain);
  }

  /** A spot of the world from above, at the middle height of the map, in the map's own coordinates. */
  private onGround(x_m: number, y_m: number): number[] {
    const boxes = Object.values(this.about.pieces);
    const heights = boxes.map((each) => (each.low_m[2] + each.high_m[2]) / 2);
    return [x_m - this.about.offset_m[0], y_m - this.about.offset_m[1], heights.reduce((a, b) => a + b, 0) / Math.max(heights.length, 1)];
  }

  private toggleTrack(track: HTMLButtonElement): void {
    const shown = track.getAttribute("aria-pressed") !== "true";
    track.setAttribute("aria-pressed", String(shown));
    this.scene?.showTrack(shown);
  }

  private async seen(spot_m: number[]): Promise<void> {
    const turn = ++this.turn;
    const all = sightings(this.dive, spot_m);
    const visible = await Promise.all(all.map((each) => isVisible(this.dive, each).catch(() => true)));
    if (turn !== this.turn) return;
    const shown = all.filter((_, i) => visible[i]);
    const place = spot_m.map((value, i) => (value + this.about.offset_m[i]).toFixed(2)).join(", ");
    this.found.replaceChildren(
      element("h2", {}, this.text(shown.length ? "map.seen" : "map.unseen", { count: shown.length, place })),
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
