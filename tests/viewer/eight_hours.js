// Follows eight hours of a robot's growth on its page in Debian's Chromium. Memory and elements of the page must stay
// as they are after the first hour, within 10 %. Prints a table.
//
//   node eight_hours.js GROWBOT [PACE]
//
// PACE is the ratio of the robot's time to real time, 200 if it is not given. The browser is `chromium`, or the value of
// CHROMIUM.

import assert from "node:assert/strict";
import { resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { partsOf } from "./operator.js";

const growbot = resolve(process.argv[2]);
const pace = Number(process.argv[3] ?? 200);
/** Layers of growbot-a in an hour, and in eight. A layer of a straight body takes 18 s. */
const LAYERS_PER_HOUR = 200;
const HOURS = 8;
const GOAL = "0,0,1300,0,90";
const MAX_RATIO = 1.1;
const TIMEOUT_MS = 3_600_000;

const lab = await startLab(growbot, ["lab"], pace, "growbot-a");
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
try {
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  page.setDefaultTimeout(TIMEOUT_MS);
  await page.goto(lab.controlUrl);
  const { nextBody, typeGoal, confirm, waitForState, laidLayers } = partsOf(page, "lab");
  await waitForState("idle");
  await typeGoal(GOAL);
  await nextBody.getByRole("button", { name: "Grow", exact: true }).click();
  await confirm("Heat and grow");

  const session = await page.context().newCDPSession(page);
  await session.send("HeapProfiler.enable");
  /** Returns the memory in use, MB, and the number of elements of the page with its frames. */
  const measure = async () => {
    await session.send("HeapProfiler.collectGarbage");
    const { usedSize } = await session.send("Runtime.getHeapUsage");
    const counts = await Promise.all(page.frames().map((frame) => frame.locator("*").count()));
    return { heapMb: usedSize / 1e6, elements: counts.reduce((sum, count) => sum + count) };
  };
  const measured = [];
  for (let hour = 1; hour <= HOURS; hour++) {
    const deadline = Date.now() + TIMEOUT_MS;
    for (let laid = 0; laid < hour * LAYERS_PER_HOUR; laid = await laidLayers()) {
      assert.ok(Date.now() < deadline, `the body does not grow beyond layer ${laid}`);
      await page.waitForTimeout(500);
    }
    measured.push(await measure());
  }
  console.log("| hour | heap, MB | elements |\n|---|---|---|");
  measured.forEach(({ heapMb, elements }, index) => {
    console.log(`| ${index + 1} | ${heapMb.toFixed(2)} | ${elements} |`);
  });
  const [first, last] = [measured[0], measured.at(-1)];
  for (const quantity of ["heapMb", "elements"]) {
    const ratio = last[quantity] / first[quantity];
    assert.ok(ratio < MAX_RATIO, `${quantity} grew by a factor of ${ratio.toFixed(2)} in ${HOURS - 1} hours`);
  }
} finally {
  await browser.close();
  await lab.remove();
}
