// Starts `growbot serve` for the tests of its page, with an address that stays held while the service restarts.

import { spawn } from "node:child_process";
import { once } from "node:events";
import { existsSync } from "node:fs";
import { join } from "node:path";
import { createInterface } from "node:readline";

/** A service, and the program that holds its address and starts it. */
export class Service {
  constructor(growbot, spawnOptions) {
    const args = [join(import.meta.dirname, "service_manager.py"), growbot];
    this.manager = spawn("python3", args, { ...spawnOptions, stdio: ["pipe", "pipe", "ignore"] });
    this.lines = createInterface({ input: this.manager.stdout })[Symbol.asyncIterator]();
  }

  /** Starts the service, which must not run, with the held socket or a new one. Returns its URLs by name. */
  async start({ newSocket = false } = {}) {
    this.manager.stdin.write(newSocket ? "new socket\n" : "\n");
    const urls = {};
    while (!(urls.control && urls.view)) {
      const [name, value] = await this.nextLine();
      if (name === "process") this.pid = Number(value);
      else urls[name] = value;
    }
    return urls;
  }

  /** Kills the service, and waits for its end. */
  async kill() {
    this.signal("SIGKILL");
    const [name] = await this.nextLine();
    if (name !== "ended") throw new Error(`the service printed ${name}`);
    this.pid = null;
  }

  isRunning() {
    return Boolean(this.pid) && existsSync(`/proc/${this.pid}`);
  }

  signal(signal) {
    process.kill(this.pid, signal);
  }

  /** Ends service and manager. */
  async end() {
    if (this.isRunning()) await this.kill();
    this.manager.stdin.end();
    await once(this.manager, "exit");
  }

  async nextLine() {
    const { value: line, done } = await this.lines.next();
    if (done) throw new Error("the manager of the service has ended");
    return line.split(/ +/);
  }
}

/**
 * Records requests of a page elsewhere than below the path of its rights, and requests with the token. Only the request
 * that opens the page has the token.
 */
export function watchRequests(page, pageUrl, path, errors) {
  const { origin, pathname } = new URL(pageUrl);
  page.on("request", (request) => {
    const url = request.url();
    if (url === pageUrl && request.isNavigationRequest()) return;
    if (url.includes(pathname)) errors.push(`the token was sent in ${url}`);
    if (!url.startsWith(`${origin}/${path}/`) && !/^(data|about|blob):/.test(url)) errors.push(`requested ${url}`);
  });
}
