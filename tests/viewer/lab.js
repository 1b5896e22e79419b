// A service of `growbot serve` with simulated robots, for tests in a browser.

import { spawn, spawnSync } from "node:child_process";
import { once } from "node:events";
import { existsSync, readdirSync, readlinkSync, realpathSync } from "node:fs";
import { mkdir, mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { request as send } from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { environment } from "./environment.js";

/**
 * Starts a service with simulated robots of these names, `pace` times as fast as real time. Its directory is removed by
 * `remove()`.
 */
export async function startLab(growbot, robots, pace) {
  const directory = await mkdtemp(join(tmpdir(), "growbot-robots-"));
  const directories = { XDG_STATE_HOME: join(directory, "state"), XDG_RUNTIME_DIR: join(directory, "run") };
  for (const path of Object.values(directories)) await mkdir(path, { mode: 0o700 });
  const spawnOptions = { env: { ...environment, ...directories }, cwd: directory };
  const rest = `robot = "growbot-a2"\npace = ${pace.toFixed(1)}\n`;
  const entries = robots.map((name) => `[robots.${name}]\nport = "sim:${name}"\n${rest}`);
  await writeFile(join(directory, "growbot.toml"), entries.join(""));
  const lab = {
    directory,
    controlUrl: null,
    viewUrl: null,
    service: null,

    /** Starts the service, on the same port as before. */
    async start() {
      const port = lab.controlUrl ? new URL(lab.controlUrl).port : "0";
      const args = ["serve", "--page-port", port];
      lab.service = spawn(growbot, args, { ...spawnOptions, stdio: ["ignore", "pipe", "ignore"] });
      const urls = {};
      for await (const line of createInterface({ input: lab.service.stdout })) {
        const [kind, url] = line.split(/ +/);
        urls[kind] = url;
        if (urls.control && urls.view) {
          [lab.controlUrl, lab.viewUrl] = [urls.control, urls.view];
          return;
        }
      }
      throw new Error("the service ended before it printed its URLs");
    },

    async kill() {
      lab.service.kill("SIGKILL");
      await once(lab.service, "exit");
    },

    /** Returns the process of a simulated robot, which has its lock open. */
    robotProcess(name) {
      const lock = realpathSync(join(directory, "state/growbot/robots", name, "lock"));
      const hasLock = (pid) => {
        try {
          return readdirSync(`/proc/${pid}/fd`).some((file) => {
            const path = `/proc/${pid}/fd/${file}`;
            return existsSync(path) && readlinkSync(path) === lock;
          });
        } catch {
          // The process has ended.
          return false;
        }
      };
      return Number(readdirSync("/proc").filter((name) => /^\d+$/.test(name)).find(hasLock));
    },

    /** Sends a request on the user's socket. Returns its status and JSON. */
    async ask(method, path, body) {
      const options = {
        socketPath: join(directory, "run/growbot/serve.sock"), method, path: `/api/v1${path}`,
        headers: { host: "localhost", "content-type": "application/json" },
      };
      const outgoing = send(options);
      outgoing.end(body && JSON.stringify(body));
      const [response] = await once(outgoing, "response");
      let text = "";
      for await (const part of response) text += part;
      return { status: response.statusCode, json: JSON.parse(text) };
    },

    robot: async (name) => (await lab.ask("GET", `/robots/${name}`)).json,
    command: (name, command) => lab.ask("POST", `/robots/${name}/commands`, { command }),

    /** Returns the number of recorded commands with this name, done or refused. */
    async countCommands(name) {
      const text = await readFile(join(directory, "state/growbot/serve/audit.jsonl"), "utf8");
      return text.split("\n").filter((line) => line.includes(`"command":"${name}"`)).length;
    },

    /** Waits until `check` returns true for a robot, which it then returns. */
    async waitForRobot(name, check, what) {
      const deadline = Date.now() + 120_000;
      for (;;) {
        const robot = await lab.robot(name);
        if (check(robot)) return robot;
        if (Date.now() > deadline) throw new Error(`${what}: ${JSON.stringify(robot)}`);
        await new Promise((resolve) => { setTimeout(resolve, 50); });
      }
    },

    async remove() {
      if (lab.service.exitCode === null && lab.service.signalCode === null) await lab.kill();
      for (const name of robots) spawnSync(growbot, ["power", "off", "--port", `sim:${name}`], spawnOptions);
      await rm(directory, { recursive: true });
    },
  };
  await lab.start();
  return lab;
}
