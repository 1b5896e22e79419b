// Drags the goal of a preview on the page of `growbot serve` in Debian's Chromium. A path to each goal must be drawn on
// the way, and the fields must have the goal. Prints how long the paths take.
//
//   node drag.js GROWBOT [MOVES]
//
// MOVES is the number of moves of each drag, 5 if it is not given. The browser is `chromium`, or the value of CHROMIUM.

import assert from "node:assert/strict";
import { resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { partsOf } from "./operator.js";

const growbot = resolve(process.argv[2]);
const moves = Number(process.argv[3] ?? 5);
/** Goals of growbot-a, whose bends have a radius of 100 mm: beyond four of them, and closer. */
const GOALS = { "4 R and more": "200,150,380,20,30", nearer: "60,40,120,90,0" };
const SCAN_PIXELS = 8;
const MOVE_PIXELS = 5;
const TIMEOUT_MS = 600_000;

const lab = await startLab(growbot, ["lab"], 1, "growbot-a");
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });

/** Returns the position at which a press would move the goal, pixels of the page. */
async function findGoal(page, canvas) {
  const box = await canvas.boundingBox();
  for (let y = box.y + SCAN_PIXELS; y < box.y + box.height; y += SCAN_PIXELS) {
    for (let x = box.x + SCAN_PIXELS; x < box.x + box.width; x += SCAN_PIXELS) {
      await page.mouse.move(x, y);
      if (await canvas.evaluate(({ style }) => style.cursor) === "move") return [x, y];
    }
  }
  throw new Error("no goal can be dragged");
}

try {
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  page.setDefaultTimeout(TIMEOUT_MS);
  await page.goto(lab.controlUrl);
  const { nextBody, preview, frame, drawnLayers, typeGoal, waitForState } = partsOf(page, "lab");
  const fields = nextBody.getByRole("group", { name: "Goal", exact: true });
  const field = (label) => fields.getByLabel(label, { exact: true });
  await waitForState("idle");
  console.log(`| goal, ${moves} moves | median, ms | max, ms |\n|---|---|---|`);
  for (const [name, goal] of Object.entries(GOALS)) {
    await typeGoal(goal);
    await nextBody.getByRole("button", { name: "Preview", exact: true }).click();
    await preview.waitFor();
    await drawnLayers.waitFor();
    const canvas = frame.locator("canvas");
    const [x, y] = await findGoal(page, canvas);
    await canvas.evaluate(() => {
      window.paths = [];
      window.parent.addEventListener("message", ({ data }) => {
        if (data.growbot?.kind === "goal") window.movedAt = performance.now();
      });
      window.addEventListener("message", ({ data }) => {
        if (data.growbot?.kind !== "path") return;
        window.paths.push({ points: data.growbot.points, tookMs: performance.now() - window.movedAt });
      });
    });
    const readFields = () => Promise.all(["X, mm", "Y, mm", "Z, mm"].map((label) => field(label).inputValue()));
    // A click moves nothing.
    const typed = await readFields();
    await page.mouse.click(x, y);
    assert.deepEqual([await readFields(), await preview.count()], [typed, 1]);
    await page.mouse.down();
    for (let move = 1; move <= moves; move++) {
      await page.mouse.move(x + MOVE_PIXELS * move, y);
      await canvas.evaluate((_, count) => new Promise((done) => {
        const look = () => (window.paths.length >= count ? done() : setTimeout(look, 1));
        look();
      }), move);
    }
    const paths = await canvas.evaluate(() => window.paths);
    const dragged = await readFields();
    const ends = paths.map(({ points }) => points.at(-1));
    assert.deepEqual(ends.at(-1).map((part) => part.toFixed(1)), dragged, "the last path does not end at the goal");
    // The goal moves with the pointer, at the scale of the picture.
    const step = MOVE_PIXELS * await frame.locator(".scale").evaluate((scale) =>
      Number.parseFloat(scale.querySelector("b").innerText) / Number.parseFloat(scale.querySelector("i").style.width));
    for (const [index, end] of ends.slice(1).entries()) {
      const moved = Math.hypot(...end.map((part, k) => part - ends[index][k]));
      assert.ok(Math.abs(moved / step - 1) < 0.05, `the goal moved by ${moved} mm, not ${step} mm`);
    }
    const times = paths.map(({ tookMs }) => tookMs).sort((a, b) => a - b);
    console.log(`| ${name} | ${times[Math.floor(times.length / 2)].toFixed(1)} | ${times.at(-1).toFixed(1)} |`);
    await page.mouse.up();
    // The body to the dropped goal is shown.
    await page.getByText(`: ${dragged.join(", ")} mm, heading`).waitFor();
  }

  // A drag that is cancelled gives the typed goal back.
  await typeGoal("200.125,150,380,20,30");
  await nextBody.getByRole("button", { name: "Preview", exact: true }).click();
  await page.getByText(": 200.1, 150.0, 380.0 mm, heading").waitFor();
  await drawnLayers.waitFor();
  const canvas = frame.locator("canvas");
  const [x, y] = await findGoal(page, canvas);
  await page.mouse.down();
  await page.mouse.move(x + 4 * MOVE_PIXELS, y);
  const input = await field("X, mm").elementHandle();
  await page.waitForFunction(({ value }) => value !== "200.125", input);
  await canvas.dispatchEvent("pointercancel", { pointerId: 1 });
  await page.waitForFunction(({ value }) => value === "200.125", input);
  await page.mouse.up();
} finally {
  await browser.close();
  await lab.remove();
}
