// Browsers let pages opened from files load scripts, and nothing else: data are scripts, which call a receiver.

/** Run a script of this folder; fails where it cannot be read. */
export function script(source: string): Promise<void> {
  return new Promise((resolve, reject) => {
    const made = document.createElement("script");
    made.src = source;
    made.onload = () => (made.remove(), resolve());
    made.onerror = () => (made.remove(), reject(new Error(`${source} cannot be read`)));
    document.head.append(made);
  });
}
