// The page of a running growth: its plan, the layers that the board reports, the state, progress, temperature and
// commands.
//
// Updates are events (growbot-serve/src/watch/). Each contains the changes since the last one, with layers and readings
// from an index on. Heartbeats between them show that the data are current.

import { decodeLayers, growBody } from "./body.js";
import { drawTemperatureChart } from "./chart.js";
import {
  CONFIRM_MS, RejectionError, STALE_MS, ServiceClock, followEvents, openCommands, readResponse, sendUntilAnswered,
} from "./connection.js";
import { sendReadings } from "./embedding.js";
import { mountBody } from "./one.js";
import { durationText, fillNumbers, finishText } from "./text.js";

const find = (selector) => document.querySelector(selector);
const HEX_PER_LAYER = 24;
/** Largest share of the time that is spent on building the body. */
const MAX_BUILD_SHARE = 0.2;
/** Interval at which the age of the data is shown. */
const AGE_MS = 500;
const STOPS = ["stop", "emergency-stop"];
const POWER = "cut the robot's power, or run `growbot estop` on its machine";

const clock = new ServiceClock();
/** Socket for commands. Null on a read-only page. */
let commands = null;
/** True once the growth has ended. Then growbot may have ended, too. */
let hasEnded = false;

const STATE_NAMES = { "emergency-stop": "emergency stop" };
/** Sources of the reached pose (`measured_by` of the result). */
const MEASURED_BY = {
  tip: "from the simulated tip", estimate: "from the feedback's estimate", steps: "from the board's steps",
};

/** Shows the growth, and returns its pictures. */
export function showLive(data) {
  const view = mountBody({ ...data, built: "" });
  find("#live").hidden = false;
  find("#commands").hidden = !data.live.control;
  // The page of all robots has an emergency stop above this page.
  find("#emergency-stop").hidden = !data.live.control || window.parent !== window;
  const title = document.title;

  let built = "";
  let readings = [];
  let timer = null;
  let stale = false;
  const rebuild = () => {
    timer = null;
    stale = false;
    const start = performance.now();
    view.replaceBuilt(growBody(data.start, decodeLayers(built)));
    const took = performance.now() - start;
    timer = setTimeout(() => {
      timer = null;
      if (stale) rebuild();
    }, took / MAX_BUILD_SHARE);
  };

  const update = (changes) => {
    const { layers, readings: newReadings, total_layers: total, result, built_name: builtName } = changes;
    const laid = layers.from + layers.built.length / HEX_PER_LAYER;
    readings = [...readings.slice(0, newReadings.from), ...newReadings.taken];
    built = built.slice(0, layers.from * HEX_PER_LAYER) + layers.built;
    view.total = total;
    // Layers of a simulated tip are reported again with the position of the plastic. So the picture may be out of date
    // even if the number of layers is unchanged.
    stale ||= layers.built.length > 0;
    if (timer === null && stale) rebuild();
    if (builtName) find("#built-name").textContent = builtName;
    showState(changes);
    find("#progress").value = total > 0 ? laid / total : 1;
    find("#laid").textContent = `${laid} of ${total} layers`;
    find("#remaining").textContent = result ? "" : remainingText(changes);
    drawTemperatureChart(find("#temperature"), readings);
    if (newReadings.taken.length > 0) sendReadings(readings);
    document.title = `${total > 0 ? Math.floor((100 * laid) / total) : 100} % · ${title}`;
    if (result) {
      showResult(result);
      view.goalErrorMm = result.measured_by ? result.position_error_mm : null;
      view.publish();
    }
  };
  const ages = makeAges();
  let isUpdated = false;
  const end = () => {
    stream.stop();
    ages.stop();
    hasEnded = true;
    // The service still takes commands, as requests.
    commands?.stop();
  };
  const stream = followEvents(new URL("updates", location.href).href, {
    onEvent(event, content) {
      ages.hear();
      if (event === "update") {
        isUpdated = true;
        update(content);
        if (content.result) end();
      } else if (event === "heartbeat") {
        clock.set(content.time_ms);
        ages.setReport(content.status_age_s);
        if (!isUpdated) showProblem("The robot is not connected: growbot is connecting again.");
      } else if (event === "end") {
        end();
        showProblem(`This growth is not active any more (${content.detail}): reload the page to see the body.`);
      }
    },
    onLost() {
      isUpdated = false;
      showProblem("Cannot reach growbot: it has ended, or the connection is lost. Retrying…");
    },
    onExpired() {
      commands?.stop();
      showProblem("growbot refuses this page, mostly because it has restarted: open the address that `growbot serve` "
        + "prints.");
    },
  });

  if (data.live.control) commands = openCommands(new URL("commands", location.href).href);
  document.querySelectorAll("[data-command]").forEach((button) => {
    button.addEventListener("click", () => sendCommand(button.dataset.command));
  });
  return [view.picture];
}

/** Returns the text of the remaining time, with the time of the end if it is known. */
function remainingText({ remaining_s: remaining, finish_in_s: finish, state }) {
  const time = `${durationText(remaining)} ${state === "growing" ? "left" : "of growth left"}`;
  return finish === null || finish === undefined ? time : `${time}, done at ${finishText(new Date(), finish)}`;
}

function showState({ state, board_responding: isResponding, explanation, command_error: commandError, warning }) {
  const badge = find("#state");
  badge.textContent = STATE_NAMES[state] ?? state;
  badge.dataset.state = state;
  find("#explanation").textContent = explanation ?? "";
  // Filament is changed during a pause.
  find("#filament").hidden = find("#commands").hidden || state !== "paused";
  const isPaused = ["paused", "parked"].includes(state);
  // Neither takes the place of the other, because a double click would press both.
  find("#command-pause").disabled = isPaused;
  find("#command-continue").disabled = !isPaused;
  showProblem(warning ?? "", "#log-problem");
  showProblem(isResponding ? (commandError ?? "") : "The board does not respond. growbot is retrying.");
}

/**
 * Shows a problem of the growth or the connection, or hides it if the text is empty. Problems of a command have another
 * element, because updates do not clear them.
 */
function showProblem(text, selector = "#problem") {
  const problem = find(selector);
  problem.textContent = text;
  problem.hidden = text === "";
}

/** Shows the result of the growth and the final pose of the tip. */
function showResult(result) {
  const badge = find("#state");
  badge.textContent = result.outcome;
  badge.dataset.state = result.outcome;
  for (const button of document.querySelectorAll("#commands button")) button.disabled = true;
  find("#filament").hidden = true;
  if (result.error) showProblem(result.error);
  const drift = result.clock_drift;
  if (drift) showProblem(`The growth was stopped: ${drift.message}; ${drift.remedy}.`);
  if (!result.measured_by) return;
  const rows = [
    ["Position error", `${result.position_error_mm.toFixed(3)} mm`],
    ["Normalized position error", `${(100 * result.normalized_position_error).toFixed(4)} %`],
    ["Direction error", `${result.direction_error_deg.toFixed(3)}°`],
  ];
  const source = MEASURED_BY[result.measured_by] ?? result.measured_by;
  fillNumbers(find("#result"), [[`Reached pose, ${source}`, rows]]);
}

/** Shows how old the data are, once that is more than 5 s. */
function makeAges() {
  let heardAt = performance.now();
  let reportedAt = null;
  const seconds = (since) => Math.round((performance.now() - since) / 1000);
  const isOld = (since) => since !== null && performance.now() - since > STALE_MS;
  const show = () => {
    let text = "";
    if (isOld(heardAt)) text = `growbot does not respond: what is shown is ${seconds(heardAt)} s old.`;
    else if (isOld(reportedAt)) text = `The board last reported ${seconds(reportedAt)} s ago: its state may differ now.`;
    showProblem(text, "#age");
    find("#live").classList.toggle("stale", text !== "");
  };
  const timer = setInterval(show, AGE_MS);
  return {
    hear() { heardAt = performance.now(); },
    /** Records that the board reported `ageS` ago. Null if it has not reported. */
    setReport(ageS) { reportedAt = ageS === null ? null : performance.now() - 1000 * ageS; },
    stop() {
      clearInterval(timer);
      [heardAt, reportedAt] = [Infinity, null];
      show();
    },
  };
}

/** Sends a command to the growth by a request. */
async function postCommand(command, timeMs, signal) {
  const headers = timeMs === undefined ? {} : { "growbot-order-time": String(timeMs) };
  return readResponse(await fetch(`commands/${command}`, { method: "POST", headers, signal }));
}

/** Sends a command to the growth. A stop is sent until growbot has responded. */
async function sendCommand(command) {
  const isStop = STOPS.includes(command);
  const timeMs = isStop ? undefined : clock.now();
  const message = { command, time_ms: timeMs };
  const post = (signal) => postCommand(command, timeMs, signal);
  const start = performance.now();
  const wasActive = !hasEnded;
  const isOver = () => wasActive && hasEnded;
  let cause = "";
  const warn = () => {
    if (isOver()) return;
    const after = Math.round((performance.now() - start) / 1000);
    showProblem(`${command}: not confirmed after ${after} s${cause && ` (${cause})`}: ${POWER}`, "#command-problem");
  };
  const timer = setInterval(() => { if (performance.now() - start >= CONFIRM_MS) warn(); }, AGE_MS);
  const onFailure = (error) => {
    cause = error.message;
    warn();
  };
  try {
    if (isStop) await sendUntilAnswered({ commands, command: message, post, onFailure, isClosed: isOver });
    else await (commands?.isOpen ? commands.send(message) : post());
    showProblem("", "#command-problem");
  } catch (error) {
    const problem = error instanceof RejectionError
      ? `${command} was rejected: ${error.message}${isStop ? `. If the robot must be off now, ${POWER}` : ""}`
      : `${command} did not reach growbot (${error.message}): ${POWER}`;
    showProblem(isOver() ? "" : problem, "#command-problem");
  } finally {
    clearInterval(timer);
  }
}
