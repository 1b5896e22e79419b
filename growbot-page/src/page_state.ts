// The state that the page shows: what the service has sent, and what the person has selected. Components read the
// signals and are drawn again when they change.

import { computed, signal } from "@preact/signals";
import { STALE_MS } from "../../growbot-pictures/viewer/src/connection.js";
import type { Job, RecoverySequence, RobotStatus } from "./api_types";

/** A robot: its latest status, the time of its board's latest report, and since when a stop is not confirmed. */
export interface Robot {
  status: RobotStatus;
  /** Null if the board has not reported. */
  reportedAt: number | null;
  /** Null if no stop is pending. */
  stopPendingSince: number | null;
}

/** Robots by name, in the order of the service. */
export const robots = signal<ReadonlyMap<string, Robot>>(new Map());
/** Guided sequences of the robots that need a person, by the names of the robots. */
export const recoveries = signal<Readonly<Record<string, RecoverySequence>>>({});
/** The latest jobs, newest first. Null before the service has sent them. */
export const jobs = signal<Job[] | null>(null);
/** Reason why the list of jobs is not current. */
export const jobsProblem = signal("");
/** True if this URL can send commands, false if it is read-only. Null until the service has responded. */
export const canControl = signal<boolean | null>(null);
/** Time of the service's latest message. Null before the first message. */
export const heardAt = signal<number | null>(null);
/** True if the connection to the service is lost. */
export const isLost = signal(false);
/** True if the service refuses the token of this page. */
export const isExpired = signal(false);
/** Current time. Updated often enough for the ages on the page. */
export const now = signal(performance.now());
/** Fragment of the page's URL, which selects a robot. */
export const fragment = signal(location.hash);
/** Result of the latest command to each robot. */
export const messages = signal<ReadonlyMap<string, Message>>(new Map());

export interface Message {
  text: string;
  isError: boolean;
}

export const fragmentOf = (name: string) => `#${encodeURIComponent(name)}`;

/** The robot whose page is shown. Null if the page shows all robots. */
export const selectedName = computed(() => {
  const names = [...robots.value.keys()];
  return names.length === 1 ? names[0] : names.find((name) => fragmentOf(name) === fragment.value) ?? null;
});

/** Names of the robots that the emergency stop of the page stops. */
export const stopTargets = computed(() =>
  selectedName.value === null ? [...robots.value.keys()] : [selectedName.value]);

/** True if the service has been silent for too long. */
export const isServiceSilent = computed(() => heardAt.value === null || now.value - heardAt.value > STALE_MS);

/** Returns the age of a robot's status, ms. Null if the board has not reported. */
export const ageMs = ({ reportedAt }: Robot) => (reportedAt === null ? null : Math.max(0, now.value - reportedAt));

/** Returns whether the status of a robot is too old to be current. */
export function isStale(robot: Robot): boolean {
  const age = ageMs(robot);
  return isServiceSilent.value || age === null || age > STALE_MS;
}

export function showMessage(name: string, text: string, isError = false): void {
  messages.value = new Map(messages.value).set(name, { text, isError });
}

/** Sets the latest status of robots. The service sent them `age` ms ago. */
export function setRobots(statuses: RobotStatus[], age = 0): void {
  const next = new Map(robots.value);
  for (const status of statuses) {
    const at = performance.now();
    const since = next.get(status.name)?.stopPendingSince ?? at;
    next.set(status.name, {
      status,
      reportedAt: status.status_age_s === null ? null : at - age - 1000 * status.status_age_s,
      stopPendingSince: status.pending_stop ? since : null,
    });
  }
  robots.value = next;
}

/** Sets the ages of the statuses, s by name. The service sent them `age` ms ago. */
export function setAges(ages: Record<string, number | null>, age: number): void {
  const next = new Map(robots.value);
  for (const [name, seconds] of Object.entries(ages)) {
    const robot = next.get(name);
    if (!robot) continue;
    next.set(name, { ...robot, reportedAt: seconds === null ? null : performance.now() - age - 1000 * seconds });
  }
  robots.value = next;
}
