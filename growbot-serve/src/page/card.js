// Cards of robots: the state that the service reports, and how old it is.

import { CONFIRM_MS, STALE_MS } from "./connection.js";

/** Labels of a maintenance task's value. Tasks without a value have an empty label. */
export const valueLabels = {
  preheat: "Temperature in C, or a material; empty for the growth temperature", cooldown: "", home: "",
  load: "Length in mm, or a material", unload: "Length in mm, or a material", purge: "Length in mm, or a material",
  rotate: "Angle in degrees", jog: "Length in mm, negative to retract",
};

export const formatTime = (utc) => new Date(utc).toLocaleString([], { dateStyle: "short", timeStyle: "short" });
export const formatNumber = (number, decimals) => number.toFixed(decimals);

export function formatDuration(seconds) {
  const minutes = Math.round(seconds / 60);
  if (minutes < 1) return `${Math.round(seconds)} s`;
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** Sets the text of an element if it differs, because screen readers announce each change. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Makes the card of a robot. It has its `element`, `find(selector)` in it, and the latest state of its `robot`. */
export function makeCard(name) {
  const element = document.getElementById("robot").content.firstElementChild.cloneNode(true);
  const find = (selector) => element.querySelector(selector);
  element.setAttribute("aria-label", `Robot ${name}`);
  find("h2").textContent = name;
  const card = { element, find, robot: null, reportedAt: null, pendingSince: null };
  find("select").addEventListener("change", () => updateValueField(card));
  updateValueField(card);
  return card;
}

/** Shows the value field of the selected maintenance task, or hides it if the task has no value. */
function updateValueField({ find }) {
  const label = valueLabels[find("select").value];
  find(".value-label").textContent = label;
  find("[name=value]").closest("label").hidden = !label;
}

export function showMessage({ find }, text, isError) {
  find(".message").textContent = text;
  find(".message").classList.toggle("error", Boolean(isError));
}

/** Records that the board reported `ageS` before the message that arrived at `at`. Null if it has not reported. */
export function setAge(card, ageS, at) {
  card.reportedAt = ageS === null ? null : at - 1000 * ageS;
}

/** Returns the names and values that a card lists. */
function robotProperties(robot) {
  const properties = [];
  if (robot.robot) properties.push(["Robot", robot.robot]);
  if (robot.state) {
    const temperature = robot.temperature_c === null ? "no reading" : `${formatNumber(robot.temperature_c, 1)} C`;
    const target = robot.target_c === null ? ", heater off" : ` of ${formatNumber(robot.target_c, 1)} C`;
    properties.push(["Nozzle", temperature + target]);
  }
  if (robot.job) properties.push(["Job", robot.job]);
  if (robot.layers) properties.push(["Layers", `${robot.laid} of ${robot.layers}`]);
  if (robot.finish_utc) properties.push(["Done at", formatTime(robot.finish_utc)]);
  if (robot.pause_explanation) properties.push(["Pause reason", robot.pause_explanation]);
  return properties;
}

/** Returns the text about the robot's port and simulation. */
function describePort({ port, simulated, pace }) {
  if (!simulated) return port;
  return `${port}, simulated${pace && pace !== 1 ? `, ${pace} times as fast as real time` : ""}`;
}

/** Returns the reason why maintenance is not possible now, empty if it is possible. */
function maintenanceBlockedBy(robot, isStale, canControl) {
  if (!canControl) return "This URL is read-only.";
  if (robot.connection === "disconnected") return "The robot is not connected.";
  if (isStale) return "The state of the robot is not known.";
  if (robot.job) return "A job is active: pause it, and use its page, or stop the job first.";
  if (robot.fault) return "A fault is latched: clear it first.";
  return "";
}

/** Returns whether each command is possible in the robot's state. Of a stale state only stops and pauses follow. */
function allowedCommands(robot, isStale) {
  const isConnected = robot.connection !== "disconnected";
  const isKnown = isConnected && !isStale;
  const isPaused = ["paused", "parked"].includes(robot.state);
  const isOff = robot.fault || robot.state === "emergency-stop";
  return {
    pause: robot.job && (isStale || !isPaused), stop: true,
    continue: isKnown && robot.job && isPaused,
    "clear-fault": isKnown && isOff && !robot.job,
    cancel: isKnown && !robot.job && robot.laid < robot.layers,
    "withdraw-stop": Boolean(robot.pending_stop),
  };
}

function alarmText({ robot, pendingSince }) {
  const fault = robot.fault ? `${robot.fault}: ${robot.fault_explanation}` : robot.command_error;
  const alarm = robot.connection_error ?? fault ?? "";
  // Every stop is unconfirmed for a moment.
  if (pendingSince === null || performance.now() - pendingSince < CONFIRM_MS) return alarm;
  const stop = `The board has not confirmed the ${robot.pending_stop.replace("-", " ")}: cut the robot's power if it `
    + "must be off now. The service sends the stop first when the robot is connected.";
  return alarm ? `${stop} (${alarm})` : stop;
}

/**
 * Shows the latest state of a card's robot, and its age if it is not current. `silentMs` is the time since the latest
 * message of the service.
 */
export function renderCard(card, silentMs, canControl) {
  const { find, robot, reportedAt } = card;
  const ageMs = reportedAt === null ? null : performance.now() - reportedAt;
  const isServiceSilent = silentMs > STALE_MS;
  const isStale = isServiceSilent || ageMs === null || ageMs > STALE_MS;
  const state = robot.connection === "disconnected" ? "not connected" : robot.state ?? "unknown";
  setText(find(".about"), describePort(robot));
  setText(find(".state"), isStale && robot.state ? `last known: ${state}` : state);
  const age = ageMs === null ? "No report yet" : `${formatDuration(ageMs / 1000)} old`;
  setText(find(".age"), isStale ? `${age}: the ${isServiceSilent ? "service" : "board"} does not respond` : "");
  card.element.classList.toggle("stale", isStale);
  card.pendingSince = robot.pending_stop ? card.pendingSince ?? performance.now() : null;
  const alarm = alarmText(card);
  find(".alarm").hidden = !alarm;
  setText(find(".alarm"), alarm);
  find("progress").hidden = !robot.layers;
  find("progress").value = robot.layers ? robot.laid / robot.layers : 0;
  find(".properties").replaceChildren(...robotProperties(robot).flatMap(([name, value]) => {
    const [term, text] = [document.createElement("dt"), document.createElement("dd")];
    [term.textContent, text.textContent] = [name, value];
    return [term, text];
  }));
  for (const [command, isAllowed] of Object.entries(allowedCommands(robot, isStale))) {
    find(`[data-command=${command}]`).disabled = !isAllowed || !canControl;
  }
  find("[data-show-body]").disabled = !robot.job;
  const canGrow = canControl && robot.connection === "ready" && !isStale;
  find("form.grow [value=grow]").disabled = !canGrow;
  const blockedBy = maintenanceBlockedBy(robot, isStale, canControl);
  find("form.maintain button").disabled = Boolean(blockedBy);
  setText(find(".blocked-by"), blockedBy);
}
