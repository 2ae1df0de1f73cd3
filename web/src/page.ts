// START HERE: the page's program. page/dive.js hands over the dive; the hash of the address says what is looked at.

import { texter, type Dive } from "./dive";
import { Frames } from "./frames";
import { drawPlots } from "./plots";
import { receive } from "./ranges";
import { accessible } from "./slider";

function start(dive: Dive): void {
  const text = texter(dive.texts);
  const sections = [...document.querySelectorAll<HTMLElement>("section.view")];
  const section = (id: string) => document.getElementById(id) as HTMLElement;
  const look = (name: string) => (location.hash = `#frames/${encodeURIComponent(name)}`);
  let frames: Frames | undefined;
  let plotted = false;

  const open: Record<string, (rest: string) => void> = {
    frames: (rest) => {
      frames ??= new Frames(section("frames"), dive, text, look);
      frames.show(rest);
      frames.preload();
    },
    plots: () => {
      if (!plotted) drawPlots(section("plots"), dive, text, look);
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
  document.querySelectorAll<HTMLElement>("img-comparison-slider").forEach(accessible);
  for (const copier of document.querySelectorAll<HTMLButtonElement>("button.copy")) {
    copier.addEventListener("click", () => void copy(copier, text("overview.copied")));
  }
  route();
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

(window as unknown as { seecolor: unknown }).seecolor = { dive: start, ranges: receive };
