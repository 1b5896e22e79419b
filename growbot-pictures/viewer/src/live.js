// A running growth: the view of its plan, to which the board's reports add layers, with state, progress, temperature
// and commands.
//
// Updates are server-sent events (growbot-host/src/watch/). Each contains the changes since the last one, with layers
// and readings from an index on.

import { decodeLayers, growBody } from "./body.js";
import { drawReadings } from "./chart.js";
import { joinOne } from "./one.js";
import { durationText, fillNumbers, finishText } from "./text.js";

const find = (selector) => document.querySelector(selector);
const HEX_PER_LAYER = 24;
/** Greatest share of the time that may be spent on building the body. */
const SHARE = 0.2;

const STATE_NAMES = { "emergency-stop": "emergency stop" };

/** Shows the growth, and returns its pictures. */
export function showLive(data) {
  const view = joinOne({ ...data, built: "" });
  find("#live").hidden = false;
  find("#orders").hidden = !data.live.control;
  const title = document.title;

  let built = "";
  let readings = [];
  let timer = null;
  let stale = false;
  const grow = () => {
    timer = null;
    stale = false;
    const began = performance.now();
    view.replaceBuilt(growBody(data.start, decodeLayers(built)));
    const took = performance.now() - began;
    timer = setTimeout(() => {
      timer = null;
      if (stale) grow();
    }, took / SHARE);
  };

  const source = new EventSource("updates");
  source.onmessage = ({ data: text }) => {
    const update = JSON.parse(text);
    const { layers, readings: taken, total, ended, built_name: builtName } = update;
    const laid = layers.from + layers.built.length / HEX_PER_LAYER;
    readings = [...readings.slice(0, taken.from), ...taken.taken];
    built = built.slice(0, layers.from * HEX_PER_LAYER) + layers.built;
    view.total = total;
    // Layers of a simulated tip are reported again with the position of the plastic. So the picture may be out of date
    // even if the number of layers is unchanged.
    stale ||= layers.built.length > 0;
    if (timer === null && stale) grow();
    if (builtName) find("#built-name").textContent = builtName;
    showState(update);
    find("#progress").value = total > 0 ? laid / total : 1;
    find("#laid").textContent = `${laid} of ${total} layers`;
    find("#left").textContent = ended ? "" : leftText(update);
    drawReadings(find("#temperature"), readings);
    document.title = `${total > 0 ? Math.floor((100 * laid) / total) : 100} % · ${title}`;
    if (ended) {
      source.close();
      end(ended);
    }
  };
  source.onerror = () => {
    const gone = source.readyState === EventSource.CLOSED;
    showProblem(gone ? "This growth is no longer served at this address." : "growbot does not answer: it has ended, or the connection is cut. Trying again…");
  };
  source.onopen = () => showProblem("");

  document.querySelectorAll("[data-order]").forEach((button) => {
    button.addEventListener("click", () => give(button.dataset.order));
  });
  return [view.picture];
}

/** Returns the text of the remaining time, with the time of the end if it is known. */
function leftText({ left_s: left, finish_in_s: finish, state }) {
  const time = `${durationText(left)} ${state === "growing" ? "left" : "of growing left"}`;
  return finish === null || finish === undefined ? time : `${time}, done at ${finishText(new Date(), finish)}`;
}

function showState({ state, answers, explanation, refused, warned }) {
  const badge = find("#state");
  badge.textContent = STATE_NAMES[state] ?? state;
  badge.dataset.state = state;
  find("#explanation").textContent = explanation ?? "";
  // Filament is changed during a pause.
  find("#filament").hidden = find("#orders").hidden || state !== "paused";
  const waits = ["paused", "parked"].includes(state);
  find("#order-pause").hidden = waits;
  find("#order-continue").hidden = !waits;
  showProblem(warned ?? "", "#log-problem");
  showProblem(answers ? (refused ?? "") : "The board does not answer: growbot calls it again.");
}

/**
 * Shows a problem of the growth or the connection. Another place is for a problem of a command, which updates do not
 * remove.
 */
function showProblem(text, place = "#problem") {
  const problem = find(place);
  problem.textContent = text;
  problem.hidden = text === "";
}

/** Shows the result of the growth and the final pose of the tip. */
function end(result) {
  const badge = find("#state");
  badge.textContent = result.outcome;
  badge.dataset.state = result.outcome;
  find("#orders").hidden = true;
  find("#filament").hidden = true;
  if (result.error) showProblem(result.error);
  const drift = result.clock_drift;
  if (drift) showProblem(`It was stopped: ${drift.message}; ${drift.remedy}.`);
  if (!result.measured_by) return;
  const by = result.measured_by === "steps" ? "steps say" : `${result.measured_by} says`;
  const rows = [
    ["From the goal", `${result.position_error_mm.toFixed(3)} mm`],
    ["Of the length", `${(100 * result.normalized_position_error).toFixed(4)} %`],
    ["Off its direction", `${result.direction_error_deg.toFixed(3)}°`],
  ];
  fillNumbers(find("#ended"), [[`Arrived, as the ${by}`, rows]]);
}

async function give(order) {
  try {
    const answer = await fetch(`orders/${order}`, { method: "POST" });
    showProblem(answer.ok ? "" : `${order} was refused: ${await answer.text()}`, "#order-problem");
  } catch (error) {
    showProblem(`${order} did not reach growbot (${error.message}): use the robot's own emergency stop, or \`growbot estop\``, "#order-problem");
  }
}
