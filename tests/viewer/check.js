// Opens the pages of `growbot view` in Debian's Chromium, without a window as in CI. The bodies have 1,300 and 10,000
// layers. Other pages show growths, and two bodies side by side. The checks cover the first picture, the size, the
// slider, the buttons and the keys. The console must be empty, and no page may send a request. The picture is compared
// with the committed one. Every page also works by touch, and the last is opened as on a phone.
//
//   node check.js GROWBOT            checks
//   node check.js GROWBOT --bless    writes the picture again
//
// The browser is `chromium`, or the value of CHROMIUM.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { chromium } from "playwright-core";
import { PNG } from "pngjs";
import { reachOutline } from "../../growbot-pictures/viewer/src/reach.js";
import { environment } from "./environment.js";

const here = dirname(fileURLToPath(import.meta.url));
const [program, bless] = process.argv.slice(2);
const growbot = resolve(program);
const PICTURE = join(here, "picture.png");
const TIMEOUT_MS = 600_000;
const MAX_BYTES = 2_000_000;
/** Colour difference above which a pixel counts as different, and max fraction of such pixels. Edges move with another
 * release of the renderer, and letters with other fonts (1 % if all are in another font). The body is 6 %. */
const [MIN_DIFFERENCE, MAX_FRACTION] = [48, 0.02];

const directory = mkdtempSync(join(tmpdir(), "growbot-view-"));
const run = (...args) =>
  execFileSync(growbot, args, { cwd: directory, env: environment, stdio: ["ignore", "pipe", "pipe"] });
const plan = (name, ...args) => {
  run("plan", ...args, "-o", `${name}.json`);
  run("view", `${name}.json`);
};

const errors = [];
async function open(browser, name, options) {
  const page = await browser.newPage({ viewport: { width: 800, height: 500 }, colorScheme: "light", ...options });
  const file = join(directory, `${name}.html`);
  page.on("console", (message) => errors.push(`${name}: console ${message.type()}: ${message.text()}`));
  page.on("pageerror", (error) => errors.push(`${name}: ${error.stack}`));
  page.on("request", (request) => {
    const url = request.url();
    if (url !== pathToFileURL(file).href && !url.startsWith("data:")) errors.push(`${name}: requested ${url}`);
  });
  page.setDefaultTimeout(TIMEOUT_MS);
  await page.goto(pathToFileURL(file).href);
  await page.waitForFunction(() => !document.querySelector(".stage:not([data-drawn])"));
  const drawn = await page.$$eval(".stage", (stages) =>
    Math.max(...stages.map((stage) => Number(stage.dataset.drawn))));
  console.log(`${name}: ${statSync(file).size} bytes, first picture after ${drawn} ms`);
  return page;
}

/** Checks that the page is as wide as the phone, and its pictures too. */
async function fitsPhone(page) {
  assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "wider than a phone");
  const widths = await page.$$eval(".stage", (stages) => stages.map((stage) => stage.clientWidth / innerWidth));
  assert.ok(widths.every((share) => share > 0.95), `pictures take ${widths} of a phone's width`);
}

/** Waits until the next picture is drawn. */
const settled = (page) =>
  page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
const slider = (page) => page.$eval("#slider", (element) => Number(element.value));
const picture = async (page) => {
  await settled(page);
  return PNG.sync.read(await page.locator("#stages").screenshot());
};

/** Returns the fraction of pixels that differ. */
function difference(a, b) {
  assert.deepEqual([a.width, a.height], [b.width, b.height], "the pictures are of different sizes");
  let count = 0;
  for (let i = 0; i < a.data.length; i += 4) {
    const max = Math.max(...[0, 1, 2].map((k) => Math.abs(a.data[i + k] - b.data[i + k])));
    if (max > MIN_DIFFERENCE) count += 1;
  }
  return count / (a.width * a.height);
}

async function checkControls(page, layers) {
  assert.equal(await slider(page), layers);
  const whole = await picture(page);

  await page.fill("#slider", String(Math.round(layers / 2)));
  const half = await picture(page);
  assert.ok(difference(whole, half) > 0.005, "the slider changes nothing in the picture");
  assert.match(await page.textContent("#bar output"), new RegExp(`^layer ${Math.round(layers / 2)} of ${layers}`));

  await page.locator("canvas").focus();
  await page.keyboard.press("ArrowRight");
  assert.equal(await slider(page), Math.round(layers / 2) + 1);
  await page.keyboard.press("Home");
  assert.equal(await slider(page), 0);
  await page.keyboard.press("Space");
  await page.waitForFunction(() => Number(document.querySelector("#slider").value) > 0);
  assert.equal(await page.textContent("#play"), "Pause");
  await page.click("#play");
  const paused = await slider(page);
  await page.waitForTimeout(200);
  assert.equal(await slider(page), paused);
  await page.keyboard.press("End");
  assert.ok(difference(whole, await picture(page)) < 0.001, "the slider at its end shows another picture");

  for (const side of ["front", "side", "top"]) {
    await page.click(`[data-viewpoint=${side}]`);
    assert.ok(difference(whole, await picture(page)) > 0.005, `${side} shows the same picture`);
  }
  await page.click("[data-viewpoint=corner]");
  assert.ok(difference(whole, await picture(page)) < 0.001, "the view from the corner differs");

  await page.click("#theme");
  assert.equal(await page.getAttribute("html", "data-theme"), "dark");
  assert.ok(difference(whole, await picture(page)) > 0.5, "the dark page is light");
  await page.click("#theme");

  const { x, y, width, height } = await page.locator("canvas").boundingBox();
  await page.mouse.move(x + width / 2, y + height / 2);
  await page.mouse.down();
  await page.mouse.move(x + width / 2 + 120, y + height / 2 - 40, { steps: 4 });
  await page.mouse.up();
  assert.ok(difference(whole, await picture(page)) > 0.005, "dragging does not turn the view");
}

/** Two bodies side by side. One slider grows both, and turning one turns the other. */
async function checkPair(browser) {
  run("view", "--compare", "1300.json", "run.jsonl", "-o", "pair.html");
  const page = await open(browser, "pair", { viewport: { width: 1100, height: 600 } });
  assert.match(await page.textContent("#difference"), /^1300\.json is [\d.]+ mm \([\d.]+ %\) longer than run\.jsonl$/);
  const both = async () => {
    await settled(page);
    return Promise.all([0, 1].map(async (i) => PNG.sync.read(await page.locator(".stage").nth(i).screenshot())));
  };
  const layers = () =>
    page.$$eval("#both tr:nth-child(4) td", (cells) => cells.map((cell) => Number(cell.textContent)));
  const scale = () =>
    page.$$eval(".scale", (bars) => bars.map((bar) => `${bar.textContent} ${bar.querySelector("i").style.width}`));
  const bothDiffer = async (before, why) =>
    (await both()).forEach((after, i) => assert.ok(difference(before[i], after) > 0.005, `${why}: ${i}`));
  const whole = await both();
  const [all, fewer] = await layers();
  assert.ok(all > 1300 && fewer > 100, `${all} and ${fewer} layers`);

  await page.fill("#slider", "100");
  assert.ok((await layers()).every((count) => count > 100 && count < 150), "100 mm are not some 130 layers of both");
  await bothDiffer(whole, "the slider does not grow both");
  await page.locator("canvas").first().focus();
  await page.keyboard.press("End");
  assert.deepEqual(await layers(), [all, fewer]);

  const { x, y, width, height } = await page.locator("canvas").nth(1).boundingBox();
  await page.mouse.move(x + width / 2, y + height / 2);
  await page.mouse.down();
  await page.mouse.move(x + width / 2 + 120, y + height / 2 - 40, { steps: 4 });
  await page.mouse.up();
  await bothDiffer(whole, "turning one does not turn the other");
  const [before] = await scale();
  await page.mouse.wheel(0, -300);
  await settled(page);
  const [one, other] = await scale();
  assert.notEqual(one, before, "the wheel does not zoom");
  assert.equal(one, other, "the two are of different scales");
  await page.click("[data-viewpoint=corner]");
  (await both()).forEach((again, i) => {
    assert.ok(difference(whole[i], again) < 0.001, `the view from the corner differs: ${i}`);
  });
  await page.click("#theme");
  await bothDiffer(whole, "the dark page is light");

  const phone = await open(browser, "pair", { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  await fitsPhone(phone);
}

/**
 * A body among obstacles. They can be seen and hidden, and the point of least clearance is also listed next to the
 * picture.
 */
async function checkScene(browser) {
  run("scene", "pipe-rack", "-o", "rack.toml");
  plan("rack", "--to", "0,0,960", "--scene", "rack.toml");
  const page = await open(browser, "rack");
  assert.ok(statSync(join(directory, "rack.html")).size < MAX_BYTES, "the page of a scene is too large");
  assert.match(await page.textContent("#numbers"), /Scene.*rack\.toml.*all shown.*Clearance5\.\d\d mm.*Narrowest/s);
  assert.match(await page.textContent(".labels"), /narrowest: 5\.\d\d mm/);
  const seen = await picture(page);
  await page.uncheck("#show-scene");
  assert.ok(difference(seen, await picture(page)) > 0.01, "the obstacles cannot be hidden");
  await page.check("#show-scene");
  assert.ok(difference(seen, await picture(page)) < 0.001, "the obstacles do not come back");
  const dark = await open(browser, "rack", {
    colorScheme: "dark", viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true,
  });
  await fitsPhone(dark);
}

/** The positions within reach of a plan's length. The planner needs that length to their surface. */
async function checkReach(browser) {
  const [radius, length] = [100, 400];
  const outline = reachOutline(radius, length);
  for (const [away, along] of [outline[0], outline[20], outline[60], outline[90]]) {
    run("plan", "--to", `${away.toFixed(6)},0,${along.toFixed(6)}`, "--robot", "growbot-a", "-o", "reach.json");
    const planned = JSON.parse(readFileSync(join(directory, "reach.json"))).length_mm;
    assert.ok(Math.abs(planned - length) < 0.01, `${planned} mm to ${away}, ${along}`);
  }
  plan("reach", "--to", "100,50,300", "--robot", "growbot-a");
  const page = await open(browser, "reach");
  const seen = await picture(page);
  await page.check("#show-reach");
  assert.ok(difference(seen, await picture(page)) > 0.05, "the reach cannot be seen");
  await page.uncheck("#show-reach");
  assert.ok(difference(seen, await picture(page)) < 0.001, "the reach does not go");
}

/** Starts the browser without a window. The root user has no sandbox. */
const launch = (...args) =>
  chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: [...args, ...(process.getuid() === 0 ? ["--no-sandbox"] : [])],
  });

/** Without 3D, the page reports this and still shows its numbers. */
async function checkWithoutPicture() {
  const browser = await launch("--disable-3d-apis");
  try {
    const page = await browser.newPage();
    await page.goto(pathToFileURL(join(directory, "1300.html")).href);
    assert.ok(await page.isVisible(".no-picture"), "no message that there is no picture");
    await page.keyboard.press("Home");
    assert.match(await page.textContent("#bar output"), /^layer 0 of /);
    assert.match(await page.textContent("#numbers"), /1006\.4 mm/);
  } finally {
    await browser.close();
  }
}

// The processor draws instead of a graphics card, so the picture is the same everywhere.
const browser = await launch("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader");
try {
  plan("1300", "--to", "550,345,610,120,-25", "--planner", "two-plane");
  plan("10000", "--via", "1800,0,1200,90,0", "--via", "900,1800,700,180,20", "--via", "-400,1200,1600,-90,0",
    "--to", "0,0,500,0,-90");
  run("plan", "--to", "120,60,200,30,20", "-o", "short.json");
  run("grow", "short.json", "--noise", "10", "--seed", "1", "--log", "run.jsonl");
  run("view", "run.jsonl");
  run("grow", "short.json", "--bias", "10", "--feedback", "--seed", "1", "--log", "fed.jsonl");
  run("view", "fed.jsonl");

  const middle = await open(browser, "1300");
  // The picture has the same size with any fonts.
  await middle.addStyleTag({
    content: "header { height: 48px; overflow: hidden } #bar { height: 52px; overflow: hidden }",
  });
  await settled(middle);
  await middle.click("[data-viewpoint=corner]");
  assert.ok(statSync(join(directory, "1300.html")).size < MAX_BYTES, "the file is too large");
  const seen = await picture(middle);
  if (bless === "--bless") writeFileSync(PICTURE, PNG.sync.write(seen, { deflateLevel: 9 }));
  const different = difference(seen, PNG.sync.read(readFileSync(PICTURE)));
  console.log(`1300: ${(100 * different).toFixed(3)} % of the picture differ from tests/viewer/picture.png`);
  const advice = `more than ${100 * MAX_FRACTION} %: if that is intended, write it again with --bless`;
  assert.ok(different <= MAX_FRACTION, advice);
  await checkControls(middle, Number(await middle.getAttribute("#slider", "max")));

  const large = await open(browser, "10000");
  const layers = Number(await large.getAttribute("#slider", "max"));
  assert.ok(layers >= 10_000, `${layers} layers`);
  await checkControls(large, layers);

  const grown = await open(browser, "run");
  const both = await picture(grown);
  assert.equal(await grown.textContent("#built-name"), "Laid (simulated)");
  assert.ok(await grown.isVisible("#commanded"), "no toggle for the commanded body next to the laid one");
  await grown.uncheck("#show-built");
  assert.ok(difference(both, await picture(grown)) > 0.005, "the body as built cannot be hidden");
  await grown.uncheck("#show-planned");
  assert.ok(await grown.isVisible("#chart svg"), "no chart");

  assert.ok(!(await grown.isVisible("#estimated")), "an estimate without feedback");

  const fed = await open(browser, "fed");
  await fed.uncheck("#show-built");
  await fed.uncheck("#show-planned");
  const estimated = await picture(fed);
  await fed.uncheck("#show-estimated");
  assert.ok(difference(estimated, await picture(fed)) > 0.0003, "no line of the path that feedback estimated");

  const phone = await open(browser, "run", {
    viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, colorScheme: "dark",
  });
  assert.equal(await phone.getAttribute("html", "data-theme"), "dark");
  await phone.tap("#play");
  assert.equal(await phone.textContent("#play"), "Pause");
  await fitsPhone(phone);
  await phone.close();

  assert.ok(!(await middle.isVisible("#scene")), "obstacles without a scene");
  await checkScene(browser);
  await checkReach(browser);
  await checkPair(browser);
  await checkWithoutPicture();
  assert.deepEqual(errors, []);
  console.log("viewer: passed");
} finally {
  await browser.close();
  rmSync(directory, { recursive: true });
}
