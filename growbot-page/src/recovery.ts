// Guided sequences: which one a robot has, how far the person is, and what a step does.

import { signal } from "@preact/signals";
import { CONFIRM_MS } from "../../growbot-pictures/viewer/src/connection.js";
import type { Procedure, RecoveryAction, RecoverySequence, RecoveryStep, RobotStatus } from "./api_types";
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

/** Procedures that a person begins, with the labels of their buttons. */
export const PROCEDURES: [Procedure["name"], string][] = [
  ["calibration", "Calibrate"], ["commissioning", "Commission"],
];

/** A sequence and the number of its steps that are done. */
export interface RecoveryProgress {
  sequence: RecoverySequence;
  done: number;
  /** The procedure whose sequence it is. `undefined` if the sequence follows from the state of the robot. */
  procedure?: Procedure;
}

/** Sequences of which a step is done, by the names of the robots. */
const begun = signal<ReadonlyMap<string, RecoveryProgress>>(new Map());

/** Procedures that a person has begun, by the names of the robots. */
const procedures = signal<ReadonlyMap<string, { procedure: Procedure; done: number }>>(new Map());

function withEntry<T>(map: ReadonlyMap<string, T>, name: string, entry: T | null): ReadonlyMap<string, T> {
  const next = new Map(map);
  if (entry) next.set(name, entry);
  else next.delete(name);
  return next;
}

function setProgress(name: string, progress: RecoveryProgress | null): void {
  begun.value = withEntry(begun.value, name, progress);
}

function setProcedure(name: string, procedure: Procedure | null, done = 0): void {
  procedures.value = withEntry(procedures.value, name, procedure && { procedure, done });
}

/** Situations to which the steps of another situation lead. */
const LATER_SITUATIONS: Record<string, (string | undefined)[]> = {
  "no-filament": [undefined, "maintenance", "unfinished"],
};

/**
 * Ends the sequences of robots whose situation or its cause has changed otherwise than by a step, and the procedures of
 * robots that grow or are not connected.
 */
export function endRecoveries(): void {
  for (const name of procedures.value.keys()) {
    const isLost = recoveries.value[name]?.situation === "disconnected";
    if (isLost || robots.value.get(name)?.status.job) setProcedure(name, null);
  }
  for (const [name, { sequence }] of begun.value) {
    const reported = recoveries.value[name];
    const isSame = reported?.situation === sequence.situation && reported.cause === sequence.cause;
    if (!isSame && !LATER_SITUATIONS[sequence.situation]?.includes(reported?.situation)) setProgress(name, null);
  }
}

/** Actions that switch on what a step needs that moves. */
const SWITCHING_ON: (RecoveryAction | null | undefined)[] = ["dry-run", "preheat"];

/** Returns whether a robot has switched off what a step needs that moves. */
const isOff = ({ state, target_c: target }: RobotStatus) => state !== "maintenance" && target === null;

/**
 * Returns the next step of a procedure of which a number of steps are done: that step, or the earlier one that switches
 * on what it needs, if that has gone off meanwhile.
 */
function reachedStep(steps: RecoveryStep[], done: number, status: RobotStatus): number {
  const { action, effect } = steps[done];
  if (effect !== "moves" || SWITCHING_ON.includes(action) || !isOff(status)) return done;
  const switchingOn = steps.slice(0, done).findLastIndex((step) => SWITCHING_ON.includes(step.action));
  return switchingOn < 0 ? done : switchingOn;
}

/** Returns the sequence of a robot, with what is safe now. */
export function recoveryOf({ status, stopPendingSince }: Robot): RecoveryProgress | null {
  const reported = recoveries.value[status.name];
  const own = begun.value.get(status.name);
  if (own) return { ...own, sequence: { ...own.sequence, safety: reported?.safety ?? own.sequence.safety } };
  const begunProcedure = procedures.value.get(status.name);
  // What needs a person first comes before the procedure, which then goes on.
  if (begunProcedure && !reported?.interrupts && reported?.situation !== "tuning") {
    const { procedure } = begunProcedure;
    const done = reachedStep(procedure.steps, begunProcedure.done, status);
    const { name: situation, cause, safety, steps } = procedure;
    const shared = { situation, cause, steps, interrupts: false, alternative: null };
    return { procedure, done, sequence: { ...shared, safety: reported?.safety ?? safety } };
  }
  // Every stop is unconfirmed for a moment.
  const isNew = stopPendingSince === null || now.value - stopPendingSince < CONFIRM_MS;
  if (!reported || (reported.situation === "unconfirmed-stop" && isNew)) return null;
  return { sequence: reported, done: 0 };
}

/** Begins calibration or commissioning of a robot that is off. Its steps are those of the service. */
export async function beginProcedure(status: RobotStatus, name: Procedure["name"], label: string): Promise<void> {
  const robot = status.name;
  await runAction(robot, label, async () => {
    if (!isOff(status)) throw new Error("The heater or the motors are on: run the task Cool down first");
    const all = await request<Procedure[]>("procedures");
    setProcedure(robot, all.find((procedure) => procedure.name === name) ?? null);
    return "Nothing is switched on yet: follow the steps above";
  });
}

/** Returns whether a person can leave a sequence before its end. */
export const isLeavable = ({ procedure, done }: RecoveryProgress) => done > 0 || procedure !== undefined;

/** Ends the sequence of a robot before its end. */
export function leaveRecovery(name: string, { procedure }: RecoveryProgress): void {
  if (procedure) setProcedure(name, null);
  else setProgress(name, null);
}

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
export async function doStep(robot: Robot, progress: RecoveryProgress): Promise<void> {
  const { sequence, done, procedure } = progress;
  const { name } = robot.status;
  const { action, value } = sequence.steps[done];
  const [begunBefore, procedureBefore] = [begun.value.get(name), procedures.value.get(name)];
  if (action && !await carryOutOnce(robot, action, value)) return;
  const isEnd = done + 1 === sequence.steps.length;
  // The sequence may have ended meanwhile.
  if (procedure) {
    if (procedures.value.get(name) === procedureBefore) setProcedure(name, isEnd ? null : procedure, done + 1);
  } else if (begun.value.get(name) === begunBefore) {
    setProgress(name, isEnd ? null : { sequence, done: done + 1 });
  }
}

/** Carries out the step that replaces all others. */
export async function doAlternative(robot: Robot, action: RecoveryAction): Promise<void> {
  if (await carryOutOnce(robot, action)) setProgress(robot.status.name, null);
}
