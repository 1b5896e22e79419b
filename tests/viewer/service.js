// Starts `growbot serve` for the tests of its page, with an address that stays held while the service restarts.

import { spawn, spawnSync } from "node:child_process";
import { once } from "node:events";
import { join } from "node:path";
import { createInterface } from "node:readline";

/** A service, and the program that starts it again when it ends. */
export class Service {
  constructor(growbot, spawnOptions) {
    const args = [join(import.meta.dirname, "service_manager.py"), growbot];
    Object.assign(this, { growbot, spawnOptions });
    this.manager = spawn("python3", args, { ...spawnOptions, stdio: ["ignore", "pipe", "ignore"] });
    this.lines = createInterface({ input: this.manager.stdout })[Symbol.asyncIterator]();
  }

  /** Waits until a service prints its URLs. Returns the URLs by name. */
  async nextUrls() {
    const urls = {};
    while (!(urls.control && urls.view)) {
      const { value: line, done } = await this.lines.next();
      if (done) throw new Error("the service ended before it printed its URLs");
      const [name, value] = line.split(/ +/);
      if (name === "process") this.pid = Number(value);
      else urls[name] = value;
    }
    return urls;
  }

  /** Kills the service. The manager starts another one. */
  kill() {
    process.kill(this.pid, "SIGKILL");
  }

  /** Ends manager and service, and switches a simulated robot off. */
  async end(port) {
    this.manager.kill("SIGKILL");
    await once(this.manager, "exit");
    this.kill();
    spawnSync(this.growbot, ["power", "off", "--port", port], this.spawnOptions);
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
