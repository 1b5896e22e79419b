// The page of all robots. It shows the state that the service reports and sends the user's commands.

const API = "api/v1";
const JOBS_REFRESH_MS = 10_000;
const MAX_JOBS = 50;
/** Cards of robots by name. A card has its `element`, `find(selector)` in it, and the latest state of its `robot`. */
const cards = new Map();
/** True if this URL can send commands. False if it is read-only. */
let canControl = false;
/** The open panel: the card of its robot, and the element that had the focus before. */
let openedPanel = {};
const byId = (id) => document.getElementById(id);
/** Labels of a maintenance task's value. Tasks without a value have an empty label. */
const valueLabels = {
  preheat: "Temperature in C, or a material; empty for the growth temperature", cooldown: "", home: "",
  load: "Length in mm, or a material", unload: "Length in mm, or a material", purge: "Length in mm, or a material",
  rotate: "Angle in degrees", jog: "Length in mm, negative to retract",
};

/** Requests a path, or sends a value or file to it. Throws the error of the service's response. */
async function request(path, body) {
  const options = {};
  if (body !== undefined) options.method = "POST";
  if (body instanceof File) options.body = body;
  else if (body !== undefined) {
    Object.assign(options, { headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
  }
  const response = await fetch(`${API}/${path}`, options);
  const text = await response.text();
  let result;
  try { result = JSON.parse(text); } catch { result = { detail: text }; }
  if (!response.ok) throw new Error(result.detail ?? `the service returned HTTP status ${response.status}`);
  return result;
}

const formatTime = (utc) => new Date(utc).toLocaleString([], { dateStyle: "short", timeStyle: "short" });
const formatNumber = (number, decimals) => number.toFixed(decimals);

function formatDuration(seconds) {
  const minutes = Math.round(seconds / 60);
  if (minutes < 1) return `${Math.round(seconds)} s`;
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** Returns the card of a robot. Creates it on the first call. */
function getCard(name) {
  if (cards.has(name)) return cards.get(name);
  const element = byId("robot").content.firstElementChild.cloneNode(true);
  const find = (selector) => element.querySelector(selector);
  const card = { element, find, robot: null };
  element.setAttribute("aria-label", `Robot ${name}`);
  find("h2").textContent = name;
  for (const button of element.querySelectorAll("[data-command]")) {
    button.addEventListener("click", () => sendCommand(card, button.dataset.command));
  }
  find("[data-show-body]").addEventListener("click", () => {
    openPanel(`${API}/jobs/${card.robot.job}/live/`, `${name}: live view`, card);
  });
  find("form.grow").addEventListener("submit", (event) => submitGrow(card, event));
  find("form.maintain").addEventListener("submit", (event) => submitMaintenance(card, event));
  find("select").addEventListener("change", () => updateValueField(card));
  byId("robots").append(element);
  cards.set(name, card);
  updateValueField(card);
  return card;
}

/** Shows the value field of the selected maintenance task, or hides it if the task has no value. */
function updateValueField({ find }) {
  const label = valueLabels[find("select").value];
  find(".value-label").textContent = label;
  find("[name=value]").closest("label").hidden = !label;
}

function showMessage({ find }, text, isError) {
  find(".message").textContent = text;
  find(".message").classList.toggle("error", Boolean(isError));
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

function sendCommand(card, command) {
  runAction(card, command.replace("-", " "), async () => {
    showRobots([await request(`robots/${card.robot.name}/commands`, { command })]);
  });
}

function parsePlan(text, name) {
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new Error(`${name} is not a plan (${error.message}): choose a file written by \`growbot plan -o\``);
  }
}

/** Returns the body of a request to grow or to plan. Uploads the scene if the form has one. */
async function growRequest(form) {
  const [[file], [scene]] = [form.plan.files, form.scene.files];
  const goal = form.to.value.trim();
  const [feedback, force, ignore_scene] = [form.feedback, form.force, form.ignore_scene].map(({ checked }) => checked);
  const options = { feedback, force, ignore_scene };
  if (scene) options.scene = (await request(`scenes?name=${encodeURIComponent(scene.name)}`, scene)).scene;
  if (file) return { ...options, plan: parsePlan(await file.text(), file.name), name: file.name };
  return { ...options, to: goal };
}

/** Previews or grows the body of a card's form. */
function submitGrow(card, event) {
  event.preventDefault();
  const form = event.target;
  const isPreview = event.submitter?.value === "preview";
  runAction(card, isPreview ? "preview" : "grow", async () => {
    const body = await growRequest(form);
    if (!isPreview) {
      const job = await request(`robots/${card.robot.name}/jobs`, body);
      refreshJobs();
      return `job ${job.id} started`;
    }
    const { plan, view_path: viewPath } = await request(`plans?robot=${encodeURIComponent(card.robot.name)}`, body);
    const warnings = plan.warnings.map((warning) => `${warning.code}: ${warning.message}`);
    const { pace } = card.robot;
    const finish = pace ? `, done at ${formatTime(Date.now() + (1000 * plan.duration_s) / pace)}` : "";
    card.find(".preview").textContent = [
      `${formatNumber(plan.length_mm, 1)} mm, ${plan.layers} layers, ${formatDuration(plan.duration_s)}${finish}, `
        + `${formatNumber(plan.filament_mm / 1000, 2)} m of filament`,
      ...warnings].join("\n");
    openPanel(`${API}/${viewPath}`, `${card.robot.name}: preview`, card);
    return "";
  });
}

function submitMaintenance(card, event) {
  event.preventDefault();
  const { task, value } = event.target;
  runAction(card, task.options[task.selectedIndex].text, async () => {
    const body = { task: task.value, value: valueLabels[task.value] ? value.value.trim() : "" };
    showRobots([await request(`robots/${card.robot.name}/maintenance`, body)]);
  });
}

/** Shows a page of the service in a panel with an emergency stop of the card's robot. */
function openPanel(url, title, card) {
  openedPanel = { card, previousFocus: document.activeElement };
  byId("body-stop").hidden = !card || !canControl;
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
  openedPanel.previousFocus?.focus();
}

/** Returns the names and values that a card lists. */
function robotProperties(robot) {
  const properties = [];
  if (robot.robot) properties.push(["Robot", robot.robot]);
  if (robot.board_state) {
    const temperature = robot.temperature_c === null ? "no reading" : `${formatNumber(robot.temperature_c, 1)} C`;
    const target = robot.target_c === null ? ", heater off" : ` of ${formatNumber(robot.target_c, 1)} C`;
    properties.push(["Nozzle", temperature + target]);
  }
  if (robot.job) properties.push(["Job", robot.job]);
  if (robot.layers) properties.push(["Layers", `${robot.laid} of ${robot.layers}`]);
  if (robot.finish_utc) properties.push(["Done at", formatTime(robot.finish_utc)]);
  if (robot.pause_reason) properties.push(["Pause reason", robot.pause_reason]);
  return properties;
}

/** Returns the text about the robot's port and simulation. */
function describePort({ port, simulated, pace }) {
  if (!simulated) return port;
  return `${port}, simulated${pace && pace !== 1 ? `, ${pace} times as fast as real time` : ""}`;
}

/** Returns the reason why maintenance is not possible now, empty if it is possible. */
function maintenanceBlockedBy(robot) {
  if (!canControl) return "This URL is read-only.";
  if (robot.state === "disconnected") return "The robot is not connected.";
  if (robot.job) return "A job is active: pause it, and use its page.";
  if (robot.fault) return "A fault is latched: clear it first.";
  return "";
}

/** Returns whether each command is possible in the robot's state. */
function allowedCommands(robot) {
  const isConnected = robot.state !== "disconnected";
  const isPaused = ["paused", "parked"].includes(robot.board_state);
  const isOff = robot.fault || robot.board_state === "emergency-stop";
  return {
    pause: robot.job && !isPaused, continue: robot.job && isPaused, stop: isConnected, "emergency-stop": true,
    "clear-fault": isConnected && isOff && !robot.job,
    cancel: isConnected && !robot.job && robot.laid < robot.layers,
  };
}

/** Shows the latest state of robots. */
function showRobots(robots) {
  for (const robot of robots) {
    const card = getCard(robot.name);
    const { find } = card;
    card.robot = robot;
    find(".about").textContent = describePort(robot);
    const state = robot.state === "disconnected" ? "not connected" : robot.board_state ?? "unknown";
    // Screen readers announce each change of these texts.
    if (find(".state").textContent !== state) find(".state").textContent = state;
    const fault = robot.fault ? `${robot.fault}: ${robot.fault_explanation}` : robot.command_error;
    const alarm = robot.connection_error ?? fault ?? "";
    find(".alarm").hidden = !alarm;
    if (find(".alarm").textContent !== alarm) find(".alarm").textContent = alarm;
    find("progress").hidden = !robot.layers;
    find("progress").value = robot.layers ? robot.laid / robot.layers : 0;
    find(".properties").replaceChildren(...robotProperties(robot).flatMap(([name, value]) => {
      const [term, text] = [document.createElement("dt"), document.createElement("dd")];
      [term.textContent, text.textContent] = [name, value];
      return [term, text];
    }));
    for (const [command, isAllowed] of Object.entries(allowedCommands(robot))) {
      find(`[data-command=${command}]`).disabled = !isAllowed || !canControl;
    }
    find("[data-show-body]").disabled = !robot.job;
    find("form.grow [value=grow]").disabled = robot.state === "disconnected" || Boolean(robot.job) || !canControl;
    const blockedBy = maintenanceBlockedBy(robot);
    find("form.maintain button").disabled = Boolean(blockedBy);
    find(".blocked-by").textContent = blockedBy;
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
    const view = makeLink("3D", `${API}/jobs/${job.id}/view`);
    view.addEventListener("click", (event) => {
      event.preventDefault();
      openPanel(view.href, `${job.robot}: ${job.name}`, cards.get(job.robot));
    });
    actions.append(view, makeLink("Run log", `${API}/jobs/${job.id}/log`));
  }
  if (job.state === "interrupted" && canControl) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "Resume";
    button.addEventListener("click", () => runAction(getCard(job.robot), `resume ${job.id}`, async () => {
      await request(`jobs/${job.id}/resume`, {});
      refreshJobs();
    }));
    actions.append(button);
  }
  return row;
}

/** Requests the latest jobs and shows them. */
async function refreshJobs() {
  const jobs = await request(`jobs?limit=${MAX_JOBS}`);
  byId("no-jobs").hidden = jobs.length > 0;
  byId("job-rows").replaceChildren(...jobs.map(makeJobRow));
}

/** Follows the events of the service. The browser reconnects by itself. */
function followEvents() {
  const events = new EventSource(`${API}/events`);
  events.addEventListener("open", () => { byId("connection").textContent = "connected"; });
  events.addEventListener("error", () => {
    byId("connection").textContent = "Connection lost. Robots continue their jobs. Reconnecting…";
  });
  let lastStates = "";
  events.addEventListener("robots", ({ data }) => {
    const robots = JSON.parse(data);
    showRobots(robots);
    const states = robots.map((robot) => `${robot.job} ${robot.board_state}`).join();
    if (states !== lastStates) refreshJobs();
    lastStates = states;
  });
}

byId("body-close").addEventListener("click", closePanel);
byId("body-stop").addEventListener("click", () => { sendCommand(openedPanel.card, "emergency-stop"); closePanel(); });
document.addEventListener("keydown", ({ key }) => { if (key === "Escape") closePanel(); });
({ can_control: canControl } = await request("access"));
followEvents();
refreshJobs();
setInterval(refreshJobs, JOBS_REFRESH_MS);
