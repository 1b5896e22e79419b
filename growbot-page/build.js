// Bundles the page of the service: src becomes dist, with the licences of the libraries in it. The bytes depend only on
// package-lock.json, src and growbot-pictures/viewer/src/connection.js. tests/run builds them again and compares.
//
//   node build.js [DIRECTORY]
import { build } from "esbuild";
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const LIBRARIES = ["preact", "@preact/signals", "uplot"];
const here = dirname(fileURLToPath(import.meta.url));
const dist = resolve(process.argv[2] ?? join(here, "dist"));
const at = (...parts) => join(here, ...parts);

mkdirSync(dist, { recursive: true });
await build({
  absWorkingDir: here,
  entryPoints: ["src/robots.tsx", "src/robots.css", "src/events-worker.ts"],
  outdir: dist,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  charset: "ascii",
  legalComments: "none",
});
copyFileSync(at("src/robots.html"), join(dist, "robots.html"));
const licenceOf = (name) => readFileSync(at("node_modules", name, "LICENSE"), "utf8").trim();
writeFileSync(join(dist, "LICENSES.txt"), LIBRARIES.map((name) => `${name}\n\n${licenceOf(name)}\n`).join("\n"));
