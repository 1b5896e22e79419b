// Grows a body on from the tip of the last one, calibrates a robot and commissions it on the page of `growbot serve` in
// Debian's Chromium, with a simulated robot. Everything is found by role and name.
//
//   node guided.js GROWBOT
//
// The test does not need a fast browser. The browser is `chromium`, or the value of CHROMIUM.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { checkAccessibility, checkTargets, checkWidth, openPage, partsOf } from "./operator.js";

const growbot = resolve(process.argv[2]);
const TIMEOUT_MS = 600_000;
/** Time after which a click on another button counts as one of its own (growbot-page/src/second_click.ts). */
const SECOND_CLICK_MS = 800;
const errors = [];
const axe = await readFile(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

const lab = await startLab(growbot, ["lab"], 8);
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });

try {
  const page = await openPage(browser, lab.controlUrl, { timeoutMs: TIMEOUT_MS, errors });
  const { nextBody, preview, question, confirm, job, button, result, typeGoal, waitForState } = partsOf(page, "lab");
  const need = page.getByRole("alert").filter({ hasText: "Next:" });
  const gains = page.getByRole("status", { name: "Gains of the heater" });
  const press = (name) => nextBody.getByRole("button", { name, exact: true }).click();
  const lastTip = nextBody.getByRole("checkbox", { name: /tip of the last body/ });
  const step = async (name) => {
    const next = need.getByRole("button", { name, exact: true });
    await next.waitFor();
    await page.waitForTimeout(SECOND_CLICK_MS);
    const before = await need.innerText();
    await next.click();
    await page.waitForFunction((text) => {
      const alert = [...document.querySelectorAll("[role=alert]")].find(({ innerText }) => innerText.includes("Next:"));
      return alert?.innerText !== text;
    }, before);
  };

  // A body from the base, and one on from its tip. The question is not whether the first one is removed.
  await waitForState("idle");
  assert.equal(await lastTip.count(), 0, "there is no last body yet");
  await typeGoal("40,20,150,27,60");
  await press("Grow");
  assert.match(await question.innerText(), /Is the last body removed\?/);
  await confirm("Heat and grow");
  await job("40,20,150").filter({ hasText: "done" }).waitFor();
  await lastTip.check();
  await typeGoal("200,60,250,20,20");
  await press("Preview");
  await preview.waitFor();
  await checkAccessibility(page, axe, "a body from the last tip");
  await press("Add to queue");
  await result.filter({ hasText: "cannot wait" }).waitFor();
  await press("Grow");
  assert.match(await question.innerText(), /Is the last body in place, with the robot at its tip\?/);
  await confirm("Heat and grow");
  await job("200,60,250").filter({ hasText: "done" }).waitFor();
  assert.equal(await lastTip.isChecked(), false, "the next body begins at the base again");

  // The heater is calibrated, with a stop on the way.
  await button("Calibrate").click();
  await checkAccessibility(page, axe, "calibration");
  await step("Tune heater");
  await waitForState("tuning");
  await need.filter({ hasText: "The nozzle is hot." }).waitFor();
  await button("Stop").click();
  await waitForState("stopped");
  assert.equal(await gains.count(), 0, "a tuning that was stopped has found nothing");
  await need.getByRole("button", { name: "Leave" }).click();
  await button("Calibrate").click();
  await step("Tune heater");
  await gains.getByText("kp", { exact: true }).waitFor();
  await waitForState("idle");
  await need.filter({ hasText: "Write the gains" }).waitFor();
  await step("Done");
  await need.waitFor({ state: "detached" });

  // Nothing begins while the nozzle is heated.
  const maintain = async (task) => {
    assert.equal((await lab.ask("POST", "/robots/lab/maintenance", { task, value: "" })).status, 200);
  };
  await maintain("preheat");
  await waitForState("maintenance");
  await button("Commission").click();
  await result.filter({ hasText: "run the task Cool down first" }).waitFor();
  await maintain("cooldown");
  await waitForState("idle");

  // The robot is commissioned. An emergency stop on the way comes first, and then the sequence continues. After a stop
  // it continues with the step that switches the motors on.
  await button("Commission").click();
  await step("Done");
  await step("Done");
  assert.equal((await lab.command("lab", "emergency-stop")).status, 200);
  await need.filter({ hasText: "Emergency stop:" }).waitFor();
  await step("Done");
  await step("Clear fault");
  await need.filter({ hasText: "Commissioning:" }).waitFor();
  await waitForState("idle");
  for (const name of ["Done", "Done", "Motors on", "Turn head"]) await step(name);
  await need.getByRole("button", { name: "Push filament" }).waitFor();
  await button("Stop").click();
  await waitForState("stopped");
  const steps = ["Motors on", "Turn head", "Push filament", "Cool nozzle", "Done", "Heat nozzle"];
  for (const name of steps) await step(name);
  await lab.waitForRobot("lab", ({ state, target_c: target }) => state === "maintenance" && target === 200, "hot");
  await page.setViewportSize({ width: 390, height: 844 });
  await checkTargets(page);
  await checkWidth(page, "commissioning on a phone");
  await step("Done");
  await step("Cool nozzle");
  await waitForState("idle");
  // The state may be known before the response to the last step.
  await need.waitFor({ state: "detached" });
  assert.deepEqual(errors, []);
  console.log("a body on from the last tip, a calibration with a stop, and a commissioning with an emergency stop");
} finally {
  await browser.close();
  await lab.remove();
}
