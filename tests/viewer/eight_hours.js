// Follows eight hours of a robot's growth on its page in Debian's Chromium. From the second hour on, when the charts
// have all the points that they keep, memory and elements of the page must stay the same within 10 %. Prints a table.
//
//   node eight_hours.js GROWBOT [PACE]
//
// PACE is the ratio of the robot's time to real time, 200 if it is not given. The browser is `chromium`, or the value
// of CHROMIUM.

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
/** Hour with which the later ones are compared. */
const REFERENCE_HOUR = 2;
const MEASUREMENTS = 10;
const MEASURE_MS = 200;
const GOAL = "0,0,1300,0,90";
const MAX_RATIO = 1.1;
const TIMEOUT_MS = 3_600_000;

const lab = await startLab(growbot, ["lab"], pace, "growbot-a");
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
// Without compilers, whose code and statistics grow for minutes whatever a page does.
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox", "--js-flags=--jitless"] });
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
  /** Returns the memory in use, MB, with and without arrays of numbers, and the number of elements with all frames. */
  const measure = async () => {
    const sizes = [];
    // What an update needs for a moment is not kept, so the smallest of some measurements counts.
    for (let i = 0; i < MEASUREMENTS; i++) {
      await session.send("HeapProfiler.collectGarbage");
      sizes.push(await session.send("Runtime.getHeapUsage"));
      await page.waitForTimeout(MEASURE_MS);
    }
    const min = (name) => Math.min(...sizes.map((size) => size[name])) / 1e6;
    const counts = await Promise.all(page.frames().map((frame) => frame.locator("*").count()));
    const elements = counts.reduce((sum, count) => sum + count);
    return { heapMb: min("usedSize"), arraysMb: min("backingStorageSize"), elements };
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
  console.log("| hour | heap, MB | arrays, MB | elements |\n|---|---|---|---|");
  measured.forEach(({ heapMb, arraysMb, elements }, index) => {
    console.log(`| ${index + 1} | ${heapMb.toFixed(2)} | ${arraysMb.toFixed(2)} | ${elements} |`);
  });
  const [reference, ...later] = measured.slice(REFERENCE_HOUR - 1);
  for (const quantity of ["heapMb", "arraysMb", "elements"]) {
    const ratio = Math.max(...later.map((hour) => hour[quantity])) / reference[quantity];
    assert.ok(ratio < MAX_RATIO, `${quantity} grew by a factor of ${ratio.toFixed(2)} after hour ${REFERENCE_HOUR}`);
  }
} finally {
  await browser.close();
  await lab.remove();
}
