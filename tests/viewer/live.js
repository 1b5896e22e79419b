// Follows growths on the simulated robot in Debian's Chromium, on the page of `growbot grow --watch`. The page grows
// with the robot, its buttons pause, continue and stop the growth, and it reports the end. It requests nothing but its
// own updates. Without --control there are no buttons.
//
//   node live.js GROWBOT
//
// Time passes for the robot while the browser works, so the test must not need a fast browser. The robot waits for a
// day before it parks, and a growth takes minutes. Both growths run at the same time.
//
// The browser is `chromium`, or the value of CHROMIUM.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";
import { environment } from "./environment.js";
import { watchRequests } from "./service.js";

const growbot = resolve(process.argv[2]);
const TIMEOUT_MS = 600_000;
/** Connections of a page that may be too slow. More are a fault. */
const MAX_RETRIES = 3;
const errors = [];
const children = [];

const directory = await mkdtemp(join(tmpdir(), "growbot-live-"));
const patient = join(directory, "patient.toml");
const description = await readFile(new URL("../../robots/growbot-a.toml", import.meta.url), "utf8");
const parksAfter = /^off_after_s = .*$/m;
assert.match(description, parksAfter);
await writeFile(patient, description.replace(parksAfter, "off_after_s = 86400.0"));

/** Starts a growth of 400 mm with a page. Returns the promise of its exit code, and the page's address. */
async function grow(...args) {
  const growth = ["grow", "--robot", patient, "--to", "60,40,390,30,60", "--watch", ...args];
  const child = spawn(growbot, growth, { env: environment, stdio: ["ignore", "ignore", "pipe"] });
  children.push(child);
  const ended = once(child, "exit").then(([code]) => code);
  for await (const line of createInterface({ input: child.stderr })) {
    const address = /live view: (.*)$/.exec(line)?.[1];
    if (address) {
      child.stderr.resume();
      return { address, ended };
    }
  }
  throw new Error(`growbot ended with ${await ended} and printed no address`);
}

/**
 * Opens the page below the path of its rights, `view` or `control`. With `update`, the page gets this update instead of
 * growbot's.
 */
async function open(browser, address, path, update) {
  const page = await browser.newPage({ viewport: { width: 1200, height: 760 }, colorScheme: "light" });
  if (update) {
    // On a busy machine the page may give up the socket, and request the stream.
    const message = JSON.stringify({ event: "update", data: update });
    await page.routeWebSocket("**/updates/ws", (socket) => socket.send(message));
    const stream = { contentType: "text/event-stream", body: `event: update\ndata: ${JSON.stringify(update)}\n\n` };
    await page.route("**/updates", (route) => route.fulfill(stream));
  }
  page.setDefaultTimeout(TIMEOUT_MS);
  // On a busy machine a page gives up a connection that is too slow, and makes another. The browser reports that.
  let retries = 0;
  page.on("console", (message) => {
    if (message.text().includes("closed before the connection is established") && retries < MAX_RETRIES) retries += 1;
    else errors.push(`console ${message.type()}: ${message.text()}`);
  });
  page.on("pageerror", (error) => errors.push(error.stack));
  watchRequests(page, address, path, errors);
  await page.goto(address);
  await page.waitForSelector(".stage[data-drawn]");
  return page;
}

const laidLayers = async (page) => Number((await page.textContent("#laid")).split(" ")[0]);
const waitForLayers = (page, layers) =>
  page.waitForFunction((min) => Number(document.querySelector("#laid").textContent.split(" ")[0]) >= min, layers);
const waitForState = (page, state) =>
  page.waitForFunction((name) => document.querySelector("#state").textContent === name, state);

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});
try {
  const watched = await grow("--pace", "100");
  const readOnly = await open(browser, watched.address, "view");
  await waitForState(readOnly, "growing");
  assert.ok(await readOnly.isHidden("#commands"), "a read-only page has command buttons");

  const controlled = await grow("--control", "--pace", "60");
  const page = await open(browser, controlled.address, "control");
  await waitForState(page, "growing");
  await waitForLayers(page, 5);
  assert.match(await page.textContent("#remaining"), /left, done at (tomorrow )?\d\d:\d\d$/);
  assert.match(await page.textContent("#temperature"), /\d+\.\d °C, target 200 °C/);
  await page.waitForFunction(() => Number(document.querySelector("#slider").max) >= 5);
  assert.match(await page.textContent("#bar output"), /^layer \d+ of \d{3} /);
  await page.click("#command-pause");
  await waitForState(page, "paused");
  const pausedAt = await laidLayers(page);
  assert.notEqual(await page.textContent("#explanation"), "", "no explanation of the pause");
  assert.ok(await page.isVisible("[data-command=purge]"), "filament cannot be changed during a pause");
  await page.click("#command-continue");
  await waitForLayers(page, pausedAt + 3);
  if (process.env.PICTURES) await page.screenshot({ path: `${process.env.PICTURES}/live.png` });
  // A page that is opened later shows everything too.
  const second = await open(browser, controlled.address, "control");
  await waitForLayers(second, pausedAt + 3);
  await second.waitForFunction((min) => Number(document.querySelector("#slider").max) >= min, pausedAt + 3);
  await second.close();
  // A board that was stopped because of its clock, as reported at the end.
  const drift = { message: "the board's clock is 5.0 % slow (limit 2 %)", remedy: "check the board's crystal" };
  const drifted = await open(browser, controlled.address, "control", {
    state: "stopped",
    board_responding: true,
    total_layers: 10,
    remaining_s: 0,
    layers: { from: 0, built: "" },
    readings: { from: 0, taken: [] },
    result: { outcome: "clock-drift", clock_drift: drift },
  });
  await waitForState(drifted, "clock-drift");
  const problem = await drifted.textContent("#problem");
  assert.ok(problem.includes(drift.message) && problem.includes(drift.remedy), problem);
  assert.ok(await drifted.isVisible("#problem"));
  await drifted.close();
  await page.click("[data-command=stop]");
  await waitForState(page, "stopped");
  assert.equal(await controlled.ended, 1, "the exit code of a stopped growth is not 1");
  await page.waitForSelector("#result dl");
  const stopped = await laidLayers(page);
  console.log(`live: grew, paused at layer ${pausedAt}, continued, stopped after ${stopped}`);
  await page.close();

  await waitForState(readOnly, "done");
  assert.equal(await watched.ended, 0);
  await readOnly.waitForFunction(() => /^layer (\d+) of \1 /.test(document.querySelector("#bar output").textContent));
  if (process.env.PICTURES) await readOnly.screenshot({ path: `${process.env.PICTURES}/live-done.png` });
  console.log(`live: followed ${await laidLayers(readOnly)} layers to their end`);
  assert.deepEqual(errors, []);
  console.log("live: passed");
} finally {
  children.forEach((child) => child.kill());
  await browser.close();
  await rm(directory, { recursive: true });
}
