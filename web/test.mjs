// Builds the unit tests as the page is built, and runs them with Node's own test runner.
import { build } from "esbuild";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readdirSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

const out = mkdtempSync(join(tmpdir(), "page-tests-"));
const tests = readdirSync("test").filter((name) => name.endsWith(".test.ts"));
await build({ bundle: true, format: "esm", platform: "node", outdir: out, outExtension: { ".js": ".mjs" }, inject: ["test/browser.ts"], entryPoints: tests.map((name) => join("test", name)), logLevel: "warning" });
const { status } = spawnSync(process.execPath, ["--test", ...tests.map((name) => join(out, name.replace(/\.ts$/, ".mjs")))], { stdio: "inherit" });
rmSync(out, { recursive: true });
process.exit(status ?? 1);
