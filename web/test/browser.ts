// What the page's modules ask of a browser when they are loaded, or keep in it.

const listeners: ((event: object) => void)[] = [];
const kept = new Map<string, string>();
Object.assign(globalThis, {
  window: globalThis,
  addEventListener: (name: string, heard: (event: object) => void) => void (name === "storage" && listeners.push(heard)),
  localStorage: {
    getItem: (key: string) => kept.get(key) ?? null,
    setItem: (key: string, value: string) => void kept.set(key, value),
    clear: () => kept.clear(),
  },
});

/** What a browser does in its other tabs, after one of them has stored something. */
export const tellOtherTabs = (key: string) => listeners.forEach((heard) => heard({ key }));
Object.assign(globalThis, { tellOtherTabs });
