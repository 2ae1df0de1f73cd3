// The random points of the map with their labels, kept in the browser and in measures.json, with undo.

import type { KeptPoints, LabelledSpot } from "./kept";

export class CoverPoints {
  private kept: KeptPoints;
  private readonly earlier: LabelledSpot[][] = []; // points that others have replaced

  constructor(
    private readonly key: string,
    beside: KeptPoints | null,
    private readonly changed: () => void,
  ) {
    this.kept = { changed_ms: 0, points: [] };
    this.kept = this.stored();
    this.adopt(beside);
    addEventListener("storage", ({ key: other }) => {
      if (other !== this.key) return;
      this.kept = this.stored(); // another tab of this browser has changed them
      this.changed();
    });
  }

  get list(): readonly LabelledSpot[] {
    return this.kept.points;
  }

  /** All of them, for a file. */
  get content(): KeptPoints {
    return this.kept;
  }

  /** The point that is to be labelled. */
  get current(): LabelledSpot | null {
    return this.list.find((each) => !each.label) ?? null;
  }

  /** Label the current point. */
  give(label: string): void {
    const { current } = this;
    if (current && label) this.keep(this.list.map((each) => (each === current ? { ...each, label } : each)));
  }

  /** Take back the last label, or bring back the points that these have replaced. */
  back(): void {
    const last = this.list.filter((each) => each.label).pop();
    if (last) this.keep(this.list.map((each) => (each === last ? { ...each, label: "" } : each)));
    else if (this.earlier.length) this.keep(this.earlier.pop() as LabelledSpot[]);
  }

  /** Other points; ``back`` brings the earlier ones back. */
  replace(points: LabelledSpot[]): void {
    if (this.list.length) this.earlier.push([...this.list]);
    this.keep(points);
  }

  /** Take over points of another browser, where they were changed later than those here; true where they were. */
  take(other: KeptPoints | null | undefined): boolean {
    const taken = this.adopt(other);
    if (taken) this.changed();
    return taken;
  }

  private adopt(other: KeptPoints | null | undefined): boolean {
    if (!other || other.changed_ms <= this.kept.changed_ms) return false;
    if (this.list.length) this.earlier.push([...this.list]);
    this.store(other);
    return true;
  }

  private keep(points: LabelledSpot[]): void {
    this.store({ changed_ms: Math.max(Date.now(), this.kept.changed_ms + 1), points });
    this.changed();
  }

  private store(kept: KeptPoints): void {
    this.kept = kept;
    try {
      localStorage.setItem(this.key, JSON.stringify(kept));
    } catch {
      // nothing can be kept: the file still can be saved
    }
  }

  private stored(): KeptPoints {
    try {
      const found = JSON.parse(localStorage.getItem(this.key) ?? "null") as KeptPoints | LabelledSpot[] | null;
      return Array.isArray(found) ? { changed_ms: 1, points: found } : (found ?? this.kept); // an array: as earlier pages kept them
    } catch {
      return this.kept; // a browser that keeps nothing for files
    }
  }
}
