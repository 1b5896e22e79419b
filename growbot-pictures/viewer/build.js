// Bundles the page's script: src/main.js and the parts of three.js that it uses become dist/viewer.js, with three.js's
// licence at its head and in a file next to it. The bytes depend only on package-lock.json and src. tests/run builds
// them again and compares.
import { build } from "esbuild";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const dist = resolve(process.argv[2] ?? join(here, "dist"));
const licence = readFileSync(join(here, "node_modules/three/LICENSE"), "utf8");

mkdirSync(dist, { recursive: true });
await build({
  absWorkingDir: here,
  entryPoints: ["src/main.js"],
  outfile: join(dist, "viewer.js"),
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "ascii",
  legalComments: "none",
  banner: { js: `/*! With three.js:\n${licence.trim()}\n*/` },
});
writeFileSync(join(dist, "LICENSE-three.txt"), licence);
