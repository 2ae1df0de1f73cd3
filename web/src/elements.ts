// Elements made by code: text is only ever text, never markup.

type Child = Node | string;

/** An element with attributes and children; attributes that are false or null are left out. */
export function element<Name extends keyof HTMLElementTagNameMap>(
  name: Name,
  attributes: Record<string, string | number | boolean | null> = {},
  ...children: Child[]
): HTMLElementTagNameMap[Name] {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== false) made.setAttribute(key, value === true ? "" : String(value));
  }
  made.append(...children);
  return made;
}

/** A button that does something. */
export function button(label: string, action: () => void, attributes: Record<string, string | boolean> = {}): HTMLButtonElement {
  const made = element("button", { type: "button", ...attributes }, label);
  made.addEventListener("click", action);
  return made;
}

/** Put other children into a place; the focus stays on the button of the same name. */
export function redraw(place: HTMLElement, children: HTMLElement[]): void {
  const focused = place.contains(document.activeElement) ? document.activeElement?.getAttribute("aria-label") : null;
  place.replaceChildren(...children);
  const again = [...place.querySelectorAll("button")].find((each) => focused && each.getAttribute("aria-label") === focused);
  again?.focus({ preventScroll: true });
}

/** One of several choices, as buttons of which one is pressed. */
export class Choice {
  readonly root: HTMLDivElement;
  private readonly buttons = new Map<string, HTMLButtonElement>();

  constructor(label: string, choices: [string, string][], chosen: (key: string) => void) {
    this.root = element("div", { class: "choice", role: "group", "aria-label": label });
    for (const [key, text] of choices) {
      const made = button(text, () => {
        this.show(key);
        chosen(key);
      });
      this.buttons.set(key, made);
      this.root.append(made);
    }
  }

  show(key: string): void {
    for (const [name, made] of this.buttons) made.setAttribute("aria-pressed", String(name === key));
  }
}

/** A number with some significant digits, never in powers of ten; what is below a millionth is 0. */
export function readable(value: number, digits = 3): string {
  if (Math.abs(value) < 1e-6) return "0";
  const short = String(+value.toPrecision(digits));
  return short.includes("e") ? value.toFixed(Math.abs(value) < 1 ? 6 : 0).replace(/(\.\d*?)0+$/, "$1") : short;
}

/** A value and its standard error, both to two digits of the error; without one as ``readable``. */
export function withError(value: number, std: number | null, factor = 1): string {
  if (std === null || !Number.isFinite(std)) return readable(value * factor);
  const digits = std > 0 ? Math.max(0, Math.min(4, 1 - Math.floor(Math.log10(std * factor)))) : 3;
  return `${(value * factor).toFixed(digits)} ± ${(std * factor).toFixed(digits)}`;
}

const DOUBLE_MS = 400;
const DOUBLE_PX = 8;

/** Tells the second press of a double click or double tap: browsers send no dblclick where what lies under the pointer was redrawn. */
export class DoublePress {
  private last: [number, number, number] = [-Infinity, 0, 0];

  /** Whether a press at a place, in pixels of the screen, is the second at this place. */
  again(x: number, y: number): boolean {
    const [time, lastX, lastY] = this.last;
    const now = performance.now();
    const second = now - time < DOUBLE_MS && Math.hypot(x - lastX, y - lastY) < DOUBLE_PX;
    this.last = [second ? -Infinity : now, x, y];
    return second;
  }
}

/** A labelled list to choose from. */
export function select(label: string, options: [string, string][], chosen: (value: string) => void): HTMLLabelElement {
  const list = element("select", {}, ...options.map(([value, text]) => element("option", { value }, text)));
  list.addEventListener("change", () => chosen(list.value));
  return element("label", { class: "field" }, element("span", {}, label), list);
}
