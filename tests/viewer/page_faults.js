// Uses the page of all robots of `growbot serve` in Debian's Chromium while something is wrong: the emergency stop is
// clicked twice, seven tabs are open, requests hang, the service is frozen, killed, busy or restarted with new tokens,
// and a board is silent. A proxy between the browser and the service rejects requests or holds them back.
//
//   node page_faults.js GROWBOT [PICTURES]
//
// PICTURES is a directory for pictures of the page. The test does not need a fast browser. The browser is `chromium`,
// or the value of CHROMIUM.

import assert from "node:assert/strict";
import { join, resolve } from "node:path";
import { setTimeout as sleep } from "node:timers/promises";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { startProxy } from "./fault_proxy.js";
import { checkWidth, partsOf } from "./operator.js";

const growbot = resolve(process.argv[2]);
const pictures = process.argv[3];
const TIMEOUT_MS = 120_000;
const TABS = 7;
/** Number of HTTP connections that Chromium opens to a host. */
const BROWSER_CONNECTIONS = 6;
const BUSY = 503;
/** Time in which a page that tries to connect again does so, and refreshes its list of jobs. */
const SILENCE_MS = 12_000;
const errors = [];

const lab = await startLab(growbot, ["bench", "lab"], 4);
const proxy = await startProxy(new URL(lab.controlUrl).port);
const throughProxy = (url) => Object.assign(new URL(url), { port: proxy.port }).href;
let url = throughProxy(lab.controlUrl);
const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args });

/** Opens a context, whose pages share a worker as the tabs of a person do. */
async function newContext(options) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, ...options });
  context.setDefaultTimeout(TIMEOUT_MS);
  context.on("page", (page) => page.on("pageerror", (error) => errors.push(error.stack)));
  return context;
}

async function open(context, address = url) {
  const page = await context.newPage();
  await page.goto(address);
  return page;
}

const picture = (page, name) => pictures && page.screenshot({ path: join(pictures, `${name}.png`) });
const partsOfLab = (page) => partsOf(page, "lab");
const waitForText = (locator, text) => locator.filter({ hasText: text }).waitFor();
const waitUntilLive = (page) => waitForText(partsOfLab(page).connection, /^Live$/);
const hrefOfBody = (page) => page.getByRole("link", { name: "Open in new tab" }).evaluate((link) => link.href);
const growing = (robot) => robot.state === "growing" && robot.laid > 2;

/** Lets the robot grow a new body, from whatever state. */
async function grow() {
  await lab.command("lab", "stop");
  await lab.waitForRobot("lab", (robot) => robot.connection === "ready", "not ready");
  for (const command of ["clear-fault", "cancel"]) await lab.command("lab", command);
  // The nozzle may still be too hot for the proof of the switches.
  for (let attempt = 0; ; attempt += 1) {
    const { status, json } = await lab.ask("POST", "/robots/lab/jobs", { to: "0,0,1000,0,90" });
    if (status === 201) break;
    assert.ok(attempt < 300 && /cooled/.test(json.detail), `${status} ${JSON.stringify(json)}`);
    await new Promise((wait) => { setTimeout(wait, 200); });
  }
  return lab.waitForRobot("lab", growing, "does not grow");
}

/** Records in each frame whether the emergency stop is where it was, and on top. */
const watchStop = (page) => page.evaluate(() => {
  const stop = document.querySelector("#emergency-stop");
  const place = () => JSON.stringify(stop.getBoundingClientRect());
  const [first, { x, y, width, height }] = [place(), stop.getBoundingClientRect()];
  window.moves = [];
  window.frames = 0;
  const look = () => {
    window.frames += 1;
    const top = document.elementFromPoint(x + width / 2, y + height / 2);
    if (place() !== first || top !== stop) window.moves.push(`${place()} below ${top?.outerHTML.slice(0, 80)}`);
    requestAnimationFrame(look);
  };
  look();
});

/** Clicks the emergency stop, and the same place 0.4 s and 1 s later. */
async function clickStopRepeatedly(page) {
  await watchStop(page);
  const { x, y, width, height } = await partsOfLab(page).stop.boundingBox();
  const before = await lab.countCommands("emergency-stop");
  await page.mouse.click(x + width / 2, y + height / 2);
  for (const pause of [400, 600]) {
    await page.waitForTimeout(pause);
    await page.mouse.click(x + width / 2, y + height / 2);
  }
  // All have been carried out, so none follows the commands of the next check.
  while (await lab.countCommands("emergency-stop") < before + 3) await page.waitForTimeout(50);
  await waitForText(partsOfLab(page).state, /^emergency-stop$/);
  // A busy machine draws few frames, and each after the last click counts, too.
  await page.waitForFunction((drawn) => window.frames > drawn + 3, await page.evaluate(() => window.frames));
  assert.deepEqual((await page.evaluate(() => window.moves)).slice(0, 3), []);
}

async function aSecondClickOnTheStopDestroysNothing() {
  await grow();
  let laid = null;
  for (const [width, height] of [[320, 640], [800, 600], [1280, 800]]) {
    for (const colorScheme of ["light", "dark"]) {
      const context = await newContext({ viewport: { width, height }, colorScheme });
      const page = await open(context, `${url}#lab`);
      await waitForText(partsOfLab(page).stop, /^Emergency stop lab$/);
      await waitUntilLive(page);
      await page.waitForFunction(() => !document.querySelector("#emergency-stop").disabled);
      await checkWidth(page, `the page of ${width} pixels`);
      // The cards, scrolled to the end.
      await page.evaluate(() => scrollTo(0, document.body.scrollHeight));
      await clickStopRepeatedly(page);
      const robot = await lab.robot("lab");
      laid ??= robot.laid;
      assert.ok(laid > 0 && robot.laid === laid && robot.layers > laid, JSON.stringify(robot));
      await picture(page, `stopped-${width}-${colorScheme}`);
      // A body is shown.
      await lab.clearFault("lab");
      await waitForText(partsOfLab(page).state, /^idle$/);
      await partsOfLab(page).history.getByRole("button", { name: "Compare" }).first().click();
      await partsOfLab(page).frame.locator("canvas").first().waitFor();
      await picture(page, `body-${width}-${colorScheme}`);
      await clickStopRepeatedly(page);
      // A question is open.
      await lab.clearFault("lab");
      await waitForText(partsOfLab(page).state, /^idle$/);
      await partsOfLab(page).robot.getByRole("button", { name: "Discard body" }).click();
      await partsOfLab(page).question.waitFor();
      await picture(page, `question-${width}-${colorScheme}`);
      await clickStopRepeatedly(page);
      assert.ok(await partsOfLab(page).question.isVisible());
      await page.getByRole("button", { name: "Keep", exact: true }).click();
      await lab.clearFault("lab");
      const kept = await lab.robot("lab");
      assert.ok(kept.laid === laid && kept.layers > laid, JSON.stringify(kept));
      await context.close();
    }
  }
}

async function discardingAsks() {
  const context = await newContext();
  const page = await open(context, `${url}#lab`);
  const discard = partsOfLab(page).robot.getByRole("button", { name: "Discard body" });
  const hasBody = async () => (await lab.robot("lab")).layers > 0;
  // A double click on the button does not answer the question.
  await discard.dblclick();
  await partsOfLab(page).question.locator("button:focus").waitFor();
  assert.ok(await hasBody());
  await page.keyboard.press("Escape");
  await partsOfLab(page).question.waitFor({ state: "hidden" });
  assert.ok(await hasBody());
  await discard.click();
  await partsOfLab(page).confirm("Discard body");
  await lab.waitForRobot("lab", (robot) => robot.layers === 0, "the body is not discarded");
  await context.close();
}

async function sevenTabsShareOneStream() {
  await grow();
  // The body must not be finished before all tabs are open.
  await lab.command("lab", "pause");
  const context = await newContext();
  while (proxy.openStreams > 0) await sleep(50);
  proxy.mostStreams = 0;
  const tabs = [];
  for (let tab = 0; tab < TABS; tab += 1) {
    const page = await open(context, `${url}#lab`);
    await waitUntilLive(page);
    await partsOfLab(page).drawnLayers.waitFor();
    tabs.push(page);
  }
  // There is one stream. On a busy machine it may be opened again before the proxy knows that it was closed.
  assert.ok(proxy.mostStreams <= 2, `${proxy.mostStreams} streams at once`);
  // All connections that the browser opens for requests hang, as when plans are computed. The stop of the last tab has
  // its own.
  proxy.onRequest = (path) => (path === "hang" ? "hold" : null);
  await tabs[0].evaluate(() => { for (let index = 0; index < 20; index += 1) fetch("hang").catch(() => {}); });
  const hanging = () => proxy.paths.filter((path) => path === "hang").length;
  while (hanging() < BROWSER_CONNECTIONS) await tabs[0].waitForTimeout(50);
  proxy.paths.length = 0;
  await partsOfLab(tabs.at(-1)).stop.click();
  await lab.waitForRobot("lab", (robot) => robot.state === "emergency-stop", "the stop does not arrive");
  // A connection to the 3D view may be opened again.
  assert.deepEqual(proxy.paths.filter((path) => !path.endsWith("/ws")), []);
  for (const tab of tabs) await waitForText(partsOfLab(tab).state, /^emergency-stop$/);
  await partsOfLab(tabs.at(-1)).banners.waitFor({ state: "detached" });
  proxy.onRequest = () => null;
  await context.close();
}

async function aFrozenServiceIsShownAndAStopAsksToCutThePower() {
  await grow();
  const context = await newContext();
  const page = await open(context, `${url}#lab`);
  await waitForText(partsOfLab(page).state, /^growing$/);
  await waitUntilLive(page);
  lab.signal("SIGSTOP");
  await partsOfLab(page).stop.click();
  const banner = partsOfLab(page).banners;
  await waitForText(banner, /Emergency stop of lab: not confirmed after \d+ s.*Cut the robot's power.*growbot estop/);
  await waitForText(partsOfLab(page).connection, /No data for \d+ s/);
  await waitForText(partsOfLab(page).state, /^last known: growing$/);
  await waitForText(partsOfLab(page).age, /^\d.* old: the service does not respond$/);
  await picture(page, "frozen");
  await page.setViewportSize({ width: 320, height: 640 });
  await picture(page, "frozen-phone");
  await page.setViewportSize({ width: 1280, height: 800 });
  assert.ok(await partsOfLab(page).robot.getByRole("button", { name: "Continue" }).isDisabled());
  assert.ok(await partsOfLab(page).robot.getByRole("button", { name: "Pause" }).isEnabled());
  lab.signal("SIGCONT");
  await waitForText(partsOfLab(page).state, /^emergency-stop$/);
  await waitUntilLive(page);
  await banner.waitFor({ state: "detached" });
  await context.close();
}

async function aLateOrderIsRefused() {
  await grow();
  const context = await newContext();
  const page = await open(context, `${url}#lab`);
  await waitUntilLive(page);
  await partsOfLab(page).robot.getByRole("button", { name: "Pause" }).click();
  await waitForText(partsOfLab(page).state, /^paused$/);
  // A click this soon after another one moves nothing.
  await page.waitForTimeout(1_000);
  lab.signal("SIGSTOP");
  await partsOfLab(page).robot.getByRole("button", { name: "Continue" }).click();
  await waitForText(partsOfLab(page).banners, /Continue of lab: not confirmed after \d+ s.*unknown/);
  await waitForText(partsOfLab(page).connection, /No data for ([7-9]|\d\d+) s/);
  lab.signal("SIGCONT");
  await waitForText(partsOfLab(page).result, /arrived \d+\.\d s after it was given \(limit 5 s\)/);
  assert.equal((await lab.robot("lab")).state, "paused");
  await lab.command("lab", "stop");
  await context.close();
}

async function aDeadServiceIsShown() {
  await grow();
  const context = await newContext();
  const page = await open(context, `${url}#lab`);
  await waitForText(partsOfLab(page).state, /^growing$/);
  const live = partsOfLab(page).frame;
  await partsOfLab(page).drawnLayers.waitFor();
  await lab.kill();
  await waitForText(partsOfLab(page).state, /^last known: growing$/);
  await waitForText(partsOfLab(page).connection, /No data for \d+ s, connecting again/);
  await live.locator("#age", { hasText: /what is shown is \d+ s old/ }).waitFor();
  await picture(page, "dead");
  await partsOfLab(page).stop.click();
  await waitForText(partsOfLab(page).banners, /Emergency stop of lab: .*Cut the robot's power now/);
  await lab.start();
  // The page sends the stop until the service responds.
  await waitForText(partsOfLab(page).state, /^emergency-stop$/);
  await waitUntilLive(page);
  await partsOfLab(page).banners.waitFor({ state: "detached" });
  await context.close();
}

async function aServiceWithNewTokensIsShown() {
  await grow();
  const context = await newContext();
  const page = await open(context, `${url}#lab`);
  await waitUntilLive(page);
  const live = partsOfLab(page).frame;
  await partsOfLab(page).drawnLayers.waitFor();
  const growth = await open(context, await hrefOfBody(page));
  await waitForText(growth.locator("#state"), /^growing$/);
  const stops = await lab.countCommands("emergency-stop");
  await lab.kill();
  // This stop is sent until the service responds, which then refuses it.
  await partsOfLab(page).stop.click();
  const banners = partsOfLab(page).banners;
  await waitForText(banners, /Emergency stop of lab: .*This page keeps sending the stop/);
  await lab.start({ newSocket: true });
  const stopBanner = banners.filter({ hasText: "Emergency stop of lab" });
  await waitForText(stopBanner, /: this request has no access token.*Cut the robot's power now, or run `growbot estop`/);
  await waitForText(partsOfLab(page).connection, /^No access$/);
  const expired = banners.filter({ hasText: "The service refuses this page" });
  await waitForText(expired, /open the address that `growbot serve` prints.*`growbot estop`.*or cut their power/);
  for (const frame of [live, growth]) {
    await waitForText(frame.locator("#problem"), /^growbot refuses this page.*open the address that `growbot serve` /);
  }
  await picture(page, "no-access");
  assert.doesNotMatch(await page.innerText("body"), /keeps sending|connecting again/);
  assert.doesNotMatch(await growth.innerText("body"), /Retrying/);
  // Nothing is sent any more: neither by the pages, nor by their worker.
  await page.waitForTimeout(2_000);
  proxy.paths.length = 0;
  await page.waitForTimeout(SILENCE_MS);
  assert.deepEqual(proxy.paths, []);
  await waitForText(partsOfLab(page).age, /^\d.* old: the service does not respond$/);
  // No stop has been carried out, and a further one is not either. Each page shows that.
  await growth.locator("#emergency-stop").click();
  const problem = growth.locator("#command-problem");
  await waitForText(problem, /^emergency-stop was rejected: this request.*cut the robot's power/);
  await partsOfLab(page).stop.click();
  await waitForText(stopBanner.nth(1), /Cut the robot's power now, or run `growbot estop`/);
  assert.equal(await lab.countCommands("emergency-stop"), stops);
  // The new address gives this browser the new token, with which the older page works, too.
  url = throughProxy(lab.controlUrl);
  const next = await open(context, `${url}#lab`);
  for (const tab of [next, page]) await waitUntilLive(tab);
  await expired.waitFor({ state: "detached" });
  assert.equal(await stopBanner.count(), 2);
  await partsOfLab(page).stop.click();
  await waitForText(partsOfLab(next).state, /^emergency-stop$/);
  await context.close();
}

async function aBusyServiceIsTriedAgain() {
  await grow();
  const counts = {};
  // Everything but the page's files is rejected at first.
  proxy.onRequest = (path) => {
    if (!path.startsWith("api/") || path.endsWith("/live/")) return null;
    const kind = path.replace(/\?.*/, "");
    counts[kind] = (counts[kind] ?? 0) + 1;
    return counts[kind] <= 2 ? BUSY : null;
  };
  const context = await newContext();
  const page = await open(context, `${url}#lab`);
  await waitUntilLive(page);
  await partsOfLab(page).button("Pause").and(page.locator(":enabled")).waitFor();
  await waitForText(partsOfLab(page).job("active"), /active/);
  // So it is for the page of a growth.
  const { job } = await lab.robot("lab");
  await page.goto(`${url}api/v1/jobs/${job}/live/`);
  await waitForText(page.locator("#state"), /^growing$/);
  assert.ok(Object.values(counts).filter((count) => count > 2).length >= 4, JSON.stringify(counts));
  proxy.onRequest = () => null;
  await lab.command("lab", "stop");
  await context.close();
}

async function aProxyWithoutWebSocketsIsEnough() {
  await grow();
  proxy.onRequest = (path) => (path.endsWith("/ws") ? 400 : null);
  proxy.paths.length = 0;
  const context = await newContext();
  const page = await open(context, `${url}#lab`);
  await waitUntilLive(page);
  await partsOfLab(page).stop.click();
  await waitForText(partsOfLab(page).state, /^emergency-stop$/);
  await waitForText(partsOfLab(page).result, /^Emergency stop: heater and steppers of the simulated robot are off$/);
  assert.ok(proxy.paths.includes("api/v1/events") && proxy.paths.includes("api/v1/robots/lab/commands"));
  proxy.onRequest = () => null;
  await context.close();
}

async function aSilentBoardIsShown() {
  await grow();
  const context = await newContext();
  const page = await open(context, `${url}#lab`);
  await waitForText(partsOfLab(page).state, /^growing$/);
  const live = partsOfLab(page).frame;
  await partsOfLab(page).drawnLayers.waitFor();
  const robot = lab.robotProcess("lab");
  process.kill(robot, "SIGSTOP");
  try {
    await waitForText(partsOfLab(page).age, /^\d+ s old: the board does not respond$/);
    await live.locator("#age", { hasText: /The board last reported \d+ s ago/ }).waitFor();
    await picture(page, "silent-board");
    await waitUntilLive(page);
  } finally {
    process.kill(robot, "SIGCONT");
  }
  await waitForText(partsOfLab(page).state, /^growing$/);
  await live.locator("#age").waitFor({ state: "hidden" });
  // On the page of a growth, a double click on Pause does not continue it.
  await page.goto(await hrefOfBody(page));
  await waitForText(page.locator("#state"), /^growing$/);
  const pause = await page.locator("#command-pause").boundingBox();
  await page.mouse.click(pause.x + 5, pause.y + 5);
  await waitForText(page.locator("#state"), /^paused$/);
  await page.mouse.click(pause.x + 5, pause.y + 5);
  await page.setViewportSize({ width: 320, height: 640 });
  await checkWidth(page, "the live page on a phone");
  await page.evaluate(() => scrollTo(0, document.body.scrollHeight));
  await picture(page, "live-phone");
  await clickLiveStop(page);
  await context.close();
}

/** Clicks the emergency stop of the page of a growth twice. */
async function clickLiveStop(page) {
  await watchStop(page);
  const { x, y } = await partsOfLab(page).stop.boundingBox();
  const before = await lab.countCommands("emergency-stop");
  await page.mouse.click(x + 9, y + 9);
  await lab.waitForRobot("lab", (robot) => robot.state === "emergency-stop", "the stop does not arrive");
  await page.mouse.click(x + 9, y + 9);
  // Both have been carried out, so none follows the commands of the next check.
  while (await lab.countCommands("emergency-stop") < before + 2) await page.waitForTimeout(50);
  assert.deepEqual((await page.evaluate(() => window.moves)).slice(0, 3), []);
}

async function oneStopIsForAllRobots() {
  await lab.clearFault("lab");
  const context = await newContext({ viewport: { width: 320, height: 640 } });
  const page = await open(context);
  await waitForText(partsOfLab(page).stop, /^Stop all robots$/);
  await waitForText(partsOfLab(page).state, /^idle$/);
  await watchStop(page);
  await picture(page, "all-phone");
  await page.getByRole("navigation").getByRole("link", { name: "bench" }).click();
  await waitForText(partsOfLab(page).stop, /^Emergency stop bench$/);
  assert.ok(await partsOfLab(page).robot.isHidden());
  await page.getByRole("navigation").getByRole("link", { name: "All robots" }).click();
  await waitForText(partsOfLab(page).stop, /^Stop all robots$/);
  // The view changes while the stop is pressed. The press stays that of all robots.
  await partsOfLab(page).stop.hover();
  await page.mouse.down();
  await page.evaluate(() => { location.hash = "#bench"; });
  await page.getByRole("region", { name: "Robot bench" }).waitFor();
  assert.match(await partsOfLab(page).stop.innerText(), /^Stop all robots$/);
  await page.mouse.up();
  const responses = page.getByRole("region", { name: "Responses to the stop" });
  for (const name of ["lab", "bench"]) {
    await lab.waitForRobot(name, (robot) => robot.state === "emergency-stop", "is not stopped");
    await responses.getByRole("listitem").filter({ hasText: `${name} off, confirmed by the board` }).waitFor();
  }
  await waitForText(partsOfLab(page).stop, /^Emergency stop bench$/);
  assert.deepEqual(await page.evaluate(() => window.moves), []);
  await picture(page, "all-phone-stopped");
  await context.close();
}

try {
  const only = process.env.ONLY;
  for (const check of [
    aSecondClickOnTheStopDestroysNothing, discardingAsks, sevenTabsShareOneStream,
    aFrozenServiceIsShownAndAStopAsksToCutThePower, aLateOrderIsRefused, aDeadServiceIsShown,
    aServiceWithNewTokensIsShown, aBusyServiceIsTriedAgain,
    aProxyWithoutWebSocketsIsEnough, aSilentBoardIsShown, oneStopIsForAllRobots,
  ]) {
    if (only && !only.split(",").includes(check.name)) continue;
    await check();
    console.log(`page faults: ${check.name}`);
  }
  assert.deepEqual(errors, []);
  console.log("page faults: passed");
} finally {
  if (lab.isRunning()) lab.signal("SIGCONT");
  await browser.close();
  proxy.close();
  await lab.remove();
}
