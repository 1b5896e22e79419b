// The console on a robot's page of `growbot serve`, in Debian's Chromium: its commands are those of `growbot console`,
// completed and repeated by keys, with the conditions and questions of the buttons.
//
//   node console.js GROWBOT
//
// The browser is `chromium`, or the value of CHROMIUM.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { resolve } from "node:path";
import { chromium } from "playwright-core";
import { environment } from "./environment.js";
import { startLab } from "./lab.js";
import { checkAccessibility, checkWidth, openPage, partsOf } from "./operator.js";

const growbot = resolve(process.argv[2]);
const axe = await readFile(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const TIMEOUT_MS = 600_000;
/** Commands with a place of their own on the page. */
const ELSEWHERE = ["plan", "layers", "wait", "quit"];
const namesIn = (help) => help.split("\n").map((line) => line.trim().split(" ")[0]).filter(Boolean);

const lab = await startLab(growbot, ["lab"], 10);
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
const errors = [];

async function open(url) {
  const page = await openPage(browser, url, { timeoutMs: TIMEOUT_MS, errors });
  await partsOf(page, "lab").waitForState("idle|growing|paused|stopped");
  await page.getByText("Console", { exact: true }).press("Enter");
  const log = page.getByRole("log", { name: "Responses of the console" });
  const field = page.getByRole("textbox", { name: "Command" });
  return {
    page, log, field,
    type: async (line) => {
      await field.fill(line);
      await field.press("Enter");
    },
    /** Returns the response to a line. The line is repeated while the page does not know the current state. */
    say: async (line) => {
      for (;;) {
        await field.fill(line);
        await field.press("Enter");
        const entry = log.locator("> div").last();
        await entry.getByText(`> ${line}`, { exact: true }).waitFor();
        const text = entry.locator("p").last();
        await text.filter({ hasNotText: /^no response yet$/ }).waitFor();
        const response = await text.innerText();
        if (!/^last known|^The state of the robot is not/.test(response)) return response;
      }
    },
  };
}

try {
  const { page, log, field, type, say } = await open(lab.controlUrl);
  const { button, question, waitForState } = partsOf(page, "lab");
  const response = (text) => log.locator("> div").last().getByText(text).waitFor();

  const console_ = spawnSync(growbot, ["console", "--port", "sim"], { input: "help\n", encoding: "utf8",
    env: environment });
  // The status of the board comes first.
  const listed = console_.stdout.slice(console_.stdout.search(/^status +identity/m));
  const own = namesIn(listed).filter((name) => !ELSEWHERE.includes(name));
  assert.deepEqual(namesIn(await say("help")).sort(), own.sort());
  await checkAccessibility(page, axe, "console");
  await page.setViewportSize({ width: 390, height: 844 });
  await checkWidth(page, "the console on a phone");
  await page.setViewportSize({ width: 1280, height: 900 });
  console.log(`console: ${own.length} commands`);

  await field.fill("stat");
  await field.press("Tab");
  assert.equal(await field.inputValue(), "status");
  await field.press("Enter");
  await response(/^idle/);
  await field.press("ArrowUp");
  assert.equal(await field.inputValue(), "status");
  await field.press("ArrowUp");
  assert.equal(await field.inputValue(), "help");
  await field.press("ArrowDown");
  await field.press("ArrowDown");
  assert.equal(await field.inputValue(), "");
  await field.press("Tab");
  assert.ok(await page.getByRole("button", { name: "Run", exact: true }).evaluate((run) => run.matches(":focus")));
  for (const [line, expected] of [
    ["grwo 0,0,100,0,90", /^unknown command "grwo"/],
    ["plan 0,0,100,0,90", /^`plan` is not for this console: press Preview/],
    ["stop now", /^`stop` takes no arguments: remove "now"$/],
    ["grow", /^give X,Y,Z,HEADING,PITCH/],
    ["grow file.json", /^give X,Y,Z,HEADING,PITCH/],
    ["start", /^no body waits/],
    ["pause", /^No body grows/],
    ["clear", /^nothing is latched$/],
  ]) assert.match(await say(line), expected);
  console.log("console: completion, history and refusals");

  // A goal is previewed and confirmed as with the buttons.
  await type("grow 0,0,1500,0,90");
  await question.waitFor();
  await question.locator("button:focus").waitFor();
  await page.keyboard.press("Escape");
  await response("not grown");
  assert.equal((await lab.robot("lab")).job, null);
  await type("grow 0,0,1500,0,90");
  await question.getByRole("button", { name: "Heat and grow" }).click();
  await response(/^Job .* started$/);
  await waitForState("growing");
  await type("pause");
  await waitForState("paused");
  await type("rotate 10");
  await response(/^`rotate` is not possible in a pause/);
  await type("start");
  await waitForState("growing");
  await type("stop");
  await waitForState("stopped|idle");
  await button("Resume").waitFor();
  await type("start");
  await waitForState("heating|homing|growing");
  await type("estop now");
  await waitForState("emergency-stop");
  await response(/^Emergency stop: heater and steppers of the simulated robot are off$/);
  // The job of a stopped robot takes a moment to end.
  const deadline = Date.now() + TIMEOUT_MS;
  while (/^the robot is not ready/.test(await say("clear")) && Date.now() < deadline) await page.waitForTimeout(200);
  await waitForState("stopped|idle");
  console.log("console: a growth");

  const readOnly = await open(lab.viewUrl);
  // The page knows its rights.
  const { stop } = partsOf(readOnly.page, "lab");
  await stop.and(readOnly.page.locator(":disabled")).waitFor();
  assert.match(await readOnly.say("status"), /^(stopped|idle)/);
  for (const line of ["estop", "stop", "preheat"]) assert.match(await readOnly.say(line), /^this URL is read-only/);
  assert.equal(await lab.countCommands("emergency-stop"), 1);
  assert.deepEqual(errors, []);
  console.log("console: passed");
} finally {
  await browser.close();
  await lab.remove();
}
