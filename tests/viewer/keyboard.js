// The first hour of an operator on the page of `growbot serve`, in Debian's Chromium, by the keyboard alone. Of two
// simulated robots, one grows, is paused, runs out of filament, is stopped and resumed, grows what waits in its
// queue, and grows an earlier body again. The other one has a fault. Everything is
// found by its role and name, and is reached by Tab.
//
//   node keyboard.js GROWBOT
//
// The browser is `chromium`, or the value of CHROMIUM.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { partsOf } from "./operator.js";

const growbot = resolve(process.argv[2]);
const TIMEOUT_MS = 120_000;
/** More than the page has elements that take the focus. */
const MAX_TABS = 200;
/** Time in which a button that heats or discards ignores a second click. */
const CLICK_MS = 1_000;

// One robot has little filament and a switch that detects its end, and one too little time to heat its nozzle. A pause
// may take as long as a person needs, although ten minutes are more than an hour for the robots.
const description = await readFile(resolve(import.meta.dirname, "../../robots/growbot-a1.toml"), "utf8");
const patient = `${description}\n[pause]\nstandby_c = 150.0\nstandby_after_s = 60.0\noff_after_s = 36000.0\n`;
const descriptions = {
  lab: `${patient.replace(/^spool_mm = .*/m, "spool_mm = 9000.0")}\n[sensors.filament_presence]\nactive_low = true\n`,
  cold: patient.replace(/^heating_timeout_s = .*/m, "heating_timeout_s = 10.0"),
};
for (const text of Object.values(descriptions)) assert.notEqual(text, description);

const lab = await startLab(growbot, ["lab", "cold"], 10, "growbot-a1", descriptions);
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"],
});

try {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 } });
  const page = await context.newPage();
  const errors = [];
  page.on("pageerror", (error) => errors.push(error.stack));
  page.setDefaultTimeout(TIMEOUT_MS);

  /** Moves the focus by Tab, or by Shift and Tab to what is before it, until it is on this element. */
  const tabTo = async (element) => {
    await element.waitFor();
    for (let count = 0; count < MAX_TABS; count += 1) {
      const key = await element.evaluate((own) => {
        const focused = own.ownerDocument.activeElement;
        if (own === focused && own.ownerDocument.hasFocus()) return null;
        return own.compareDocumentPosition(focused) === Node.DOCUMENT_POSITION_FOLLOWING ? "Shift+Tab" : "Tab";
      });
      if (key === null) return;
      await page.keyboard.press(key);
    }
    assert.fail(`Tab does not reach ${element}`);
  };
  const press = async (element) => {
    await tabTo(element.and(page.locator(":enabled, a")));
    await page.keyboard.press("Enter");
  };
  const toggle = async (name, within = page) => {
    await tabTo(within.getByRole("checkbox", { name }));
    await page.keyboard.press("Space");
  };
  const type = async (element, text) => {
    await tabTo(element);
    await page.keyboard.press("Control+A");
    await page.keyboard.press("Delete");
    await page.keyboard.type(text);
  };

  // The page opens with all robots. A robot is chosen.
  await page.goto(lab.controlUrl);
  await page.getByRole("button", { name: "Stop all robots" }).waitFor();
  const choose = (name) => press(page.getByRole("navigation").getByRole("link", { name, exact: true }));
  await choose("lab");
  const robot = partsOf(page, "lab");
  const { nextBody, history, question } = robot;
  await robot.waitForState("idle");
  const button = (name, within = nextBody) => within.getByRole("button", { name, exact: true });
  const need = page.getByRole("alert").filter({ hasText: "Next:" });
  const queue = page.getByRole("region", { name: "Queue" });
  const goal = nextBody.getByRole("group", { name: "Goal", exact: true });
  const typeGoal = async (numbers, fields = goal) => {
    const labels = ["X, mm", "Y, mm", "Z, mm", "Heading, °", "Pitch, °"];
    for (const [index, number] of numbers.entries()) {
      await type(fields.getByRole("textbox", { name: labels[index] }), String(number));
    }
  };
  const confirm = async () => {
    await question.waitFor();
    await press(button("Heat and grow", question));
  };
  /** Does the next step of the guided sequence. */
  const doStep = async (text, label) => {
    await need.filter({ hasText: text }).waitFor();
    await press(button(label, need));
    await page.waitForTimeout(CLICK_MS);
  };

  // The first body, with a waypoint. A problem is shown beside its field.
  await press(button("Add waypoint"));
  const waypoint = nextBody.getByRole("group", { name: "Waypoint 1", exact: true }).last();
  await waypoint.getByRole("textbox", { name: "X, mm" }).and(page.locator(":focus")).waitFor();
  await typeGoal([0, 0, "sixty"], waypoint);
  await typeGoal([0, 0, 180, 0, 90]);
  await press(button("Preview"));
  const problem = nextBody.getByRole("status", { name: "Problem of the waypoint 1" });
  await problem.filter({ hasText: "not a length" }).waitFor();
  await typeGoal([0, 0, 60], waypoint);
  await press(button("Preview"));
  await robot.preview.getByText(/180\.0 mm, 234 layers/).waitFor();
  // The spool is too short, which has to be confirmed.
  await robot.preview.getByText(/Filament short/).waitFor();
  await toggle(/^Grow despite/, nextBody);
  await press(button("Grow"));
  await confirm();
  await robot.waitForState("heating|homing|growing");
  await robot.waitForState("growing");
  await press(button("Pause", robot.robot));
  await robot.waitForState("paused");
  await robot.body.getByText(/\d+ of 234 layers, /).waitFor();
  await robot.charts.getByRole("img", { name: /^Temperature of the nozzle over / }).waitFor();
  await press(button("Continue", robot.robot));

  // The filament runs out. The page leads through the change.
  await need.filter({ hasText: /filament/i }).waitFor();
  await robot.waitForState("paused");
  assert.equal(lab.changeSpool("lab").status, 0);
  await doStep("Next:", "Done");
  await doStep("Next:", "Heat nozzle");
  await doStep("Next:", "Load filament");
  await doStep("Next:", "Purge nozzle");
  await doStep("Next:", "Continue growth");
  // The board refuses to continue while filament still moves.
  while ((await lab.robot("lab")).state === "paused") {
    await lab.command("lab", "continue");
    await page.waitForTimeout(CLICK_MS);
  }
  await robot.waitForState("growing");

  // It is stopped, and resumed where it was.
  await press(button("Stop", robot.robot));
  await robot.waitForState("stopped");
  await press(button("Resume", robot.robot));
  await robot.waitForState("heating|homing|growing");
  await robot.job("done").waitFor();

  // The history is searched.
  await type(history.getByRole("searchbox"), "no such job");
  await history.getByText("No job matches").waitFor();
  await type(history.getByRole("searchbox"), "180");
  await robot.job("done").waitFor();
  await type(history.getByRole("searchbox"), "");
  await press(button("Remove waypoint 1"));
  lab.changeSpool("lab");
  // Two bodies wait in the queue, and grow one after the other, each after a confirmation.
  await typeGoal([0, 0, 20, 0, 90]);
  await press(button("Add to queue"));
  await queue.getByRole("listitem").nth(0).waitFor();
  await typeGoal([0, 0, 25, 0, 90]);
  await press(button("Add to queue"));
  await queue.getByRole("listitem").nth(1).waitFor();
  for (const length of ["20", "25"]) {
    await press(button("Grow next", queue));
    await confirm();
    await robot.job(`0,0,${length},0,90`).filter({ hasText: "done" }).waitFor();
  }
  await queue.getByText(/^Empty/).waitFor();

  lab.changeSpool("lab");
  // An earlier body is grown again.
  await press(button("Grow again", robot.job("0,0,20,0,90")));
  await nextBody.getByText("Plan: 0,0,20,0,90").waitFor();
  await robot.preview.getByText(/layers/).waitFor();
  await press(button("Grow"));
  await confirm();
  await robot.waitForState("heating|homing|growing");
  await press(button("Emergency stop lab", page));
  await robot.waitForState("emergency-stop");
  await lab.waitForRobot("lab", ({ job }) => job === null, "the job does not end");
  await doStep("Next:", "Done");
  await doStep("Next:", "Clear fault");
  await robot.waitForState("idle");

  // The other robot has a fault.
  await choose("cold");
  const cold = partsOf(page, "cold");
  await cold.waitForState("idle");
  await typeGoal([0, 0, 20, 0, 90]);
  await press(button("Grow"));
  await confirm();
  await cold.waitForState("fault");
  await doStep("heating", "Done");
  await doStep("Next:", "Clear fault");
  await cold.waitForState("idle");

  // A setting is changed.
  await context.grantPermissions(["notifications"]);
  await toggle(/^Notify me in this browser/);
  await page.getByRole("checkbox", { name: /^Notify me/, checked: true }).waitFor();
  await page.reload();
  await page.getByRole("checkbox", { name: /^Notify me/, checked: true }).waitFor();
  assert.deepEqual(errors, []);
  console.log("the first hour by the keyboard: two robots, a runout, a stop, a queue of two, a fault and a setting");
} finally {
  await browser.close();
  await lab.remove();
}
