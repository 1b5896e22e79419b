// The page of a running growth: its plan, the layers that the board reports, the state, progress, temperature and
// commands.
//
// Updates are server-sent events (growbot-host/src/watch/). Each contains the changes since the last one, with layers
// and readings from an index on.

import { decodeLayers, growBody } from "./body.js";
import { drawTemperatureChart } from "./chart.js";
import { mountBody } from "./one.js";
import { durationText, fillNumbers, finishText } from "./text.js";

const find = (selector) => document.querySelector(selector);
const HEX_PER_LAYER = 24;
/** Largest share of the time that is spent on building the body. */
const MAX_BUILD_SHARE = 0.2;

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

  const source = new EventSource("updates");
  source.onmessage = ({ data: text }) => {
    const update = JSON.parse(text);
    const { layers, readings: newReadings, total_layers: total, result, built_name: builtName } = update;
    const laid = layers.from + layers.built.length / HEX_PER_LAYER;
    readings = [...readings.slice(0, newReadings.from), ...newReadings.taken];
    built = built.slice(0, layers.from * HEX_PER_LAYER) + layers.built;
    view.total = total;
    // Layers of a simulated tip are reported again with the position of the plastic. So the picture may be out of date
    // even if the number of layers is unchanged.
    stale ||= layers.built.length > 0;
    if (timer === null && stale) rebuild();
    if (builtName) find("#built-name").textContent = builtName;
    showState(update);
    find("#progress").value = total > 0 ? laid / total : 1;
    find("#laid").textContent = `${laid} of ${total} layers`;
    find("#remaining").textContent = result ? "" : remainingText(update);
    drawTemperatureChart(find("#temperature"), readings);
    document.title = `${total > 0 ? Math.floor((100 * laid) / total) : 100} % · ${title}`;
    if (result) {
      source.close();
      showResult(result);
    }
  };
  source.onerror = () => {
    const isClosed = source.readyState === EventSource.CLOSED;
    const lost = "Cannot reach growbot: it has ended, or the connection is lost. Retrying…";
    showProblem(isClosed ? "This growth is no longer available at this URL." : lost);
  };
  source.onopen = () => showProblem("");

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
  find("#command-pause").hidden = isPaused;
  find("#command-continue").hidden = !isPaused;
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
  find("#commands").hidden = true;
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

/** Sends a command to the growth. */
async function sendCommand(command) {
  try {
    const response = await fetch(`commands/${command}`, { method: "POST" });
    showProblem(response.ok ? "" : `${command} was rejected: ${await response.text()}`, "#command-problem");
  } catch (error) {
    const remedy = "use the robot's own emergency stop, or `growbot estop`";
    showProblem(`${command} did not reach growbot (${error.message}): ${remedy}`, "#command-problem");
  }
}
