// A service of `growbot serve` with simulated robots, for tests in a browser.

import { spawnSync } from "node:child_process";
import { once } from "node:events";
import { existsSync, readdirSync, readlinkSync, realpathSync } from "node:fs";
import { mkdir, mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { request as send } from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { environment } from "./environment.js";
import { Service } from "./service.js";

/**
 * Starts a service with simulated robots of these names and of this kind, `pace` times as fast as real time. A robot
 * with a description of its own, in TOML, has that one. `userSettings` are the user's own settings, in TOML. The
 * directory of the service is removed by `remove()`.
 */
export async function startLab(growbot, robots, pace, robot = "growbot-a2", descriptions = {}, userSettings = "") {
  const directory = await mkdtemp(join(tmpdir(), "growbot-robots-"));
  const directories = { XDG_STATE_HOME: join(directory, "state"), XDG_RUNTIME_DIR: join(directory, "run") };
  for (const path of Object.values(directories)) await mkdir(path, { mode: 0o700 });
  if (userSettings) {
    directories.XDG_CONFIG_HOME = join(directory, "config");
    await mkdir(join(directory, "config/growbot"), { recursive: true, mode: 0o700 });
    await writeFile(join(directory, "config/growbot/growbot.toml"), userSettings, { mode: 0o600 });
  }
  const spawnOptions = { env: { ...environment, ...directories }, cwd: directory };
  const entries = robots.map((name) => `[robots.${name}]\nport = "sim:${name}"\npace = ${pace.toFixed(1)}\n`
    + `robot = "${descriptions[name] ? `${name}.toml` : robot}"\n`);
  await writeFile(join(directory, "growbot.toml"), entries.join(""));
  for (const [name, text] of Object.entries(descriptions)) await writeFile(join(directory, `${name}.toml`), text);
  const service = new Service(growbot, spawnOptions);
  const lab = {
    directory,
    controlUrl: null,
    viewUrl: null,

    /** Starts the service, at the same address as before. Its tokens are new with `newSocket`. */
    async start(options) {
      const { control, view } = await service.start(options);
      [lab.controlUrl, lab.viewUrl] = [control, view];
    },

    /** Kills the service, and waits for its end. */
    kill: () => service.kill(),

    /** Returns whether the service runs, or is frozen. */
    isRunning: () => service.isRunning(),

    /** Sends a signal to the service. */
    signal: (signal) => service.signal(signal),

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

    /** Clears the emergency stop of a robot, once its job has ended. */
    async clearFault(name) {
      await lab.waitForRobot(name, ({ job }) => job === null, "the job does not end");
      return lab.command(name, "clear-fault");
    },

    /** Puts a full spool on a robot, as a person would. */
    changeSpool: (name) => spawnSync(growbot, ["power", "new-spool", "--port", `sim:${name}`], spawnOptions),

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
      await service.end();
      for (const name of robots) spawnSync(growbot, ["power", "off", "--port", `sim:${name}`], spawnOptions);
      await rm(directory, { recursive: true, maxRetries: 5 });
    },
  };
  await lab.start();
  return lab;
}
