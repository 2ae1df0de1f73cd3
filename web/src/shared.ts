// What scripts of this page hand to each other: browsers let pages opened from files load scripts, and nothing else.

import type { Block, Dive, Text } from "./dive";
import type { MeasureTable } from "./measuretable";
import type { Ranges } from "./ranges";

interface Shared {
  blockOf?: (number: number) => Promise<Block>;
  rangesOf?: (dive: Dive, name: string) => Promise<Ranges>;
  table?: MeasureTable;
  showMap?: (section: HTMLElement, dive: Dive, text: Text, look: (name: string) => void) => void;
  [receiver: string]: unknown;
}

const shared = window as unknown as { seecolor?: Shared };

/** The page's one name in the browser. */
export const seecolor: Shared = (shared.seecolor ??= {});
