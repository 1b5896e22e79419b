// Orders to robots. An order that is not confirmed in time raises a red banner with what to do.

import { CONFIRM_MS, RejectionError, openCommands, sendUntilAnswered } from "./connection.js";
import { API, clock, request } from "./service.js";

const STOPS = ["emergency-stop", "stop"];
/** Socket for commands. Null on a read-only page, and until the page has started. */
let commands = null;

/** Opens the socket for commands. */
export function startCommands() {
  commands ??= openCommands(`${API}commands`);
}

/** Closes that socket for good. Commands are requests until it is opened again. */
export function stopCommands() {
  commands?.stop();
  commands = null;
}

/** Shows a banner with a text at the bottom of the window, where it moves nothing. */
export function showBanner(text) {
  const element = document.createElement("p");
  const words = document.createElement("span");
  const close = document.createElement("button");
  close.type = "button";
  close.textContent = "Close";
  close.addEventListener("click", () => element.remove());
  element.append(words, close);
  const banner = { element, setText: (next) => { if (words.textContent !== next) words.textContent = next; } };
  banner.setText(text);
  document.getElementById("banners").append(element);
  return banner;
}

const CUT_POWER = "Cut the robot's power now, or run `growbot estop` on its machine.";

/** Returns what to do about an order that is not confirmed. */
function remedy(isStop) {
  return isStop
    ? `${CUT_POWER} This page keeps sending the stop.`
    : "It is unknown whether the robot carries it out. If it must stop, press Emergency stop, run `growbot estop` on "
      + "its machine, or cut its power.";
}

/**
 * Waits for the response to an order with this name. Shows a banner while there is none after 2 s, if an attempt has
 * failed, and if the service has rejected a stop.
 */
async function confirmOrder(name, isStop, response, signals) {
  const start = performance.now();
  let banner = null;
  let cause = "";
  const update = () => {
    const seconds = Math.round((performance.now() - start) / 1000);
    const text = `${name}: not confirmed after ${seconds} s${cause && ` (${cause})`}. ${remedy(isStop)}`;
    banner ??= showBanner(text);
    banner.setText(text);
  };
  let interval = null;
  const timer = setTimeout(() => {
    update();
    interval = setInterval(update, 1_000);
  }, CONFIRM_MS);
  const close = () => { clearTimeout(timer); clearInterval(interval); };
  signals.onFailure = (error) => { cause = error.message; update(); };
  signals.isClosed = () => banner !== null && !banner.element.isConnected;
  try {
    const result = await response;
    banner?.element.remove();
    return result;
  } catch (error) {
    const isRejected = error instanceof RejectionError;
    if (isRejected && !isStop) banner?.element.remove();
    else if (!signals.isClosed()) {
      banner ??= showBanner("");
      banner.setText(`${name}: ${error.message}. ${isRejected ? CUT_POWER : remedy(isStop)}`);
    }
    throw error;
  } finally {
    close();
  }
}

/** Sends a command to a robot. Returns the robot's status after it. */
export function sendCommand(robot, command) {
  const signals = {};
  const isStop = STOPS.includes(command);
  const name = `${command.replaceAll("-", " ")} of ${robot}`;
  // The time is that of this call, because a request may wait in the browser.
  const timeMs = isStop ? undefined : clock.now();
  const message = { robot, command, time_ms: timeMs };
  const post = (signal) => request(`robots/${encodeURIComponent(robot)}/commands`, { command }, { timeMs, signal });
  const send = () => (commands?.isOpen ? commands.send(message) : post());
  const sendStop = () => sendUntilAnswered({
    commands, command: message, post,
    onFailure: (error) => signals.onFailure(error),
    isClosed: () => signals.isClosed(),
  });
  // The signals are set before the first attempt can fail.
  const response = Promise.resolve().then(isStop ? sendStop : send);
  return confirmOrder(name[0].toUpperCase() + name.slice(1), isStop, response, signals);
}

/** Sends another order, which was given at `timeMs`, by a request. */
export function sendOrder(name, path, body, timeMs = clock.now()) {
  return confirmOrder(name, false, request(path, body, { timeMs }), {});
}
