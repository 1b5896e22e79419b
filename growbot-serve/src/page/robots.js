// The page of all robots. It shows the state that the service reports and sends the user's commands.

import {
  formatDuration, formatNumber, formatTime, makeCard, renderCard, setAge, setText, showMessage, valueLabels,
} from "./card.js";
import { RejectionError, STALE_MS, retryDelay } from "./connection.js";
import { sendCommand, sendOrder, showBanner, startCommands, stopCommands } from "./orders.js";
import { ask } from "./question.js";
import { API, clock, followService, request } from "./service.js";

const JOBS_REFRESH_MS = 10_000;
const MAX_JOBS = 50;
/** Interval at which the ages on the page are updated. */
const AGE_MS = 500;
/** Cards of robots by name. */
const cards = new Map();
/** Names under which the service stores the scenes of this page's files. */
const storedScenes = new WeakMap();
/** True if this URL can send commands, false if it is read-only. Null until the service has responded. */
let canControl = null;
/** Time of the service's latest message. Null before the first message. */
let heardAt = null;
/** True if the connection to the service is lost. */
let isLost = false;
/** Banner of a page whose token the service refuses. Null on other pages. */
let expiredBanner = null;
/** The open panel: the element that had the focus before, and the selection. */
let openedPanel = {};
const byId = (id) => document.getElementById(id);

const silentMs = () => (heardAt === null ? Infinity : performance.now() - heardAt);
const sleep = (ms) => new Promise((resolve) => { setTimeout(resolve, ms); });

/** Returns the card of a robot. Creates it on the first call. */
function getCard(name) {
  if (cards.has(name)) return cards.get(name);
  const card = makeCard(name);
  for (const button of card.element.querySelectorAll("[data-command]")) {
    button.addEventListener("click", () => giveCommand(card, button.dataset.command));
  }
  card.find("[data-show-body]").addEventListener("click", () => {
    openPanel(`${API}jobs/${card.robot.job}/live/`, `${name}: live view`, card);
  });
  card.find("form.grow").addEventListener("submit", (event) => submitGrow(card, event));
  card.find("form.maintain").addEventListener("submit", (event) => submitMaintenance(card, event));
  byId("robots").append(card.element);
  cards.set(name, card);
  showSelection();
  return card;
}

/** Returns the cards of the robots that the page shows: the one in the fragment of the URL, or all. */
function selectedCards() {
  const name = [...cards.keys()].find((name) => `#${encodeURIComponent(name)}` === location.hash);
  return name === undefined ? [...cards.values()] : [cards.get(name)];
}

/** Shows the selected robots, and the links to the others. The emergency stop is that of the selected robots. */
function showSelection() {
  const selected = selectedCards();
  for (const card of cards.values()) card.element.hidden = !selected.includes(card);
  const isOne = selected.length === 1;
  const names = [...cards.keys()];
  const link = (text, hash, isCurrent) => {
    const element = makeLink(text, hash);
    if (isCurrent) element.setAttribute("aria-current", "page");
    return element;
  };
  byId("robot-links").hidden = names.length < 2;
  document.body.classList.toggle("several", names.length > 1);
  byId("robot-links").replaceChildren(
    link("All robots", "#", !isOne),
    ...names.map((name) => link(name, `#${encodeURIComponent(name)}`, isOne && selected[0] === cards.get(name))),
  );
  const target = isOne ? selected[0].robot?.name ?? names[0] : `all ${selected.length} robots`;
  setText(byId("emergency-stop"), selected.length ? `Emergency stop ${target}` : "Emergency stop");
}

/** Runs an action of a card and shows its result. */
async function runAction(card, label, action) {
  showMessage(card, `${label} …`);
  try {
    showMessage(card, await action() ?? `${label}: done`);
  } catch (error) {
    showMessage(card, error.message, true);
  }
}

/** Questions before commands that destroy something. */
const questions = {
  cancel: ({ name, laid, layers }) => [
    `Discard the body of ${name}?`,
    `The board deletes its ${laid} of ${layers} layers. The body cannot be resumed after that.`, "Discard body",
  ],
  "withdraw-stop": ({ name }) => [
    `Withdraw the stop of ${name}?`,
    "The board has not confirmed the stop, so the robot may still be on. The service will not send the stop again.",
    "Withdraw stop",
  ],
};

async function giveCommand(card, command) {
  if (questions[command] && !await ask(...questions[command](card.robot))) return;
  await runAction(card, command.replaceAll("-", " "), async () => {
    showRobots([await sendCommand(card.robot.name, command)]);
  });
}

function stopSelected() {
  const selected = selectedCards();
  for (const card of selected) giveCommand(card, "emergency-stop");
  if (!selected.length) {
    const problem = "No robot is known yet: cut the robot's power, or run `growbot estop` on its machine";
    setText(byId("connection"), problem);
  }
}

function parsePlan(text, name) {
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new Error(`${name} is not a plan (${error.message}): choose a file written by \`growbot plan -o\``);
  }
}

/** Returns the name under which the service stores a scene. Uploads the scene unless this page has done that. */
async function storeScene(file) {
  if (!storedScenes.has(file)) {
    const { scene } = await request(`scenes?name=${encodeURIComponent(file.name)}`, file);
    storedScenes.set(file, scene);
  }
  return storedScenes.get(file);
}

/** Returns the body of a request to grow or to plan. */
async function growRequest(form) {
  const [[file], [scene]] = [form.plan.files, form.scene.files];
  const goal = form.to.value.trim();
  const [feedback, force, ignore_scene] = [form.feedback, form.force, form.ignore_scene].map(({ checked }) => checked);
  const options = { feedback, force, ignore_scene };
  if (scene) options.scene = await storeScene(scene);
  if (file) return { ...options, plan: parsePlan(await file.text(), file.name), name: file.name };
  return { ...options, to: goal };
}

/** Previews or grows the body of a card's form. */
async function submitGrow(card, event) {
  event.preventDefault();
  const form = event.target;
  const { name } = card.robot;
  if (event.submitter?.value === "preview") {
    await runAction(card, "preview", () => preview(card, form));
    return;
  }
  const timeMs = clock.now();
  await runAction(card, "grow", async () => {
    const body = await growRequest(form);
    const job = await sendOrder(`Grow on ${name}`, `robots/${encodeURIComponent(name)}/jobs`, body, timeMs);
    refreshJobs();
    return `job ${job.id} started`;
  });
}

async function preview(card, form) {
  const { name, pace } = card.robot;
  const body = await growRequest(form);
  const { plan, view_path: viewPath } = await request(`plans?robot=${encodeURIComponent(name)}`, body);
  const warnings = plan.warnings.map((warning) => `${warning.code}: ${warning.message}`);
  const finish = pace ? `, done at ${formatTime(Date.now() + (1000 * plan.duration_s) / pace)}` : "";
  card.find(".preview").textContent = [
    `${formatNumber(plan.length_mm, 1)} mm, ${plan.layers} layers, ${formatDuration(plan.duration_s)}${finish}, `
      + `${formatNumber(plan.filament_mm / 1000, 2)} m of filament`,
    ...warnings].join("\n");
  openPanel(`${API}${viewPath}`, `${name}: preview`, card);
  return "";
}

function submitMaintenance(card, event) {
  event.preventDefault();
  const { task, value } = event.target;
  const label = task.options[task.selectedIndex].text;
  const { name } = card.robot;
  runAction(card, label, async () => {
    const body = { task: task.value, value: valueLabels[task.value] ? value.value.trim() : "" };
    showRobots([await sendOrder(`${label} of ${name}`, `robots/${encodeURIComponent(name)}/maintenance`, body)]);
  });
}

/** Shows a page of the service in a panel below the header. Selects the card's robot, so the stop is that of it. */
function openPanel(url, title, card) {
  if (byId("body").hidden) openedPanel = { previousFocus: document.activeElement, hash: location.hash };
  if (card && cards.size > 1) history.replaceState(null, "", `#${encodeURIComponent(card.robot.name)}`);
  showSelection();
  byId("body-title").textContent = title;
  byId("body-frame").src = url;
  byId("body-link").href = url;
  byId("body").hidden = false;
  byId("body-close").focus();
}

function closePanel() {
  if (byId("body").hidden) return;
  byId("body").hidden = true;
  byId("body-frame").removeAttribute("src");
  if (openedPanel.hash !== location.hash) history.replaceState(null, "", openedPanel.hash || "#");
  showSelection();
  openedPanel.previousFocus?.focus();
}

/** Shows the latest state of robots, which the service sent `ageMs` ago. */
function showRobots(robots, ageMs = 0) {
  for (const robot of robots) {
    const card = getCard(robot.name);
    const isFirst = card.robot === null;
    card.robot = robot;
    setAge(card, robot.status_age_s, performance.now() - ageMs);
    renderCard(card, silentMs(), canControl);
    if (isFirst) showSelection();
  }
}

function makeLink(text, url) {
  const link = document.createElement("a");
  link.textContent = text;
  link.href = url;
  return link;
}

/** Makes the row of a job. */
function makeJobRow(job) {
  const row = document.createElement("tr");
  const state = job.reason && job.reason !== job.state ? `${job.state}: ${job.reason}` : job.state;
  const texts = [formatTime(job.created_utc), job.robot, job.name, `${job.laid} of ${job.layers}`, state];
  for (const text of texts) row.insertCell().textContent = text;
  const actions = row.insertCell();
  if (job.laid > 0 || job.state === "active") {
    const view = makeLink("3D", `${API}jobs/${job.id}/view`);
    view.addEventListener("click", (event) => {
      event.preventDefault();
      openPanel(view.href, `${job.robot}: ${job.name}`, cards.get(job.robot));
    });
    actions.append(view, makeLink("Run log", `${API}jobs/${job.id}/log`));
  }
  if (job.state === "interrupted" && canControl) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "Resume";
    button.addEventListener("click", () => runAction(getCard(job.robot), `resume ${job.id}`, async () => {
      await sendOrder(`Resume on ${job.robot}`, `jobs/${job.id}/resume`, {});
      refreshJobs();
    }));
    actions.append(button);
  }
  return row;
}

let isRefreshing = false;

/** Requests the latest jobs and shows them. One request at a time, so that a frozen service gets no pile of them. */
async function refreshJobs() {
  if (isRefreshing || expiredBanner) return;
  isRefreshing = true;
  try {
    const jobs = await request(`jobs?limit=${MAX_JOBS}`);
    byId("no-jobs").hidden = jobs.length > 0;
    byId("job-rows").replaceChildren(...jobs.map(makeJobRow));
    setText(byId("jobs-problem"), "");
  } catch (error) {
    setText(byId("jobs-problem"), `The list of jobs is not current: ${error.message}`);
  } finally {
    isRefreshing = false;
  }
}

let lastStates = "";

/** Handles a message of the service, which was sent `ageMs` ago. */
function onMessage({ event, data, ageMs }) {
  isLost = event === "lost";
  if (event === "expired") expire();
  else if (!isLost) renew();
  if (data) heardAt = Math.max(heardAt ?? 0, performance.now() - ageMs);
  if (event === "heartbeat") {
    clock.set(data.time_ms, ageMs);
    for (const [name, ageS] of Object.entries(data.status_age_s)) {
      if (cards.has(name)) setAge(cards.get(name), ageS, performance.now() - ageMs);
    }
  } else if (event === "robots") {
    showRobots(data, ageMs);
    const states = data.map((robot) => `${robot.job} ${robot.state}`).join();
    if (states !== lastStates) refreshJobs();
    lastStates = states;
  }
  showAges();
}

/** Shows that the service refuses the token of this page, so that it gets no data and cannot send commands. */
function expire() {
  stopCommands();
  expiredBanner ??= showBanner("The service refuses this page, mostly because it has restarted: open the address that "
    + "`growbot serve` prints. Until then, stop robots with `growbot estop` on their machine, or cut their power.");
}

/** Uses the page again, because another page of the browser was opened with the new token. */
function renew() {
  if (!expiredBanner) return;
  expiredBanner.element.remove();
  expiredBanner = null;
  if (canControl) startCommands();
}

/** Shows whether the data are current. */
function showAges() {
  const silence = silentMs();
  const isStale = silence > STALE_MS;
  const age = heardAt === null ? "No data yet" : `No data for ${Math.round(silence / 1000)} s`;
  let text = "Live";
  if (isStale) text = isLost ? `${age}, connecting again…` : age;
  else if (isLost) text = "Connection lost, connecting again…";
  if (expiredBanner) text = "No access";
  if (heardAt !== null || isLost || expiredBanner) setText(byId("connection"), text);
  byId("connection").classList.toggle("alarm-text", text !== "Live");
  document.body.classList.toggle("silent", isStale);
  for (const card of cards.values()) renderCard(card, silence, canControl);
}

/** Requests the rights of this URL until the service responds. */
async function start() {
  for (let failures = 0; canControl === null; failures += 1) {
    try {
      ({ can_control: canControl } = await request("access"));
    } catch (error) {
      const isRefused = error instanceof RejectionError && error.status !== 503;
      setText(byId("jobs-problem"), isRefused
        ? `The service does not know this address (${error.message}): open the one that \`growbot serve\` prints`
        : `The service does not respond (${error.message}): connecting again`);
      await sleep(retryDelay(failures));
    }
  }
  byId("emergency-stop").disabled = !canControl;
  byId("emergency-stop").title = canControl ? "" : "This URL is read-only: open the control URL.";
  if (canControl) startCommands();
  showAges();
  refreshJobs();
}

byId("emergency-stop").addEventListener("click", stopSelected);
byId("body-close").addEventListener("click", closePanel);
document.addEventListener("keydown", ({ key }) => { if (key === "Escape") closePanel(); });
window.addEventListener("hashchange", showSelection);
// A page that the browser had frozen has lost its connections.
window.addEventListener("pageshow", ({ persisted }) => { if (persisted) location.reload(); });
followService(onMessage);
setInterval(showAges, AGE_MS);
setInterval(refreshJobs, JOBS_REFRESH_MS);
start();
