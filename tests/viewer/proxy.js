// Uses the page of all robots through nginx with TLS and a login, in Debian's Chromium. nginx is configured by the
// block of the book (book/src/proxy.md), with other files and ports. The page shows the robots, and delivers a stop.
//
//   node proxy.js GROWBOT
//
// Needs nginx and openssl. The browser is `chromium`, or the value of CHROMIUM.

import assert from "node:assert/strict";
import { spawn, spawnSync } from "node:child_process";
import { once } from "node:events";
import { mkdir, mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { chromium } from "playwright-core";
import { environment } from "./environment.js";
import { partsOf } from "./operator.js";
import { Service, watchRequests } from "./service.js";

const HOST = "robots.example";
const TIMEOUT_MS = 600_000;
const login = { username: "operator", password: "a long password" };
const growbot = resolve(process.argv[2]);
const book = resolve(import.meta.dirname, "../../book/src/proxy.md");
const errors = [];

async function freePort() {
  const server = createServer().listen(0, "127.0.0.1");
  await once(server, "listening");
  const { port } = server.address();
  server.close();
  await once(server, "close");
  return port;
}

function run(program, args) {
  const { status, stdout, stderr } = spawnSync(program, args, { encoding: "utf8" });
  assert.equal(status, 0, `${program} ${args.join(" ")}: ${stderr}`);
  return stdout;
}

/** Returns the block of the book in this language. */
async function blockOf(language) {
  const text = await readFile(book, "utf8");
  return new RegExp(`^ *\`\`\`${language}\\n([^]*?)^ *\`\`\``, "m").exec(text)[1];
}

/** Replaces each text, which must be there. */
function replaceAll(text, pairs) {
  return pairs.reduce((result, [from, to]) => {
    assert.ok(result.includes(from), `${book} has no ${from}`);
    return result.replaceAll(from, to);
  }, text);
}

const directory = await mkdtemp(join(tmpdir(), "growbot-proxy-"));
const at = (name) => join(directory, name);
const directories = { XDG_STATE_HOME: at("state"), XDG_RUNTIME_DIR: at("run") };
for (const path of Object.values(directories)) await mkdir(path, { mode: 0o700 });
const proxyPort = await freePort();
const origin = `https://${HOST}:${proxyPort}`;
const settings = replaceAll(await blockOf("toml"), [[`https://${HOST}`, origin]]);
await writeFile(at("growbot.toml"), `[robots.lab]\nport = "sim:lab"\nrobot = "growbot-a2"\npace = 10.0\n${settings}`);
const spawnOptions = { env: { ...environment, ...directories }, cwd: directory };
const service = new Service(growbot, spawnOptions);
let [nginx, browser] = [];

try {
  const urls = await service.start();
  const { port, pathname } = new URL(urls.control);

  run("openssl", ["req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1", "-subj", `/CN=${HOST}`, "-keyout",
    at("key"), "-out", at("certificate")]);
  await writeFile(at("logins"), `${login.username}:${run("openssl", ["passwd", "-apr1", login.password])}`);
  const server = replaceAll(await blockOf("nginx"), [
    ["listen 443 ssl", `listen 127.0.0.1:${proxyPort} ssl`], ["127.0.0.1:8017", `127.0.0.1:${port}`],
    ["/etc/ssl/certs/robots.pem", at("certificate")], ["/etc/ssl/private/robots.key", at("key")],
    ["/etc/nginx/robots.logins", at("logins")],
  ]);
  const user = process.getuid() === 0 ? "user root;\n" : "";
  const paths = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"].map((of) => `${of}_temp_path ${at(of)};\n`);
  const log = `pid ${at("nginx.pid")};\nerror_log ${at("nginx.log")};\n`;
  const http = `http {\naccess_log off;\n${paths.join("")}${server}}\n`;
  await writeFile(at("nginx.conf"), `${user}daemon off;\n${log}events {}\n${http}`);
  nginx = spawn("nginx", ["-c", at("nginx.conf"), "-p", directory], { stdio: "ignore" });

  browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", `--host-resolver-rules=MAP ${HOST} 127.0.0.1`],
  });
  const context = await browser.newContext({ ignoreHTTPSErrors: true, httpCredentials: login });
  const page = await context.newPage();
  page.setDefaultTimeout(TIMEOUT_MS);
  page.on("pageerror", (error) => errors.push(error.stack));
  const pageUrl = `${origin}${pathname}`;
  watchRequests(page, pageUrl, "control", errors);
  const deadline = Date.now() + TIMEOUT_MS;
  // nginx may not listen yet.
  while (!(await page.goto(pageUrl).catch(() => null))) {
    assert.ok(nginx.exitCode === null && Date.now() < deadline, "nginx does not listen");
    await page.waitForTimeout(100);
  }

  assert.equal(page.url(), `${origin}/control/`);
  const [cookie, ...others] = await context.cookies();
  assert.deepEqual(others, []);
  assert.deepEqual([cookie.httpOnly, cookie.secure, cookie.sameSite, cookie.path], [true, true, "Strict", "/"]);

  // The card of the robot follows its state, and the stop reaches the robot.
  const { button, confirm, nextBody, stop, typeGoal, waitForState } = partsOf(page, "lab");
  await waitForState("idle");
  await typeGoal("0,0,1500,0,90");
  await nextBody.getByRole("button", { name: "Grow", exact: true }).click();
  await confirm("Heat and grow");
  await waitForState("growing");
  await button("Stop").click();
  await waitForState("stopped");
  await stop.click();
  await waitForState("emergency-stop");

  // Without the proxy's login there is nothing.
  const stranger = await browser.newContext({ ignoreHTTPSErrors: true });
  const strangersUrl = `https://127.0.0.1:${proxyPort}${pathname}`;
  assert.equal((await stranger.request.get(strangersUrl, { headers: { host: HOST } })).status(), 401);
  assert.deepEqual(errors, []);
  console.log("the page behind nginx: showed its robot, grew and stopped");
} finally {
  await browser?.close();
  if (nginx?.kill("SIGTERM")) await once(nginx, "exit");
  await service.end();
  spawnSync(growbot, ["power", "off", "--port", "sim:lab"], spawnOptions);
  await rm(directory, { recursive: true, maxRetries: 5 });
}
