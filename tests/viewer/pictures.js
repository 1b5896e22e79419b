// Makes pictures of the page of `growbot serve` in each of its states and sizes, to look at.
//
//   node pictures.js GROWBOT DIRECTORY [STATE...]
//
// The robots are simulated. For a fault and a lost robot, the status and the guided sequence of a growing robot are
// changed on their way to the page.

import { join, resolve } from "node:path";
import { chromium } from "playwright-core";
import { startLab } from "./lab.js";
import { partsOf } from "./operator.js";

const [growbot, directory, ...wanted] = [resolve(process.argv[2]), resolve(process.argv[3]), ...process.argv.slice(4)];
const NAME = "lab-1";
const SIZES = {
  desktop: { viewport: { width: 1280, height: 800 } },
  phone: { viewport: { width: 390, height: 844 } },
  large: { viewport: { width: 2560, height: 1440 } },
  zoom: { viewport: { width: 640, height: 400 }, deviceScaleFactor: 2 },
  dark: { viewport: { width: 1280, height: 800 }, colorScheme: "dark" },
  contrast: { viewport: { width: 1280, height: 800 }, contrast: "more" },
};
const fault = {
  state: "fault", fault: "filament-jam", target_c: null, job: null, connection: "ready",
  fault_explanation: "the extruder turned, but the filament did not move: clear the nozzle",
};
const lost = { connection: "disconnected", connection_error: "the port does not respond: check cable and power" };
const faultRecovery = {
  situation: "fault", interrupts: true, cause: `filament-jam: ${fault.fault_explanation}`, alternative: null,
  safety: "Heater and motors are off, until the cause is cleared.",
  steps: [{ text: "Remove the cause: clear the nozzle.", action: null, effect: "safe" },
    { text: "Clear it.", action: "clear-fault", effect: "safe" }],
};
const lostRecovery = {
  situation: "disconnected", interrupts: true, cause: lost.connection_error, alternative: null,
  safety: "The board acts alone: it pauses at the latest when its layers end, and parks later.",
  steps: [{ text: "Check the robot's power and its cable.", action: null, effect: "safe" }],
};
/** States: the robot whose page is shown, and changes of its status. */
const STATES = {
  empty: { name: "lab-2" }, growing: { name: NAME }, paused: { name: NAME },
  fault: { name: NAME, changes: fault, recovery: faultRecovery },
  disconnected: { name: NAME, changes: lost, recovery: lostRecovery }, three: { name: null },
};

const lab = await startLab(growbot, [NAME, "lab-2", "practice"], 30, "growbot-a");
const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args });

async function takePicture(state, size) {
  const { name, changes, recovery } = STATES[state];
  const context = await browser.newContext(SIZES[size]);
  const page = await context.newPage();
  if (changes) {
    // Without the shared worker, the page itself gets the events.
    await page.addInitScript(() => { delete window.SharedWorker; });
    await page.routeWebSocket("**/events/ws", (socket) => {
      socket.connectToServer().onMessage((text) => {
        const message = JSON.parse(text);
        if (message.event === "robots") {
          message.data = message.data.map((robot) => (robot.name === name ? { ...robot, ...changes } : robot));
        } else if (message.event === "recovery") message.data = { [name]: recovery };
        socket.send(JSON.stringify(message));
      });
    });
  }
  await page.goto(`${lab.controlUrl}${name ? `#${name}` : ""}`);
  await partsOf(page, name ?? NAME).robot.waitFor();
  if (name === NAME) await partsOf(page, NAME).drawnLayers.waitFor();
  await page.waitForTimeout(1_500);
  await page.screenshot({ path: join(directory, `${state}-${size}.png`) });
  await page.screenshot({ path: join(directory, `${state}-${size}-full.png`), fullPage: true });
  await context.close();
}

try {
  const goal = { to: "300,200,250,-45,-30", name: "pipe-rack-7" };
  await lab.ask("POST", `/robots/${NAME}/jobs`, goal);
  await lab.waitForRobot(NAME, (robot) => robot.laid > 40, "does not grow");
  for (const state of wanted.length ? wanted : Object.keys(STATES)) {
    if (state === "paused") {
      await lab.command(NAME, "pause");
      await lab.waitForRobot(NAME, (robot) => robot.state === "paused", "does not pause");
    }
    for (const size of Object.keys(SIZES)) await takePicture(state, size);
    if (state === "paused") await lab.command(NAME, "continue");
  }
} finally {
  await browser.close();
  await lab.remove();
}
