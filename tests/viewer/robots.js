// Uses the page of all robots of `growbot serve` in Debian's Chromium, with a simulated robot. It plans, previews,
// grows, pauses, loses the service and finds it again, and stops. It uses the keyboard where a person might, and also a
// phone.
//
//   node robots.js GROWBOT [PICTURES]
//
// PICTURES is a directory for pictures of the page. The test does not need a fast browser. The browser is `chromium`,
// or the value of CHROMIUM.

import assert from "node:assert/strict";
import { spawn, spawnSync } from "node:child_process";
import { once } from "node:events";
import { mkdir, mkdtemp, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";
import { environment } from "./environment.js";

const growbot = resolve(process.argv[2]);
const pictures = process.argv[3];
const PATIENCE_MS = 600_000;
const errors = [];

const directory = await mkdtemp(join(tmpdir(), "growbot-robots-"));
const places = { XDG_STATE_HOME: join(directory, "state"), XDG_RUNTIME_DIR: join(directory, "run") };
for (const place of Object.values(places)) await mkdir(place, { mode: 0o700 });
const known = { env: { ...environment, ...places }, cwd: directory };
await writeFile(join(directory, "growbot.toml"), '[robots.lab]\nport = "sim:lab"\nrobot = "growbot-a2"\npace = 3.0\n');
const ball = 'format = "growbot-scene/1"\n[[ball]]\ncenter_mm = [0, 0, 200]\nradius_mm = 40\n';
await writeFile(join(directory, "ball.toml"), ball);
await writeFile(join(directory, "wrong.toml"), "a ball");

/** Starts the service on a port. Returns its process and its addresses. */
async function serve(port) {
  const service = spawn(growbot, ["serve", "--page-port", String(port)], { ...known, stdio: ["ignore", "pipe", "ignore"] });
  const addresses = {};
  for await (const line of createInterface({ input: service.stdout })) {
    const [kind, address] = line.split(/ +/);
    addresses[kind] = address;
    if (addresses.operate && addresses.look) return { service, addresses };
  }
  throw new Error("the service ended before it told its addresses");
}

async function kill(service) {
  service.kill("SIGKILL");
  await once(service, "exit");
}

let { service, addresses } = await serve(0);
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"] });

async function open(address, options) {
  const page = await browser.newPage({ viewport: { width: 1200, height: 900 }, colorScheme: "light", ...options });
  page.setDefaultTimeout(PATIENCE_MS);
  page.on("pageerror", (error) => errors.push(error.stack));
  page.on("request", (request) => {
    const asks = request.url();
    if (!asks.startsWith(address) && !/^(data|about|blob):/.test(asks)) errors.push(`asked for ${asks}`);
  });
  await page.goto(address);
  return page;
}

const picture = (page, name) => pictures && page.screenshot({ path: join(pictures, `${name}.png`), fullPage: true });

try {
  const page = await open(addresses.operate);
  const robot = page.locator("section.robot");
  const state = (word) => robot.locator(".state", { hasText: new RegExp(`^${word}$`) }).waitFor();
  const press = async (name) => {
    await robot.getByRole("button", { name, exact: true }).focus();
    await page.keyboard.press("Enter");
  };
  const laid = async () => Number(/(\d+) of/.exec(await robot.locator(".facts").innerText())?.[1] ?? 0);
  const grows = async () => {
    const before = await laid();
    const until = Date.now() + PATIENCE_MS;
    while ((await laid()) <= before + 2) {
      assert.ok(Date.now() < until, "it does not grow");
      await page.waitForTimeout(100);
    }
  };

  await state("idle");
  assert.match(await robot.innerText(), /lab[^]*simulated, 3 times as fast/);
  assert.ok(await robot.getByRole("button", { name: "Pause" }).isDisabled());

  // A goal is typed and previewed, without and with a scene.
  await robot.locator("details.new summary").focus();
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
  await robot.locator(".answer.refused", { hasText: "wrong.toml" }).waitFor();
  await robot.locator("[name=scene]").setInputFiles(join(directory, "ball.toml"));
  await press("Preview");
  await preview.getByText(/^4[0-9]{2}\.[0-9] mm/).filter({ hasNotText: "400.0 mm" }).waitFor();
  await picture(page, "preview-scene");
  await page.keyboard.press("Escape");

  // The robot grows, pauses and continues.
  await press("Grow");
  await state("growing");
  await grows();
  assert.match(await robot.locator(".facts").innerText(), /of 200\.0 C/);
  await press("Pause");
  await state("paused");
  await picture(page, "paused");
  await press("Continue");
  await state("growing");

  // The service is killed. The robot continues, and the page connects to the next service.
  const before = await laid();
  const port = new URL(addresses.operate).port;
  await kill(service);
  await page.getByText("Connection lost").waitFor();
  ({ service, addresses } = await serve(port));
  await page.locator("#connection", { hasText: /^connected$/ }).waitFor();
  await state("growing");
  await grows();
  assert.ok((await laid()) > before);

  // The read-only address allows no orders. On a phone nothing is wider than the screen.
  const look = await open(addresses.look, { viewport: { width: 375, height: 740 }, colorScheme: "dark" });
  await look.locator("section.robot .state", { hasText: "growing" }).waitFor();
  await picture(look, "phone");
  for (const button of await look.locator("section.robot .orders [data-order]").all()) assert.ok(await button.isDisabled());
  assert.ok(await look.evaluate(() => document.documentElement.scrollWidth <= window.innerWidth), "wider than a phone");
  assert.ok(await look.getByRole("button", { name: "Emergency stop" }).isVisible());
  await look.close();
  const phone = await open(addresses.operate, { viewport: { width: 375, height: 740 } });
  await phone.getByRole("button", { name: "Show body" }).click();
  await phone.getByRole("button", { name: "Emergency stop" }).last().click({ trial: true });
  await picture(phone, "phone-body");
  await phone.close();

  // The growth is stopped and can be viewed.
  await press("Stop");
  await state("stopped");
  const job = page.locator("#job-rows tr").first();
  await job.getByText(/stopped|interrupted/).waitFor();
  await job.getByRole("link", { name: "3D" }).click();
  await page.frameLocator("#body-frame").locator("canvas").first().waitFor();
  await page.keyboard.press("Escape");
  const log = await page.request.get(await job.getByRole("link", { name: "Run log" }).evaluate((link) => link.href));
  assert.match(await log.text(), /^\{"event":"header"/);

  // The emergency stop of a growth that is resumed.
  await job.getByRole("button", { name: "Resume" }).click();
  await state("heating|homing|growing");
  await press("Emergency stop");
  await state("emergency-stop");
  await robot.locator(".answer", { hasText: "emergency stop: done" }).waitFor();
  await page.emulateMedia({ colorScheme: "dark" });
  await picture(page, "stopped-dark");
  assert.deepEqual(errors, []);
  console.log("the page of all robots: planned, grown, paused, lost and found, stopped");
} finally {
  await browser.close();
  await kill(service);
  spawnSync(growbot, ["power", "off", "--port", "sim:lab"], known);
  await rm(directory, { recursive: true });
}
