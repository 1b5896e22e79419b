// The camera of a robot on the page of `growbot serve`, in Debian's Chromium: the current picture, a camera that fails,
// and the time lapse of a body. Each state is checked with axe, and on the width of a phone.
//
//   node cameras.js GROWBOT
//
// The browser is `chromium`, or the value of CHROMIUM.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { checkAccessibility, checkWidth, openPage, partsOf } from "./operator.js";

const growbot = resolve(process.argv[2]);
const axe = await readFile(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const picture = await readFile(join(dirname(fileURLToPath(import.meta.url)), "picture.png"));
const TIMEOUT_MS = 120_000;
const GOAL = "0,0,200,0,90";
/** Time that the camera takes for a picture. It bounds the number of pictures of a body. */
const PICTURE_MS = 150;

let fails = false;
const camera = createServer((_, response) => setTimeout(() => {
  if (fails) response.writeHead(500).end("<b>words of the camera</b>");
  else response.writeHead(200, { "content-type": "image/png" }).end(picture);
}, PICTURE_MS));
await new Promise((done) => { camera.listen(0, "127.0.0.1", done); });
const settings = `[serve.cameras]\nlab = "http://127.0.0.1:${camera.address().port}/picture"\n`;
const lab = await startLab(growbot, ["lab", "dark"], 10, "growbot-a2", {}, settings);
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
const errors = [];

const open = (url) => openPage(browser, url, { timeoutMs: TIMEOUT_MS, errors });

const cameraOf = (page) => page.getByRole("region", { name: "Camera", exact: true });
const isDrawn = (image) => image.evaluate(async (element) => {
  // The next picture may take its place while it is decoded.
  while (!await element.decode().then(() => element.naturalWidth > 0, () => false)) {
    await new Promise((done) => { setTimeout(done, 50); });
  }
  return true;
});

try {
  const page = await open(`${lab.controlUrl}#lab`);
  const card = cameraOf(page);
  const current = card.getByRole("img", { name: /^Camera of lab/ });
  const problem = card.getByRole("status", { name: "Problem of the camera" });
  await current.waitFor();
  assert.ok(await isDrawn(current));
  await checkAccessibility(page, axe, "camera");
  await page.setViewportSize({ width: 390, height: 844 });
  await checkWidth(page, "the camera on a phone");
  await page.setViewportSize({ width: 1280, height: 900 });
  console.log("cameras: a current picture");

  fails = true;
  await problem.filter({ hasText: /^No picture: the camera responds with the HTTP status 500: check its address/ })
    .waitFor();
  await card.getByText(/^This picture is \d+ s old\.$/).waitFor();
  assert.equal(await page.getByText("words of the camera").count(), 0);
  await card.getByRole("img", { name: "Camera of lab, an old picture" }).waitFor();
  await checkAccessibility(page, axe, "old picture");
  fails = false;
  await card.getByText(/^This picture is/).waitFor({ state: "detached" });
  assert.equal(await problem.innerText(), "");
  console.log("cameras: a failure and its end");

  const grow = async (name) => {
    assert.equal((await lab.ask("POST", "/robots/lab/jobs", { to: GOAL, name })).status, 201);
    await lab.waitForRobot("lab", ({ job }) => job === null, "the body is not grown");
    return (await lab.ask("GET", "/jobs")).json[0];
  };
  const { id, layers } = await grow("filmed");
  const timeLapse = page.getByRole("region", { name: "Time lapse" });
  const slider = timeLapse.getByRole("slider", { name: "Picture" });
  await slider.waitFor();
  // The last picture may still be on its way.
  let pictures = [];
  const deadline = Date.now() + TIMEOUT_MS;
  do {
    pictures = (await lab.ask("GET", `/jobs/${id}/snapshots`)).json;
    await page.waitForTimeout(200);
  } while ((pictures.at(-1) !== layers - 1 || Number(await slider.getAttribute("max")) !== pictures.length - 1)
    && Date.now() < deadline);
  assert.ok(pictures.length > 1, `${pictures.length} pictures of ${layers} layers`);
  const textOf = (index) => `Layer ${pictures[index] + 1} of ${layers}`;
  await timeLapse.getByText(textOf(pictures.length - 1)).waitFor();
  await slider.focus();
  await page.keyboard.press("Home");
  await timeLapse.getByText(textOf(0)).waitFor();
  assert.ok(await isDrawn(timeLapse.getByRole("img")));
  await page.keyboard.press("ArrowRight");
  await timeLapse.getByText(textOf(1)).waitFor();
  await page.keyboard.press("Home");
  await timeLapse.getByRole("button", { name: "Play" }).press("Enter");
  await timeLapse.getByText(textOf(pictures.length - 1)).waitFor();
  await timeLapse.getByRole("button", { name: "Play" }).waitFor();
  await checkAccessibility(page, axe, "time lapse");
  await grow("later");
  const headingOf = (name) => timeLapse.getByRole("heading", { name: `Time lapse of ${name}` });
  await headingOf("later").waitFor();
  await partsOf(page, "lab").job("filmed").getByRole("button", { name: "Pictures" }).press("Enter");
  await headingOf("filmed").waitFor();
  await headingOf("filmed").and(page.locator(":focus")).waitFor();
  await timeLapse.getByText(textOf(pictures.length - 1)).waitFor();
  await timeLapse.getByRole("button", { name: "Latest body" }).press("Enter");
  await headingOf("later").waitFor();
  console.log("cameras: a time lapse");

  const other = await open(`${lab.controlUrl}#dark`);
  await partsOf(other, "dark").waitForState("idle");
  assert.equal(await cameraOf(other).count(), 0);
  const readOnly = await open(`${lab.viewUrl}#lab`);
  await cameraOf(readOnly).getByRole("img", { name: "Camera of lab" }).waitFor();
  assert.deepEqual(errors, []);
  console.log("cameras: passed");
} finally {
  await browser.close();
  camera.close();
  await lab.remove();
}
