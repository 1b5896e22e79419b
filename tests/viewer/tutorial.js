// Follows the part of the book's tutorial (book/src/tutorial.md) that is on the service's page, in Debian's Chromium.
// Each control that the tutorial names in bold is used, in its order.
//
//   node tutorial.js GROWBOT [PICTURES]

import assert from "node:assert/strict";
import { readFile, writeFile } from "node:fs/promises";
import { join, resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { partsOf } from "./operator.js";

const growbot = resolve(process.argv[2]);
const pictures = process.argv[3];
// The body is laid in some 3 minutes.
const TIMEOUT_MS = 600_000;
const errors = [];

const chapter = await readFile(join(import.meta.dirname, "../../book/src/tutorial.md"), "utf8");
const named = [...chapter.matchAll(/^\d\..*(?:\n {3}.*)*/gm)].flatMap(([step]) => [...step.matchAll(/\*\*(.+?)\*\*/g)]);
const names = named.map(([, name]) => name);
const used = [];
const scene = [...chapter.matchAll(/^printf '(.*)' >+ pipe\.toml$/gm)].map(([, text]) => text.replaceAll("\\n", "\n"));
const [, goal] = /As the goal, type `(.*?)`/.exec(chapter);

const lab = await startLab(growbot, ["practice"], 60, "growbot-a");
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
try {
  await writeFile(join(lab.directory, "pipe.toml"), scene.join(""));
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  page.setDefaultTimeout(TIMEOUT_MS);
  page.on("pageerror", (error) => errors.push(error.stack));
  await page.goto(lab.controlUrl);
  const practice = partsOf(page, "practice");
  const { nextBody, history, waitForState } = practice;
  const use = async (name, control) => {
    await control.click();
    used.push(name);
  };
  const press = (name, within = practice.robot) => use(name, within.getByRole("button", { name, exact: true }));
  const picture = (name) => pictures && page.screenshot({ path: join(pictures, `tutorial-${name}.png`) });
  const checkShowsPipe = async () => {
    await practice.frame.locator("canvas").first().waitFor();
    assert.ok(await practice.frame.getByLabel("Obstacles").isChecked());
  };

  await waitForState("idle");
  assert.ok(await nextBody.getByRole("heading", { name: "Next body" }).isVisible());
  used.push("Next body");
  await practice.typeGoal(goal);
  await nextBody.getByLabel(/Scene to avoid/).setInputFiles(join(lab.directory, "pipe.toml"));
  await press("Preview", nextBody);
  await practice.preview.filter({ hasText: /mm/ }).waitFor();
  await checkShowsPipe();
  await picture("preview");
  await press("Grow", nextBody);
  await press("Heat and grow", practice.question);
  await waitForState("growing");
  await press("Pause");
  // A pause on a slow machine is long for a fast robot, so it may park.
  await waitForState("paused|parked");
  // A slow browser has the time of the pause.
  await practice.drawnLayers.waitFor();
  await checkShowsPipe();
  await picture("growing");
  // A click this soon after another one moves nothing.
  await page.waitForTimeout(1_000);
  await press("Continue");
  await waitForState("growing");
  await press("Stop");
  await waitForState("stopped");
  // A click this soon after another one heats nothing.
  await page.waitForTimeout(1_000);
  await press("Resume");
  await waitForState("heating|homing|growing");
  const done = practice.job("done");
  await done.waitFor();
  await press("Compare", history.getByRole("row").filter({ has: page.getByText("done", { exact: true }) }).first());
  await checkShowsPipe();
  await picture("done");
  assert.deepEqual(used, names);
  assert.deepEqual(errors, []);
  console.log("the tutorial: previewed, grew, paused, stopped, resumed and finished a body around a pipe");
} finally {
  await browser.close();
  await lab.remove();
}
