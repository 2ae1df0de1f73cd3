// Builds the page's program into stereo_seecolor/report/static: classic scripts, since browsers load no modules from files.
import { build } from "esbuild";
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2] ?? join(here, "..", "stereo_seecolor", "report", "static");
const shared = {
  bundle: true,
  minify: true,
  format: "iife",
  target: ["chrome123", "firefox120", "safari17.5"],
  charset: "ascii",
  legalComments: "none", // the licenses are in licenses.txt, whole
  absWorkingDir: here,
  logLevel: "warning",
};

await build({ ...shared, entryPoints: ["src/page.ts"], outfile: join(out, "page.js") });
await build({ ...shared, entryPoints: ["src/live.ts"], outfile: join(out, "live.js") });
await build({ ...shared, entryPoints: ["src/page.css"], outfile: join(out, "page.css") });
await build({ ...shared, entryPoints: ["src/map.ts"], outfile: join(out, "map.js") });

const licenses = {
  "img-comparison-slider": "licenses/img-comparison-slider.txt", // its package says MIT and holds no text
  openseadragon: "node_modules/openseadragon/LICENSE.txt",
  three: "node_modules/three/LICENSE",
  uplot: "node_modules/uplot/LICENSE",
};
const texts = Object.entries(licenses).map(([name, file]) => {
  const { version } = JSON.parse(readFileSync(join(here, "node_modules", name, "package.json"), "utf8"));
  return `${name} ${version}\n\n${readFileSync(join(here, file), "utf8").trim()}\n`;
});
const head = "page.js and map.js hold these libraries; everything else in them is stereo-seecolor's own, Apache-2.0.\n";
writeFileSync(join(out, "licenses.txt"), [head, ...texts].join(`\n${"-".repeat(80)}\n\n`));
