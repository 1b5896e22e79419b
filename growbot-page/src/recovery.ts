// Guided sequences: which one a robot has, how far the person is, and what a step does.

import { signal } from "@preact/signals";
import { CONFIRM_MS } from "../../growbot-pictures/viewer/src/connection.js";
import type { RecoveryAction, RecoverySequence, RecoveryStep } from "./api_types";
import { canControl, isStale, now, recoveries, robots } from "./page_state";
import type { Robot } from "./page_state";
import { giveCommand, resumableJob, resume, runTask } from "./robot_commands";

/** Difference to the target below which the nozzle counts as hot, °C. */
const HOT_WITHIN_C = 5;
const GROWING = ["heating", "homing", "growing"];

/** Labels of the buttons of the actions. */
export const ACTION_LABELS: Record<RecoveryAction, string> = {
  "clear-fault": "Clear fault", continue: "Continue growth", resume: "Resume body", stop: "Stop job",
  cancel: "Discard the body", "withdraw-stop": "Withdraw the stop", preheat: "Heat nozzle", load: "Load filament",
  purge: "Purge nozzle", cooldown: "Cool nozzle",
};

/** A sequence and the number of its steps that are done. */
export interface RecoveryProgress {
  sequence: RecoverySequence;
  done: number;
}

/** Sequences of which a step is done, by the names of the robots. */
const begun = signal<ReadonlyMap<string, RecoveryProgress>>(new Map());

function setProgress(name: string, progress: RecoveryProgress | null): void {
  const next = new Map(begun.value);
  if (progress) next.set(name, progress);
  else next.delete(name);
  begun.value = next;
}

/** Ends the sequences of robots that grow again, or whose new situation interrupts the one of the sequence. */
export function endRecoveries(): void {
  for (const [name, { sequence }] of begun.value) {
    const status = robots.value.get(name)?.status;
    const reported = recoveries.value[name];
    const isInterrupted = reported?.interrupts && reported.situation !== sequence.situation;
    if (isInterrupted || (status?.job && GROWING.includes(status.state ?? ""))) setProgress(name, null);
  }
}

/** Returns the sequence of a robot. One that has begun goes on although its steps change the situation. */
export function recoveryOf({ status, stopPendingSince }: Robot): RecoveryProgress | null {
  const reported = recoveries.value[status.name];
  const own = begun.value.get(status.name);
  if (own) return own;
  // Every stop is unconfirmed for a moment.
  const isNew = stopPendingSince === null || now.value - stopPendingSince < CONFIRM_MS;
  if (!reported || (reported.situation === "unconfirmed-stop" && isNew)) return null;
  return { sequence: reported, done: 0 };
}

/** Ends the sequence of a robot before its end. */
export const leaveRecovery = (name: string) => setProgress(name, null);

/** Returns the reason why a step cannot be done now, empty if it can. */
export function stepBlockedBy(robot: Robot, { action, effect }: RecoveryStep): string {
  const { temperature_c: celsius, target_c: target } = robot.status;
  if (canControl.value !== true) return "This URL is read-only.";
  if (action && action !== "stop" && action !== "withdraw-stop" && isStale(robot)) {
    return "The state of the robot is not current.";
  }
  if (action === "resume" && !resumableJob(robot)) {
    return "The service has no job of this body: use `growbot resume` with its run log.";
  }
  if (effect === "moves" && target === null) return "The heater is off: heat the nozzle first.";
  if (effect === "moves" && target !== null && (celsius === null || celsius < target - HOT_WITHIN_C)) {
    return `The nozzle is at ${celsius?.toFixed(0) ?? "?"} of ${target.toFixed(0)} °C.`;
  }
  return "";
}

function carryOut(robot: Robot, action: RecoveryAction): Promise<boolean> {
  const { status } = robot;
  switch (action) {
    case "resume": {
      const job = resumableJob(robot);
      return job ? resume(job) : Promise.resolve(false);
    }
    case "preheat": case "load": case "purge": case "cooldown": return runTask(status, action, "");
    default: return giveCommand(status.name, action);
  }
}

/** Carries out the next step of a sequence. The sequence goes on once the robot has accepted it. */
export async function doStep(robot: Robot, { sequence, done }: RecoveryProgress): Promise<void> {
  const { action } = sequence.steps[done];
  if (action && !await carryOut(robot, action)) return;
  setProgress(robot.status.name, done + 1 < sequence.steps.length ? { sequence, done: done + 1 } : null);
}

/** Carries out the step that replaces all others. */
export async function doAlternative(robot: Robot, action: RecoveryAction): Promise<void> {
  if (await carryOut(robot, action)) leaveRecovery(robot.status.name);
}
