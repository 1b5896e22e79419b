// Uses the page of all robots of `growbot serve` in Debian's Chromium, with a simulated robot. It plans, previews,
// grows, pauses, loses the connection to the service and reconnects, and stops. It uses the keyboard where possible.
// The page is also opened on the screen of a phone.
//
//   node robots.js GROWBOT [PICTURES]
//
// PICTURES is a directory for pictures of the page. The test does not need a fast browser. The browser is `chromium`,
// or the value of CHROMIUM.

import assert from "node:assert/strict";
import { writeFile } from "node:fs/promises";
import { join, resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { watchRequests } from "./service.js";

const growbot = resolve(process.argv[2]);
const pictures = process.argv[3];
const TIMEOUT_MS = 600_000;
const errors = [];

const lab = await startLab(growbot, ["lab"], 3);
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
  await page.goto(pageUrl);
  return page;
}

const picture = (page, name) => pictures && page.screenshot({ path: join(pictures, `${name}.png`), fullPage: true });

try {
  const page = await open(controlUrl);
  const robot = page.locator("section.robot");
  const waitForState = (name) => robot.locator(".state", { hasText: new RegExp(`^${name}$`) }).waitFor();
  const press = async (name) => {
    await robot.getByRole("button", { name, exact: true }).focus();
    await page.keyboard.press("Enter");
  };
  const laidLayers = async () => Number(/(\d+) of/.exec(await robot.locator(".properties").innerText())?.[1] ?? 0);
  const checkGrows = async () => {
    const before = await laidLayers();
    const deadline = Date.now() + TIMEOUT_MS;
    while ((await laidLayers()) <= before + 2) {
      assert.ok(Date.now() < deadline, "the body does not grow");
      await page.waitForTimeout(100);
    }
  };

  await waitForState("idle");
  assert.match(await robot.innerText(), /lab[^]*simulated, 3 times as fast/);
  assert.ok(await robot.getByRole("button", { name: "Pause" }).isDisabled());

  // A goal is typed and previewed, without and with a scene.
  await robot.locator("details.new-job summary").focus();
  await page.keyboard.press("Enter");
  await robot.locator("[name=to]").focus();
  await page.keyboard.type("0,0,400,0,90");
  await press("Preview");
  const preview = robot.locator(".preview");
  await preview.getByText(/400\.0 mm, 517 layers/).waitFor();
  await page.frameLocator("#body-frame").locator("canvas").first().waitFor();
  await picture(page, "preview");
  await page.keyboard.press("Escape");
  assert.ok(await page.locator("#body").isHidden());
  await robot.locator("[name=scene]").setInputFiles(join(directory, "wrong.toml"));
  await press("Preview");
  await robot.locator(".message.error", { hasText: "wrong.toml" }).waitFor();
  await robot.locator("[name=scene]").setInputFiles(join(directory, "ball.toml"));
  await press("Preview");
  await preview.getByText(/^4[0-9]{2}\.[0-9] mm/).filter({ hasNotText: "400.0 mm" }).waitFor();
  await picture(page, "preview-scene");
  await page.keyboard.press("Escape");

  // The robot grows, pauses and continues.
  await press("Grow");
  await waitForState("growing");
  await checkGrows();
  assert.match(await robot.locator(".properties").innerText(), /of 200\.0 C/);
  await press("Pause");
  await waitForState("paused");
  await picture(page, "paused");
  await press("Continue");
  await waitForState("growing");

  // The service is killed. The robot continues, and the page connects to the next service.
  const before = await laidLayers();
  await lab.kill();
  await page.getByText("Connection lost").or(page.getByText("No data for")).waitFor();
  await lab.start();
  await page.locator("#connection", { hasText: /^Live$/ }).waitFor();
  await waitForState("growing");
  await checkGrows();
  assert.ok((await laidLayers()) > before);

  // The read-only URL allows no commands. On a phone nothing is wider than the screen.
  const readOnly = await open(viewUrl, { viewport: { width: 375, height: 740 }, colorScheme: "dark" });
  await readOnly.locator("section.robot .state", { hasText: "growing" }).waitFor();
  await picture(readOnly, "phone");
  const buttons = await readOnly.locator("section.robot .commands [data-command]").all();
  for (const button of buttons) assert.ok(await button.isDisabled());
  const fits = await readOnly.evaluate(() => document.documentElement.scrollWidth <= window.innerWidth);
  assert.ok(fits, "wider than a phone");
  assert.ok(await readOnly.getByRole("button", { name: "Emergency stop" }).isVisible());
  await readOnly.close();
  const phone = await open(controlUrl, { viewport: { width: 375, height: 740 } });
  await phone.getByRole("button", { name: "Show body" }).click();
  await phone.getByRole("button", { name: "Emergency stop" }).click({ trial: true });
  await picture(phone, "phone-body");
  await phone.close();

  // The growth is stopped and can be viewed.
  await press("Stop");
  await waitForState("stopped");
  const job = page.locator("#job-rows tr").first();
  await job.getByText(/stopped|interrupted/).waitFor();
  await job.getByRole("link", { name: "3D" }).click();
  await page.frameLocator("#body-frame").locator("canvas").first().waitFor();
  await page.keyboard.press("Escape");
  const log = await page.request.get(await job.getByRole("link", { name: "Run log" }).evaluate((link) => link.href));
  assert.match(await log.text(), /^\{"event":"header"/);

  // The emergency stop of a growth that is resumed.
  await job.getByRole("button", { name: "Resume" }).click();
  await waitForState("heating|homing|growing");
  await page.getByRole("button", { name: "Emergency stop lab" }).focus();
  await page.keyboard.press("Enter");
  await waitForState("emergency-stop");
  await robot.locator(".message", { hasText: "emergency stop: done" }).waitFor();
  await page.emulateMedia({ colorScheme: "dark" });
  await picture(page, "stopped-dark");
  assert.deepEqual(errors, []);
  console.log("the page of all robots: planned, grew, paused, reconnected and stopped");
} finally {
  await browser.close();
  await lab.remove();
}
