// START HERE: the page's program. page/dive.js hands over the dive; the hash of the address says what is looked at.

import { block, receiveBlock } from "./blocks";
import { inflated } from "./codes";
import { texter, type Dive, type Text } from "./dive";
import { Frames } from "./frames";
import { MeasureTable } from "./measuretable";
import { drawPlots } from "./plots";
import { ranges, receive } from "./ranges";
import { script } from "./scripts";
import { seecolor } from "./shared";
import { accessible } from "./slider";

/** frames: what is known of each frame, deflated. */
async function start(given: Dive & { frames: string }): Promise<void> {
  const dive: Dive = Object.assign(given, JSON.parse(new TextDecoder().decode(await inflated(given.frames))));
  const text = texter(dive.texts);
  const sections = [...document.querySelectorAll<HTMLElement>("section.view")];
  const section = (id: string) => document.getElementById(id) as HTMLElement;
  const look = (name: string) => (location.hash = `#frames/${encodeURIComponent(name)}`);
  const table = new MeasureTable(dive, text, look);
  seecolor.table = table;
  let frames: Frames | undefined;
  let plotted = false;
  let mapped = false;

  const open: Record<string, (rest: string) => void> = {
    frames: (rest) => {
      frames ??= new Frames(section("frames"), dive, text, look, table);
      frames.show(rest);
      frames.preload();
    },
    map: () => {
      if (!mapped) void loadMap(dive, text, look);
      mapped = true;
    },
    plots: () => {
      if (!plotted) void drawPlots(section("plots"), dive, text, look);
      plotted = true;
    },
  };

  const route = () => {
    const [wanted, rest = ""] = location.hash.slice(1).split("/");
    const shown = sections.find((each) => each.id === wanted) ?? sections[0];
    for (const each of sections) each.hidden = each !== shown;
    for (const link of document.querySelectorAll<HTMLElement>(".tabs a")) {
      if (link.dataset.tab === shown.id) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
    }
    open[shown.id]?.(unescaped(rest));
  };
  addEventListener("hashchange", route);
  const header = document.querySelector(".top") as HTMLElement;
  new ResizeObserver(() => document.documentElement.style.setProperty("--top", `${header.offsetHeight}px`)).observe(header);
  document.querySelectorAll<HTMLElement>("img-comparison-slider").forEach(accessible);
  for (const copier of document.querySelectorAll<HTMLButtonElement>("button.copy")) {
    copier.addEventListener("click", () => void copy(copier, text("overview.copied")));
  }
  route();
}

/** The map's own program, which is large, and its data are loaded when the map is looked at. */
async function loadMap(dive: Dive, text: Text, look: (name: string) => void): Promise<void> {
  const section = document.getElementById("map") as HTMLElement;
  await script("page/map.js");
  await script("page/map/map.js");
  seecolor.showMap?.(section, dive, text, look);
}

function unescaped(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

async function copy(copier: HTMLButtonElement, done: string): Promise<void> {
  const source = document.getElementById(copier.dataset.copies ?? "");
  if (!source) return;
  try {
    await navigator.clipboard.writeText(source.textContent ?? "");
    copier.textContent = done;
  } catch {
    getSelection()?.selectAllChildren(source); // a browser that gives files no clipboard: the text is marked instead
  }
}

Object.assign(seecolor, { dive: start, ranges: receive, rangesOf: ranges, block: receiveBlock, blockOf: block });
