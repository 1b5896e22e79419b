// Orders to robots. An order that is not confirmed in time raises a red banner with what to do.

import {
  CONFIRM_MS, RejectionError, openCommands, sendUntilAnswered,
} from "../../growbot-pictures/viewer/src/connection.js";
import type { CommandName, CommandResponse } from "./api_types";
import { showBanner } from "./banners";
import type { BannerHandle } from "./banners";
import { formatTitle } from "./format";
import { API, clock, request, robotPath } from "./service";

/** Socket for commands. Null on a read-only page, and until the page has started. */
let commands: ReturnType<typeof openCommands> | null = null;

/** Opens the socket for commands. */
export function startCommands(): void {
  commands ??= openCommands(`${API}commands`);
}

/** Closes that socket for good. Commands are requests until it is opened again. */
export function stopCommands(): void {
  commands?.stop();
  commands = null;
}

const CUT_POWER = "Cut the robot's power now, or run `growbot estop` on its machine.";

/** Returns what to do about an order that is not confirmed. */
function remedy(isStop: boolean): string {
  return isStop
    ? `${CUT_POWER} This page keeps sending the stop.`
    : "It is unknown whether the robot carries it out. If it must stop, press Emergency stop, run `growbot estop` on "
      + "its machine, or cut its power.";
}

/** Connects an order that is being sent to its banner. */
interface OrderSignals {
  onFailure?(error: Error): void;
  isClosed?(): boolean;
}

/**
 * Waits for the response to an order with this name. Shows a banner while there is none after 2 s, if an attempt has
 * failed, and if the service has rejected a stop.
 */
async function confirmOrder<T>(name: string, isStop: boolean, response: Promise<T>, signals: OrderSignals): Promise<T> {
  const start = performance.now();
  let banner: BannerHandle | null = null;
  let cause = "";
  const update = () => {
    const seconds = Math.round((performance.now() - start) / 1000);
    const text = `${name}: not confirmed after ${seconds} s${cause && ` (${cause})`}. ${remedy(isStop)}`;
    if (banner) banner.setText(text);
    else banner = showBanner(text);
  };
  const isClosed = () => banner !== null && !banner.isOpen();
  let interval: ReturnType<typeof setInterval> | undefined;
  const timer = setTimeout(() => {
    update();
    interval = setInterval(update, 1_000);
  }, CONFIRM_MS);
  signals.onFailure = (error) => { cause = error.message; update(); };
  signals.isClosed = isClosed;
  const opened = () => banner as BannerHandle | null;
  try {
    const result = await response;
    opened()?.close();
    return result;
  } catch (error) {
    const isRejected = error instanceof RejectionError;
    if (isRejected && !isStop) opened()?.close();
    else if (!isClosed()) {
      const text = `${name}: ${(error as Error).message}. ${isRejected ? CUT_POWER : remedy(isStop)}`;
      if (opened()) opened()?.setText(text);
      else showBanner(text);
    }
    throw error;
  } finally {
    clearTimeout(timer);
    clearInterval(interval);
  }
}

/** Sends a command to a robot. Returns its result with the robot's status after it. */
export function sendCommand(robot: string, command: CommandName): Promise<CommandResponse> {
  const signals: OrderSignals = {};
  const isStop = command === "stop" || command === "emergency-stop";
  const name = `${formatTitle(command)} of ${robot}`;
  // The time is that of this call, because a request may wait in the browser.
  const timeMs = isStop ? undefined : clock.now();
  const message = { robot, command, time_ms: timeMs };
  const post = (signal?: AbortSignal) =>
    request<CommandResponse>(`${robotPath(robot)}/commands`, { command }, { timeMs, signal });
  const send = () => (commands?.isOpen ? commands.send(message) : post());
  const sendStop = () => sendUntilAnswered({
    commands, command: message, post,
    onFailure: (error: Error) => signals.onFailure?.(error),
    isClosed: () => signals.isClosed?.() ?? false,
  });
  // The signals are set before the first attempt can fail.
  const response = Promise.resolve().then(isStop ? sendStop : send) as Promise<CommandResponse>;
  return confirmOrder(name, isStop, response, signals);
}

/** Sends another order, which was given at `timeMs`, by a request. */
export function sendOrder<T>(name: string, path: string, body: unknown, timeMs = clock.now()): Promise<T> {
  return confirmOrder(name, false, request<T>(path, body, { timeMs }), {});
}
