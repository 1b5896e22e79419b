// The page of all robots. It shows the state that the service reports and sends the user's commands.

const api = "api/v1";
const cards = new Map();
/** True if this address can send commands. */
let may = false;
const byId = (id) => document.getElementById(id);
const units = {
  preheat: "Temperature in C, or a material; empty for the growth temperature", cooldown: "", home: "",
  load: "Length in mm, or a material", unload: "Length in mm, or a material", purge: "Length in mm, or a material",
  rotate: "Angle in degrees", jog: "Length in mm, negative to pull",
};

/** Requests a path, or sends a value or file to it. Throws the error that the service responds with. */
async function ask(path, what) {
  const options = {};
  if (what !== undefined) options.method = "POST";
  if (what instanceof File) options.body = what;
  else if (what !== undefined) Object.assign(options, { headers: { "content-type": "application/json" }, body: JSON.stringify(what) });
  const answer = await fetch(`${api}/${path}`, options);
  const text = await answer.text();
  let said;
  try { said = JSON.parse(text); } catch { said = { detail: text }; }
  if (!answer.ok) throw new Error(said.detail ?? `the service responded ${answer.status}`);
  return said;
}

const clock = (utc) => new Date(utc).toLocaleString([], { dateStyle: "short", timeStyle: "short" });
const fixed = (number, places) => number.toFixed(places);

function duration(seconds) {
  const minutes = Math.round(seconds / 60);
  return minutes < 1 ? `${Math.round(seconds)} s` : minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** Returns the card of a robot. Creates it on the first call. */
function cardOf(name) {
  if (cards.has(name)) return cards.get(name);
  const card = byId("robot").content.firstElementChild.cloneNode(true);
  const find = (selector) => card.querySelector(selector);
  const of = { card, find, robot: null };
  card.setAttribute("aria-label", `Robot ${name}`);
  find("h2").textContent = name;
  for (const button of card.querySelectorAll("[data-order]")) {
    button.addEventListener("click", () => order(of, button.dataset.order));
  }
  find("[data-look]").addEventListener("click", () => open(`${api}/jobs/${of.robot.job}/live/`, `${name}: the body as it grows`, of));
  find("form.grow").addEventListener("submit", (event) => grow(of, event));
  find("form.maintain").addEventListener("submit", (event) => maintain(of, event));
  find("select").addEventListener("change", () => task(of));
  byId("robots").append(card);
  cards.set(name, of);
  task(of);
  return of;
}

function task({ find }) {
  const means = units[find("select").value];
  find(".what").textContent = means;
  find("[name=value]").closest("label").hidden = !means;
}

function say({ find }, words, refused) {
  find(".answer").textContent = words;
  find(".answer").classList.toggle("refused", Boolean(refused));
}

/** Runs an action of a card and shows its result. */
async function attempt(of, words, what) {
  say(of, `${words} …`);
  try {
    say(of, await what() ?? `${words}: done`);
  } catch (error) {
    say(of, error.message, true);
  }
}

const order = (of, name) => attempt(of, name.replace("-", " "), async () => show([await ask(`robots/${of.robot.name}/orders`, { order: name })]));

function parsed(text, name) {
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new Error(`${name} is no plan (${error.message}): choose a file that \`growbot plan -o\` has written`);
  }
}

async function wanted(form) {
  const [[file], [scene]] = [form.plan.files, form.scene.files];
  const goal = form.to.value.trim();
  const options = { feedback: form.feedback.checked, force: form.force.checked, ignore_scene: form.ignore_scene.checked };
  if (scene) options.scene = (await ask(`scenes?name=${encodeURIComponent(scene.name)}`, scene)).scene;
  if (file) return { ...options, plan: parsed(await file.text(), file.name), name: file.name };
  return { ...options, to: goal };
}

function grow(of, event) {
  event.preventDefault();
  const form = event.target;
  const preview = event.submitter?.value === "preview";
  attempt(of, preview ? "preview" : "grow", async () => {
    const body = await wanted(form);
    if (!preview) {
      const job = await ask(`robots/${of.robot.name}/jobs`, body);
      jobs();
      return `job ${job.id} has started`;
    }
    const { plan, view } = await ask(`plans?robot=${encodeURIComponent(of.robot.name)}`, body);
    const warnings = plan.warnings.map((warning) => `${warning.code}: ${warning.message}`);
    const done = of.robot.pace ? `, done at ${clock(Date.now() + (1000 * plan.duration_s) / of.robot.pace)}` : "";
    of.find(".preview").textContent = [
      `${fixed(plan.length_mm, 1)} mm, ${plan.layers} layers, ${duration(plan.duration_s)}${done}, ${fixed(plan.filament_mm / 1000, 2)} m of filament`,
      ...warnings].join("\n");
    open(`${api}/${view}`, `${of.robot.name}: preview`, of);
    return "";
  });
}

function maintain(of, event) {
  event.preventDefault();
  const { task, value } = event.target;
  attempt(of, task.options[task.selectedIndex].text, async () => {
    show([await ask(`robots/${of.robot.name}/maintenance`, { task: task.value, value: units[task.value] ? value.value.trim() : "" })]);
  });
}

/** Shows a page of the service in a panel with an emergency stop of the card's robot. */
function open(address, title, of) {
  shown = { of, from: document.activeElement };
  byId("body-stop").hidden = !of || !may;
  byId("body-title").textContent = title;
  byId("body-frame").src = address;
  byId("body-page").href = address;
  byId("body").hidden = false;
  byId("body-close").focus();
}

let shown = {};
byId("body-close").addEventListener("click", close);
byId("body-stop").addEventListener("click", () => { order(shown.of, "emergency-stop"); close(); });
document.addEventListener("keydown", ({ key }) => { if (key === "Escape") close(); });
function close() {
  if (byId("body").hidden) return;
  byId("body").hidden = true;
  byId("body-frame").removeAttribute("src");
  shown.from?.focus();
}

function facts(robot) {
  const list = [];
  if (robot.robot) list.push(["Robot", robot.robot]);
  if (robot.board) {
    const now = robot.temperature_c === null ? "no reading" : `${fixed(robot.temperature_c, 1)} C`;
    list.push(["Nozzle", robot.target_c === null ? `${now}, heater off` : `${now} of ${fixed(robot.target_c, 1)} C`]);
  }
  if (robot.job) list.push(["Job", robot.job]);
  if (robot.layers) list.push(["Layers", `${robot.laid} of ${robot.layers}`]);
  if (robot.finish_utc) list.push(["Done at", clock(robot.finish_utc)]);
  if (robot.pause) list.push(["Waits", robot.pause]);
  return list;
}

/** Returns the reason why maintenance is not possible now, empty if it is possible. */
function unsafe(robot) {
  if (!may) return "This URL is read-only.";
  if (robot.state === "disconnected") return "The robot is not connected.";
  if (robot.job) return "A job is active: pause it and use its page.";
  if (robot.fault) return "A fault is latched: clear it first.";
  return "";
}

/** Shows the latest state of robots. */
function show(robots) {
  for (const robot of robots) {
    const of = cardOf(robot.name);
    const { find } = of;
    of.robot = robot;
    find(".about").textContent = `${robot.port}${robot.simulated ? `, simulated${robot.pace && robot.pace !== 1 ? `, ${robot.pace} times as fast as real time` : ""}` : ""}`;
    const state = robot.state === "disconnected" ? "not connected" : robot.board ?? "unknown";
    if (find(".state").textContent !== state) find(".state").textContent = state;
    const alarm = robot.trouble ?? (robot.fault ? `${robot.fault}: ${robot.fault_explanation}` : robot.refused) ?? "";
    find(".alarm").hidden = !alarm;
    if (find(".alarm").textContent !== alarm) find(".alarm").textContent = alarm;
    find("progress").hidden = !robot.layers;
    find("progress").value = robot.layers ? robot.laid / robot.layers : 0;
    find(".facts").replaceChildren(...facts(robot).flatMap(([name, value]) => {
      const [term, text] = [document.createElement("dt"), document.createElement("dd")];
      [term.textContent, text.textContent] = [name, value];
      return [term, text];
    }));
    const connected = robot.state !== "disconnected";
    const paused = ["paused", "parked"].includes(robot.board);
    const allowed = {
      pause: robot.job && !paused, continue: robot.job && paused, stop: connected, "emergency-stop": true,
      "clear-fault": connected && (robot.fault || robot.board === "emergency-stop") && !robot.job,
      cancel: connected && !robot.job && robot.laid < robot.layers,
    };
    for (const [name, now] of Object.entries(allowed)) find(`[data-order=${name}]`).disabled = !now || !may;
    find("[data-look]").disabled = !robot.job;
    find("form.grow [value=grow]").disabled = !connected || Boolean(robot.job) || !may;
    find("form.maintain button").disabled = Boolean(unsafe(robot));
    find(".why").textContent = unsafe(robot);
  }
}

function link(text, address) {
  const anchor = document.createElement("a");
  anchor.textContent = text;
  anchor.href = address;
  return anchor;
}

/** Requests the latest jobs and shows them. */
async function jobs() {
  const list = await ask("jobs?max=50");
  byId("no-jobs").hidden = list.length > 0;
  byId("job-rows").replaceChildren(...list.map((job) => {
    const row = document.createElement("tr");
    const texts = [clock(job.created_utc), job.robot, job.name, `${job.laid} of ${job.layers}`, job.why && job.why !== job.state ? `${job.state}: ${job.why}` : job.state];
    for (const text of texts) row.insertCell().textContent = text;
    const last = row.insertCell();
    if (job.laid > 0 || job.state === "active") {
      const view = link("3D", `${api}/jobs/${job.id}/view`);
      view.addEventListener("click", (event) => { event.preventDefault(); open(view.href, `${job.robot}: ${job.name}`, cards.get(job.robot)); });
      last.append(view, link("Run log", `${api}/jobs/${job.id}/log`));
    }
    if (job.state === "interrupted" && may) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = "Resume";
      button.addEventListener("click", () => attempt(cardOf(job.robot), `resume ${job.id}`, async () => { await ask(`jobs/${job.id}/resume`, {}); jobs(); }));
      last.append(button);
    }
    return row;
  }));
}

/** Follows the events of the service. The browser reconnects by itself. */
function follow() {
  const events = new EventSource(`${api}/events`);
  events.addEventListener("open", () => { byId("connection").textContent = "connected"; });
  events.addEventListener("error", () => { byId("connection").textContent = "Connection lost. Robots continue their jobs. Reconnecting…"; });
  let known = "";
  events.addEventListener("robots", ({ data }) => {
    const robots = JSON.parse(data);
    show(robots);
    const now = robots.map((robot) => `${robot.job} ${robot.board}`).join();
    if (now !== known) jobs();
    known = now;
  });
}

({ operate: may } = await ask("access"));
follow();
jobs();
setInterval(jobs, 10_000);
