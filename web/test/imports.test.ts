import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";

test("imports run one way: no module needs itself", () => {
  const files = readdirSync("src").filter((name) => name.endsWith(".ts"));
  const imported = new Map(files.map((name) => [name, [...readFileSync(`src/${name}`, "utf8").matchAll(/ from "\.\/(\w+)"/g)].map(([, found]) => `${found}.ts`)]));
  const done = new Set<string>();
  const walk = (name: string, path: string[]): void => {
    assert.ok(!path.includes(name), [...path, name].join(" -> "));
    if (done.has(name)) return;
    for (const next of imported.get(name) ?? []) walk(next, [...path, name]);
    done.add(name);
  };
  for (const name of files) walk(name, []);
  assert.equal(done.size, files.length);
});
