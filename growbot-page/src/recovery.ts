// Guided sequences: which one a robot has, how far the person is, and what a step does.

import { signal } from "@preact/signals";
import { CONFIRM_MS } from "../../growbot-pictures/viewer/src/connection.js";
import type { RecoveryAction, RecoverySequence, RecoveryStep } from "./api_types";
import { canControl, isStale, now, recoveries, robots } from "./page_state";
import type { Robot } from "./page_state";
import { giveCommand, resumableJob, resume, runAction, runTask, tune } from "./robot_commands";
import { request } from "./service";

/** Difference to the target below which the nozzle counts as hot, °C. */
const HOT_WITHIN_C = 5;

/** Labels of the buttons of the actions. */
export const ACTION_LABELS: Record<RecoveryAction, string> = {
  "clear-fault": "Clear fault", continue: "Continue growth", resume: "Resume body", stop: "Stop job",
  cancel: "Discard the body", "withdraw-stop": "Withdraw the stop", preheat: "Heat nozzle", load: "Load filament",
  purge: "Purge nozzle", cooldown: "Cool nozzle", "dry-run": "Motors on", home: "Turn head", jog: "Push filament",
  tune: "Tune heater",
};

/** Sequences that a person begins, by their situations, with the labels of their buttons. */
export const PROCEDURES: [string, string][] = [["calibration", "Calibrate"], ["commissioning", "Commission"]];
const isProcedure = (situation: string) => PROCEDURES.some(([name]) => name === situation);

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

/** Situations to which the steps of another situation lead. */
const LATER_SITUATIONS: Record<string, (string | undefined)[]> = {
  "no-filament": [undefined, "maintenance", "unfinished"],
};

/** Ends the sequences of robots whose situation or its cause has changed otherwise than by a step. */
export function endRecoveries(): void {
  for (const [name, { sequence }] of begun.value) {
    if (isProcedure(sequence.situation)) {
      if (robots.value.get(name)?.status.job) setProgress(name, null);
      continue;
    }
    const reported = recoveries.value[name];
    const isSame = reported?.situation === sequence.situation && reported.cause === sequence.cause;
    if (!isSame && !LATER_SITUATIONS[sequence.situation]?.includes(reported?.situation)) setProgress(name, null);
  }
}

/** Returns the sequence of a robot, with what is safe now. */
export function recoveryOf({ status, stopPendingSince }: Robot): RecoveryProgress | null {
  const reported = recoveries.value[status.name];
  const own = begun.value.get(status.name);
  const isPaused = own && reported?.interrupts && isProcedure(own.sequence.situation);
  if (own && !isPaused) {
    const { sequence } = own;
    return { ...own, sequence: { ...sequence, safety: reported?.safety ?? sequence.safety } };
  }
  // Every stop is unconfirmed for a moment.
  const isNew = stopPendingSince === null || now.value - stopPendingSince < CONFIRM_MS;
  if (!reported || (reported.situation === "unconfirmed-stop" && isNew)) return null;
  return { sequence: reported, done: 0 };
}

/** Begins calibration or commissioning. Its steps are those of the service. */
export async function beginProcedure(robot: string, situation: string, label: string): Promise<void> {
  await runAction(robot, label, async () => {
    const sequences = await request<RecoverySequence[]>("procedures");
    const sequence = sequences.find((procedure) => procedure.situation === situation);
    if (sequence) setProgress(robot, { sequence, done: 0 });
    return "Nothing is switched on yet: follow the steps above";
  });
}

/** Returns whether a person can leave a sequence before its end. */
export const isLeavable = ({ sequence, done }: RecoveryProgress) => done > 0 || isProcedure(sequence.situation);

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
  // In a dry run the motors move with the heater off.
  const isDryRun = action === "dry-run" || (robot.status.state === "maintenance" && target === null);
  if (effect !== "moves" || isDryRun) return "";
  if (target === null) return "The heater is off: heat the nozzle first.";
  if (celsius === null || celsius < target - HOT_WITHIN_C) {
    return `The nozzle is at ${celsius?.toFixed(0) ?? "?"} of ${target.toFixed(0)} °C.`;
  }
  return "";
}

function carryOut(robot: Robot, action: RecoveryAction, value: string): Promise<boolean> {
  const { status } = robot;
  switch (action) {
    case "resume": {
      const job = resumableJob(robot);
      return job ? resume(job) : Promise.resolve(false);
    }
    case "tune": return tune(status);
    case "preheat": case "load": case "purge": case "cooldown": case "dry-run": case "home": case "jog":
      return runTask(status, action, value);
    default: return giveCommand(status.name, action);
  }
}

/** Names of the robots of which a step is under way. */
export const pendingSteps = signal<ReadonlySet<string>>(new Set());

/** Carries out an action unless a step of the robot is under way. Returns whether the robot has accepted it. */
async function carryOutOnce(robot: Robot, action: RecoveryAction, value = ""): Promise<boolean> {
  const { name } = robot.status;
  if (pendingSteps.value.has(name)) return false;
  pendingSteps.value = new Set(pendingSteps.value).add(name);
  try {
    return await carryOut(robot, action, value);
  } finally {
    pendingSteps.value = new Set([...pendingSteps.value].filter((other) => other !== name));
  }
}

/** Carries out the next step of a sequence. The sequence goes on once the robot has accepted it. */
export async function doStep(robot: Robot, { sequence, done }: RecoveryProgress): Promise<void> {
  const { name } = robot.status;
  const { action, value } = sequence.steps[done];
  const before = begun.value.get(name);
  if (action && !await carryOutOnce(robot, action, value)) return;
  // The sequence may have ended meanwhile.
  if (begun.value.get(name) !== before) return;
  setProgress(name, done + 1 < sequence.steps.length ? { sequence, done: done + 1 } : null);
}

/** Carries out the step that replaces all others. */
export async function doAlternative(robot: Robot, action: RecoveryAction): Promise<void> {
  if (await carryOutOnce(robot, action)) leaveRecovery(robot.status.name);
}
