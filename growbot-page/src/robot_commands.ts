// Commands that a person gives to a robot on the page, and which of them are possible.

import { signal } from "@preact/signals";
import type { CommandName, CommandResponse, Job, RobotStatus } from "./api_types";
import { formatTitle } from "./format";
import { sendCommand, sendOrder } from "./orders";
import { isStale, jobs, robots, setRobots, showMessage } from "./page_state";
import type { Robot } from "./page_state";
import { ask } from "./question";
import type { Question } from "./question";
import { refreshJobs } from "./job_list";
import { robotPath } from "./service";

/** Runs an action for a robot and shows its result. Returns whether it succeeded. */
export async function runAction(name: string, label: string, action: () => Promise<string | void>): Promise<boolean> {
  showMessage(name, `${label} …`);
  try {
    showMessage(name, await action() || `${label}: done`);
    return true;
  } catch (error) {
    showMessage(name, (error as Error).message, true);
    return false;
  }
}

/** Shows the status in the response to a command, and returns its message. */
function takeResponse({ message, ...status }: CommandResponse): string {
  setRobots([status]);
  return message.charAt(0).toUpperCase() + message.slice(1);
}

/** Runs a maintenance task. In a pause of its job, the growth does it later, with the default lengths. */
export function runTask({ name }: RobotStatus, task: string, value: string): Promise<boolean> {
  const label = formatTitle(task);
  return runAction(name, label, async () => {
    const path = `${robotPath(name)}/maintenance`;
    return takeResponse(await sendOrder<CommandResponse>(`${label} of ${name}`, path, { task, value }));
  });
}

/** Tunes the heater at the temperature of growth. Returns whether the board has begun. */
export function tune({ name }: RobotStatus): Promise<boolean> {
  return runAction(name, "Tune heater", async () =>
    takeResponse(await sendOrder<CommandResponse>(`Tune the heater of ${name}`, `${robotPath(name)}/tuning`, {})));
}

/** Questions before commands that destroy something. */
const questions: Partial<Record<CommandName, (robot: RobotStatus) => Question>> = {
  cancel: ({ name, laid, layers }) => ({
    title: `Discard the body of ${name}?`,
    text: `The board deletes its ${laid} of ${layers} layers. The body cannot be resumed after that.`,
    action: "Discard body", destroys: true,
  }),
  "withdraw-stop": ({ name }) => ({
    title: `Withdraw the stop of ${name}?`,
    text: "The board has not confirmed the stop, so the robot may still be on. The service will not send the stop "
      + "again.",
    action: "Withdraw stop", destroys: true,
  }),
};

/** Gives a command after its question, if it has one. Returns whether the robot has carried it out. */
export async function giveCommand(name: string, command: CommandName): Promise<boolean> {
  const robot = robots.value.get(name);
  const question = questions[command];
  if (question && (!robot || !await ask(question(robot.status)))) return false;
  return runAction(name, formatTitle(command), async () => takeResponse(await sendCommand(name, command)));
}

/** Response of a robot to the latest stop of all robots. */
export interface StopResponse {
  robot: string;
  text: string;
  state: "waiting" | "stopped" | "failed";
}

/** Responses to the latest stop of all robots. Null if there was none, or if they are closed. */
export const stopResponses = signal<StopResponse[] | null>(null);

/** Number of the latest stop of several robots. Responses to other stops are not listed. */
let latestStop = 0;

/** Sends the emergency stop to these robots, at once to all. Ends with their responses. */
export async function stopRobots(names: string[]): Promise<void> {
  const isListed = names.length > 1;
  if (isListed) latestStop += 1;
  const stop = latestStop;
  const respond = (response: StopResponse) => { if (isListed && stop === latestStop) setStopResponse(response); };
  if (isListed) {
    stopResponses.value = names.map((robot) => ({ robot, text: "no response yet", state: "waiting" }));
  }
  await Promise.all(names.map((name) => runAction(name, "Emergency stop", async () => {
    try {
      const response = await sendCommand(name, "emergency-stop");
      respond({ robot: name, text: "off, confirmed by the board", state: "stopped" });
      return takeResponse(response);
    } catch (error) {
      respond({ robot: name, text: (error as Error).message, state: "failed" });
      throw error;
    }
  })));
}

function setStopResponse(response: StopResponse): void {
  const others = stopResponses.value;
  if (others) stopResponses.value = others.map((other) => (other.robot === response.robot ? response : other));
}

/** Returns whether each command is possible in the robot's state. Of a stale state only stops and pauses follow. */
export function allowedCommands(robot: Robot): Record<Exclude<CommandName, "emergency-stop">, boolean> {
  const { status } = robot;
  const isStateStale = isStale(robot);
  const isKnown = status.connection !== "disconnected" && !isStateStale;
  const isPaused = status.state === "paused" || status.state === "parked";
  const isOff = Boolean(status.fault) || status.state === "emergency-stop";
  return {
    pause: Boolean(status.job) && (isStateStale || !isPaused),
    stop: true,
    continue: isKnown && Boolean(status.job) && isPaused,
    "clear-fault": isKnown && isOff && !status.job,
    cancel: isKnown && !status.job && status.laid < status.layers,
    "withdraw-stop": Boolean(status.pending_stop),
  };
}

/** Returns the job of the body that the board of a robot has, which can be resumed. `undefined` if it has none. */
export function resumableJob(robot: Robot): Job | undefined {
  const { status } = robot;
  const isOff = Boolean(status.fault) || status.state === "emergency-stop";
  const isReady = status.connection === "ready" && !isStale(robot) && !status.job;
  if (!isReady || isOff || status.layers === 0 || status.laid >= status.layers) return undefined;
  const latest = jobs.value?.find((job) => job.robot === status.name && !(job.state === "failed" && job.laid === 0));
  return latest?.state === "interrupted" ? latest : undefined;
}

/** Resumes a job on the robot that has its body. Returns whether the service has accepted the order. */
export function resume(job: Job): Promise<boolean> {
  return runAction(job.robot, "Resume", async () => {
    await sendOrder(`Resume on ${job.robot}`, `jobs/${job.id}/resume`, {});
    void refreshJobs();
  });
}
