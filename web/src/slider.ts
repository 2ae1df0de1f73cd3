// Two pictures one over the other, with a handle between them.

import "img-comparison-slider";
import type { Text } from "./dive";
import { element } from "./elements";

const STEP = 2;

/** A slider of two images. */
export function slider(before: string, after: string, name: string, text: Text): HTMLElement {
  const made = document.createElement("img-comparison-slider");
  for (const [key, value] of Object.entries({
    class: "slider",
    value: "50",
    tabindex: "0",
    role: "slider",
    "aria-valuemin": "0",
    "aria-valuemax": "100",
    "aria-label": `${text("view.slider")}: ${name}`,
  })) {
    made.setAttribute(key, value);
  }
  made.append(
    element("img", { slot: "first", src: before, alt: `${text("frames.before")}: ${name}` }),
    element("img", { slot: "second", src: after, alt: `${text("frames.after")}: ${name}` }),
  );
  accessible(made);
  return made;
}

/** Tell screen readers where the handle is, and move it by arrow keys in even steps. */
export function accessible(made: HTMLElement): void {
  const held = made as HTMLElement & { value: number | string };
  made.setAttribute("keyboard", "disabled");
  const say = () => made.setAttribute("aria-valuenow", String(Math.round(Number(held.value))));
  made.addEventListener("slide", say);
  made.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -STEP, ArrowDown: -STEP, ArrowRight: STEP, ArrowUp: STEP }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    held.value = Math.min(Math.max(Number(held.value) + step, 0), 100);
    say();
  });
  say();
}
