// Follows the part of the book's tutorial (book/src/tutorial.md) that is on the service's page, in Debian's Chromium.
// Each control that the tutorial names in bold is used, in its order.
//
//   node tutorial.js GROWBOT [PICTURES]

import assert from "node:assert/strict";
import { readFile, writeFile } from "node:fs/promises";
import { join, resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";

const growbot = resolve(process.argv[2]);
const pictures = process.argv[3];
const TIMEOUT_MS = 600_000;
const errors = [];

const chapter = await readFile(join(import.meta.dirname, "../../book/src/tutorial.md"), "utf8");
const named = [...chapter.matchAll(/^\d\..*(?:\n {3}.*)*/gm)].flatMap(([step]) => [...step.matchAll(/\*\*(.+?)\*\*/g)]);
const names = named.map(([, name]) => name);
const used = [];
const scene = [...chapter.matchAll(/^printf '(.*)' >+ pipe\.toml$/gm)].map(([, text]) => text.replaceAll("\\n", "\n"));
const [, goal] = /As the goal, type `(.*?)`/.exec(chapter);

// Faster than in the tutorial, where a person watches.
const lab = await startLab(growbot, ["practice"], 200, "growbot-a");
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
try {
  await writeFile(join(lab.directory, "pipe.toml"), scene.join(""));
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  page.setDefaultTimeout(TIMEOUT_MS);
  page.on("pageerror", (error) => errors.push(error.stack));
  await page.goto(lab.controlUrl);
  const robot = page.locator("section.robot");
  const use = async (name, control) => {
    await control.click();
    used.push(name);
  };
  const press = (name) => use(name, robot.getByRole("button", { name, exact: true }));
  const waitForState = (name) => robot.locator(".state", { hasText: new RegExp(`^(${name})$`) }).waitFor();
  const picture = (name) => pictures && page.screenshot({ path: join(pictures, `tutorial-${name}.png`) });
  const body = page.frameLocator("#body-frame").locator("canvas").first();
  const checkShowsPipe = async () => {
    await body.waitFor();
    assert.ok(await page.frameLocator("#body-frame").getByLabel("Obstacles").isChecked());
  };

  await waitForState("idle");
  await use("Grow a body", robot.locator("summary", { hasText: "Grow a body" }));
  await robot.getByLabel(/Goal/).fill(goal);
  await robot.getByLabel(/Scene to avoid/).setInputFiles(join(lab.directory, "pipe.toml"));
  await press("Preview");
  await robot.locator(".preview", { hasText: /mm/ }).waitFor();
  await checkShowsPipe();
  await picture("preview");
  await page.keyboard.press("Escape");
  await press("Grow");
  await waitForState("growing");
  await press("Show body");
  await checkShowsPipe();
  await picture("growing");
  await page.keyboard.press("Escape");
  await press("Pause");
  await waitForState("paused");
  await press("Continue");
  await waitForState("growing");
  await press("Stop");
  await waitForState("stopped");
  const job = page.locator("#job-rows tr").first();
  await use("Resume", job.getByRole("button", { name: "Resume" }));
  await waitForState("heating|homing|growing");
  await page.locator("#job-rows tr", { hasText: "done" }).first().waitFor();
  await use("3D", page.locator("#job-rows tr", { hasText: "done" }).first().getByRole("link", { name: "3D" }));
  await checkShowsPipe();
  await picture("done");
  assert.deepEqual(used, names);
  assert.deepEqual(errors, []);
  console.log("the tutorial: previewed, grew, paused, stopped, resumed and finished a body around a pipe");
} finally {
  await browser.close();
  await lab.remove();
}
