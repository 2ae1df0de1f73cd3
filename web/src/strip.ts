// The strip of thumbnails: only those in sight are in the page, so that thousands scroll smoothly.

import { picture, type Dive } from "./dive";
import { element } from "./elements";

const ITEM_PX = 108;
const BEYOND = 8;

export class Strip {
  readonly root: HTMLDivElement;
  private readonly inner: HTMLDivElement;
  private shown: number[] = [];
  private current = -1;
  private readonly items = new Map<number, HTMLElement>();

  constructor(
    private readonly dive: Dive,
    label: string,
    private readonly chosen: (frame: number) => void,
  ) {
    this.inner = element("div", { class: "strip-inner", role: "presentation" });
    this.root = element("div", { class: "strip", role: "listbox", tabindex: 0, "aria-label": label, "aria-orientation": "horizontal" }, this.inner);
    this.root.addEventListener("scroll", () => this.draw(), { passive: true });
    this.root.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.draw()).observe(this.root);
  }

  /** Which frames are in the strip. */
  show(frames: number[]): void {
    this.shown = frames;
    this.inner.style.width = `${frames.length * ITEM_PX}px`;
    for (const item of this.items.values()) item.remove();
    this.items.clear();
    this.draw();
  }

  /** Mark a frame as the one that is looked at, and bring it into sight. */
  choose(frame: number): void {
    this.current = frame;
    const place = this.shown.indexOf(frame);
    const { scrollLeft, clientWidth } = this.root;
    if (place >= 0 && (place * ITEM_PX < scrollLeft || (place + 1) * ITEM_PX > scrollLeft + clientWidth)) {
      this.root.scrollLeft = place * ITEM_PX - clientWidth / 2 + ITEM_PX / 2;
    }
    this.draw();
  }

  /** The frame so many places after the current one, -1 where there is none. */
  neighbor(step: number): number {
    return this.shown[this.shown.indexOf(this.current) + step] ?? -1;
  }

  private key(event: KeyboardEvent): void {
    const steps: Record<string, number> = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10 };
    const place = this.shown.indexOf(this.current);
    let next = place + (steps[event.key] ?? 0);
    if (event.key === "Home") next = 0;
    if (event.key === "End") next = this.shown.length - 1;
    next = Math.min(Math.max(next, 0), this.shown.length - 1);
    if (next === place || !this.shown.length) return;
    event.preventDefault();
    this.chosen(this.shown[next]);
  }

  private draw(): void {
    const first = Math.max(0, Math.floor(this.root.scrollLeft / ITEM_PX) - BEYOND);
    const last = Math.min(this.shown.length, Math.ceil((this.root.scrollLeft + this.root.clientWidth) / ITEM_PX) + BEYOND);
    for (const [place, item] of this.items) {
      if (place < first || place >= last) {
        item.remove();
        this.items.delete(place);
      }
    }
    for (let place = first; place < last; place++) {
      const item = this.items.get(place) ?? this.add(place);
      const selected = this.shown[place] === this.current;
      item.setAttribute("aria-selected", String(selected));
      if (selected) this.root.setAttribute("aria-activedescendant", item.id);
    }
  }

  private add(place: number): HTMLElement {
    const frame = this.shown[place];
    const name = this.dive.names[frame];
    const status = this.dive.status[frame];
    const warned = String(frame) in this.dive.problems_of;
    const small = picture(this.dive, frame, "thumbnails");
    const shown = small
      ? element("img", { src: small, alt: "", decoding: "async", draggable: "false" })
      : element("span", { class: "no-picture" }, status);
    const item = element(
      "div",
      {
        class: `strip-item ${status}${warned ? " warned" : ""}`,
        role: "option",
        id: `strip-${frame}`,
        title: name,
        "aria-label": name,
        "aria-setsize": this.shown.length,
        "aria-posinset": place + 1,
        style: `left:${place * ITEM_PX}px`,
      },
      shown,
    );
    item.addEventListener("click", () => this.chosen(frame));
    this.items.set(place, item);
    this.inner.append(item);
    return item;
  }
}
