// Notifications of the browser while a person looks at something else.

import { effect, signal } from "@preact/signals";
import { formatTitle } from "./format";
import { fragmentOf, robots } from "./page_state";
import { recoveryOf } from "./recovery";

const STORED = "growbot-notifications";
/** Time after the opening of the page in which it gets the present state of all robots. */
const OPENING_MS = 5_000;

/** True if the browser can show notifications of this page. */
export const canNotify = window.isSecureContext && "Notification" in window;
/** Reason why the browser shows no notifications of this page. Empty if there is none. */
export const notificationProblem = signal(
  canNotify ? "" : "This browser notifies only pages from https addresses, or from its own machine.");
/** True if a person wants notifications in this browser. */
export const isNotified = signal(canNotify && localStorage.getItem(STORED) === "on"
  && Notification.permission === "granted");

/** Turns notifications in this browser on or off. The browser asks the person for permission. */
export async function setNotified(wanted: boolean): Promise<void> {
  const isAllowed = wanted && await Notification.requestPermission() === "granted";
  isNotified.value = isAllowed;
  localStorage.setItem(STORED, isAllowed ? "on" : "off");
  notificationProblem.value = wanted && !isAllowed
    ? "The browser refuses notifications of this page: allow them in its settings for this address." : "";
}

/** What a person wants to know of a robot: a condition, empty if there is none, and the job that it grows. */
interface Seen {
  condition: string;
  text: string;
  job: string | null;
}

let before: ReadonlyMap<string, Seen> | null = null;

function look(): ReadonlyMap<string, Seen> {
  return new Map([...robots.value].map(([name, robot]) => {
    const { status } = robot;
    const recovery = recoveryOf(robot);
    if (recovery) {
      const { situation, cause } = recovery.sequence;
      const text = `${formatTitle(situation)}: ${cause}`;
      return [name, { condition: `${situation} ${cause}`, text, job: status.job }];
    }
    const isLost = status.connection === "disconnected";
    const text = isLost ? `The service cannot reach the robot: ${status.connection_error ?? "no response"}` : "";
    return [name, { condition: isLost ? "lost" : "", text, job: status.job }];
  }));
}

function show(name: string, text: string, job: string | null): void {
  if (!isNotified.value || (document.visibilityState === "visible" && document.hasFocus())) return;
  try {
    // Pages of one browser show a notification once, because its tag is the same.
    const shown = new Notification(name, { body: text, tag: `growbot ${name} ${text} ${job}` });
    shown.onclick = () => {
      window.focus();
      location.hash = fragmentOf(name);
    };
  } catch {
    isNotified.value = false;
    notificationProblem.value = "This browser shows no notifications of pages.";
  }
}

/** Notifies a person of each new condition of a robot, and of each end of a growth without one. */
export function startNotifications(): void {
  effect(() => {
    const now = look();
    const earlier = before;
    before = now;
    // What a page finds when it opens is not new.
    if (!earlier?.size || performance.now() < OPENING_MS) return;
    for (const [name, { condition, text, job }] of now) {
      const last = earlier.get(name);
      if (condition && condition !== last?.condition) show(name, text, job);
      else if (!condition && last?.job && !job) show(name, "The growth has ended.", last.job);
    }
  });
}
