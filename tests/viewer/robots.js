// Uses the page of all robots of `growbot serve` in Debian's Chromium, with a simulated robot. It plans, previews,
// grows, pauses, loses the connection to the service and reconnects, stops, and grows again. It uses the keyboard where
// possible, and finds everything by role and name. The page is also opened on the screen of a phone, and checked with
// axe.
//
//   node robots.js GROWBOT [PICTURES]
//
// PICTURES is a directory for pictures of the page. The test does not need a fast browser. The browser is `chromium`,
// or the value of CHROMIUM.

import assert from "node:assert/strict";
import { readFile, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { checkAccessibility, checkTargets, checkWidth, partsOf } from "./operator.js";
import { watchRequests } from "./service.js";

const growbot = resolve(process.argv[2]);
const pictures = process.argv[3];
const TIMEOUT_MS = 600_000;
const errors = [];
const axe = await readFile(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

// A pause may take as long as a slow machine needs.
const description = await readFile(resolve(import.meta.dirname, "../../robots/growbot-a2.toml"), "utf8");
const patient = `${description}\n[pause]\nstandby_c = 150.0\nstandby_after_s = 60.0\noff_after_s = 36000.0\n`;
const lab = await startLab(growbot, ["lab"], 2, "growbot-a2", { lab: patient });
const { directory, controlUrl, viewUrl } = lab;
const ball = 'format = "growbot-scene/1"\n[[ball]]\ncenter_mm = [0, 0, 200]\nradius_mm = 40\n';
await writeFile(join(directory, "ball.toml"), ball);
await writeFile(join(directory, "wrong.toml"), "a ball");

const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });

async function open(pageUrl, options) {
  const page = await browser.newPage({ viewport: { width: 1200, height: 900 }, colorScheme: "light", ...options });
  page.setDefaultTimeout(TIMEOUT_MS);
  page.on("pageerror", (error) => errors.push(error.stack));
  watchRequests(page, pageUrl, pageUrl === controlUrl ? "control" : "view", errors);
  // A browser may name a language that has no number format.
  const nameNoLanguage = () => Object.defineProperty(navigator, "language", { value: "C", configurable: true });
  if (pageUrl === viewUrl) await page.addInitScript(nameNoLanguage);
  await page.goto(pageUrl);
  return page;
}

const picture = (page, name) => pictures && page.screenshot({ path: join(pictures, `${name}.png`), fullPage: true });

try {
  const page = await open(controlUrl);
  const lab1 = partsOf(page, "lab");
  const { robot, nextBody, history, preview, question, waitForState, laidLayers } = lab1;
  const press = async (name, within = robot) => {
    await within.getByRole("button", { name, exact: true }).and(page.locator(":enabled")).focus();
    await page.keyboard.press("Enter");
  };
  const checkGrows = async () => {
    const before = await laidLayers();
    const deadline = Date.now() + TIMEOUT_MS;
    while ((await laidLayers()) <= before + 2) {
      assert.ok(Date.now() < deadline, "the body does not grow");
      await page.waitForTimeout(100);
    }
  };

  await waitForState("idle");
  assert.match(await robot.innerText(), /lab[^]*simulated, 2 times as fast/);
  assert.ok(await lab1.button("Pause").isDisabled());
  await picture(page, "empty");
  await checkAccessibility(page, axe, "empty");

  // A goal is typed and previewed, without and with a scene. A problem is shown beside its field.
  await lab1.typeGoal("0,0,up,0,90");
  await press("Preview", nextBody);
  await nextBody.getByRole("status", { name: "Problem of the goal" }).filter({ hasText: /not a length/ }).waitFor();
  assert.equal(await nextBody.getByLabel("Z, mm").getAttribute("aria-invalid"), "true");
  await lab1.typeGoal("0,0,400,0,90");
  await press("Preview", nextBody);
  await preview.getByText(/400\.0 mm, 517 layers/).waitFor();
  await lab1.drawnLayers.filter({ hasText: "layer 517 of 517" }).waitFor();
  await picture(page, "preview");
  const sceneField = nextBody.getByLabel(/Scene to avoid/);
  await sceneField.setInputFiles(join(directory, "wrong.toml"));
  await press("Preview", nextBody);
  await nextBody.getByRole("status", { name: "Problem of the scene" }).filter({ hasText: "wrong.toml" }).waitFor();
  await sceneField.setInputFiles(join(directory, "ball.toml"));
  await press("Preview", nextBody);
  await preview.getByText(/^4[0-9]{2}\.[0-9] mm/).filter({ hasNotText: "400.0 mm" }).waitFor();
  await picture(page, "preview-scene");

  // Nothing heats without the confirmation. The robot grows, pauses and continues. The body is too long to be
  // finished before the end of the test.
  await lab1.typeGoal("0,0,1000,0,90");
  await press("Grow", nextBody);
  await question.waitFor();
  await picture(page, "question");
  await checkAccessibility(page, axe, "question");
  await page.keyboard.press("Escape");
  await question.waitFor({ state: "hidden" });
  assert.equal((await lab.robot("lab")).job, null);
  await press("Grow", nextBody);
  await press("Heat and grow", question);
  await waitForState("growing");
  await checkGrows();
  assert.match(await robot.innerText(), /\d \/ 200 °C/);
  await lab1.body.getByText(/\d+ of \d{4} layers, .*Tip at layer \d+: /).waitFor();
  await lab1.charts.getByRole("img", { name: /^Temperature of the nozzle over .* target 200 °C\.$/ }).waitFor();
  await lab1.charts.getByRole("img", { name: /^Deviation from the plan over \d+ mm of the body/ }).waitFor();
  await lab1.charts.getByRole("img", { name: /^Layer height over \d+ mm of the body/ }).waitFor();
  await picture(page, "growing");
  await checkAccessibility(page, axe, "growing");
  await checkAccessibility(page.frames().find((frame) => frame.url().includes("/live/")), axe, "3D view");
  await press("Pause");
  await waitForState("paused");
  // Filament can be changed in the pause.
  await press("Preheat");
  await press("Run preheat");
  await lab1.result.filter({ hasText: "was ordered to preheat" }).waitFor();
  await picture(page, "paused");
  await press("Continue");
  await waitForState("growing");

  // The service is killed. The robot continues, and the page connects to the next service.
  const before = await laidLayers();
  await lab.kill();
  await page.getByText("Connection lost").or(page.getByText("No data for")).waitFor();
  await lab.start();
  await lab1.connection.filter({ hasText: /^Live$/ }).waitFor();
  await waitForState("growing");
  await checkGrows();
  assert.ok((await laidLayers()) > before);
  await press("Pause");
  await waitForState("paused");

  // The read-only URL allows no commands. On a phone nothing is wider than the screen.
  const readOnly = await open(viewUrl, { viewport: { width: 390, height: 844 }, colorScheme: "dark" });
  const seen = partsOf(readOnly, "lab");
  await seen.waitForState("paused");
  await seen.drawnLayers.waitFor();
  await picture(readOnly, "phone");
  for (const name of ["Pause", "Continue", "Stop"]) assert.ok(await seen.button(name).isDisabled());
  assert.ok(await seen.nextBody.getByRole("button", { name: "Grow" }).isDisabled());
  await checkWidth(readOnly, "the page on a phone");
  await checkTargets(readOnly);
  await checkAccessibility(readOnly, axe, "phone");
  assert.ok(await seen.stop.isVisible() && await seen.stop.isDisabled());
  await readOnly.close();
  const phone = await open(controlUrl, { viewport: { width: 390, height: 844 } });
  const held = partsOf(phone, "lab");
  for (const name of ["Fit", "Follow tip"]) await held.frame.getByRole("button", { name }).click();
  await held.stop.click({ trial: true });
  await phone.close();

  // The guided sequence of a pause. After its first step, it can be left.
  const need = page.getByRole("alert").filter({ hasText: "Next:" });
  await need.getByText(/^Paused: .*Next: Inspect the tip/).waitFor();
  await press("Done", need);
  await need.getByText(/Next: Continue the growth/).waitFor();
  await press("Leave", need);
  await press("Done", need);
  await page.waitForTimeout(1_000);
  await press("Continue growth", need);
  await waitForState("growing");
  await need.waitFor({ state: "detached" });

  // The growth is stopped and can be compared with its plan.
  await press("Stop");
  await waitForState("stopped");
  const job = lab1.job("interrupted");
  await job.waitFor();
  await job.getByRole("button", { name: "Compare" }).click();
  await lab1.body.getByRole("heading", { name: /planned and as built$/ }).waitFor();
  await lab1.frame.locator("canvas").first().waitFor();
  const log = await page.request.get(await job.getByRole("link", { name: "Run log" }).evaluate((link) => link.href));
  assert.match(await log.text(), /^\{"event":"header"/);
  // The history is searched and filtered.
  await history.getByRole("searchbox").fill("no such job");
  await history.getByText("No job matches").waitFor();
  await history.getByRole("searchbox").fill("");
  await history.getByRole("combobox").selectOption("done");
  await history.getByText("No job matches").waitFor();
  await history.getByRole("combobox").selectOption("");

  // The second click of a double click heats nothing, even if another button has come under the pointer.
  await lab1.button("Resume").evaluate((resume) => {
    for (const target of [document.body, resume]) {
      target.dispatchEvent(new MouseEvent("click", { bubbles: true, detail: 1 }));
    }
  });
  await lab1.result.filter({ hasText: "too soon after another click" }).waitFor();
  assert.equal((await lab.robot("lab")).job, null);
  await page.waitForTimeout(1_000);

  // The emergency stop of a growth that is resumed. It is shown that a person is needed, and what to do.
  await job.getByRole("button", { name: "Resume" }).click();
  await waitForState("heating|homing|growing");
  await page.getByRole("button", { name: "Emergency stop lab" }).focus();
  await page.keyboard.press("Enter");
  await waitForState("emergency-stop");
  await lab1.result.filter({ hasText: "Emergency stop: heater and steppers" }).waitFor();
  const alert = page.getByRole("alert").filter({ hasText: "Heater and motors are off" });
  await alert.waitFor();
  await page.emulateMedia({ colorScheme: "dark" });
  await picture(page, "stopped-dark");
  await checkAccessibility(page, axe, "emergency stop, dark");
  await page.emulateMedia({ colorScheme: "light", contrast: "more" });
  await checkAccessibility(page, axe, "emergency stop, high contrast");
  await lab.waitForRobot("lab", ({ job }) => job === null, "the job does not end");
  await press("Done", alert);
  await press("Clear fault", alert);
  await waitForState("idle");

  // The body is entered as the next one. Only a confirmation grows it.
  await job.getByRole("button", { name: "Grow again" }).click();
  await nextBody.getByText("Plan: 0,0,1000,0,90").waitFor();
  await preview.getByText(/layers/).waitFor();
  assert.equal((await lab.robot("lab")).job, null);
  await press("Grow", nextBody);
  await question.getByText(/Is the last body removed\?/).waitFor();
  await question.locator("button:focus").waitFor();
  await page.keyboard.press("Escape");

  // Two bodies wait. The first one grows once a person confirms that the last one is removed.
  const queue = page.getByRole("region", { name: "Queue" });
  for (const count of [1, 2]) {
    await nextBody.getByRole("button", { name: "Add to queue" }).click();
    await queue.getByRole("listitem").nth(count - 1).waitFor();
  }
  assert.equal((await lab.robot("lab")).job, null);
  await picture(page, "queue");
  await checkAccessibility(page, axe, "queue");
  // A click this soon after another one removes nothing.
  await page.waitForTimeout(1_000);
  await queue.getByRole("button", { name: /^Remove / }).last().click();
  await queue.getByRole("listitem").nth(1).waitFor({ state: "detached" });
  // The board keeps the unfinished body until a person discards it.
  await lab1.button("Discard body").click();
  await lab1.confirm("Discard body");
  await lab1.result.filter({ hasText: "discarded by the simulated board" }).waitFor();
  await queue.getByRole("button", { name: "Grow next" }).click();
  await question.getByText(/Is the last body removed\?/).waitFor();
  await lab1.confirm("Heat and grow");
  await waitForState("heating|homing|growing");
  await queue.getByText(/^Empty/).waitFor();
  assert.deepEqual(errors, []);
  console.log("the page of all robots: planned, grew, paused, reconnected, stopped, grew again and grew from its queue");
} finally {
  await browser.close();
  await lab.remove();
}
