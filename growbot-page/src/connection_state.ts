// Messages of the service, and whether the data on the page are current.

import { computed, signal } from "@preact/signals";
import { RejectionError, retryDelay } from "../../growbot-pictures/viewer/src/connection.js";
import type { RecoverySequence, RobotStatus } from "./api_types";
import { showBanner } from "./banners";
import type { BannerHandle } from "./banners";
import { refreshJobs } from "./job_list";
import { startCommands, stopCommands } from "./orders";
import {
  canControl, heardAt, isExpired, isLost, isServiceSilent, jobsProblem, now, recoveries, setAges, setRobots,
} from "./page_state";
import { endRecoveries } from "./recovery";
import { addReadings } from "./temperature_history";
import { clock, followService, request } from "./service";
import type { ServiceMessage } from "./service";

const JOBS_REFRESH_MS = 10_000;
/** Interval at which the ages on the page are updated. */
const AGE_MS = 500;
let expiredBanner: BannerHandle | null = null;
let lastStates = "";
/** True once the service has sent its robots. */
const areRobotsKnown = signal(false);

/** Text about the connection to the service. */
export const connectionText = computed(() => {
  if (isExpired.value) return "No access";
  const silence = heardAt.value === null ? null : Math.round((now.value - heardAt.value) / 1000);
  const age = silence === null ? "No data yet" : `No data for ${silence} s`;
  if (isServiceSilent.value && (silence !== null || isLost.value)) {
    return isLost.value ? `${age}, connecting again…` : age;
  }
  if (isLost.value) return "Connection lost, connecting again…";
  return heardAt.value === null || !areRobotsKnown.value ? "Connecting… If this stays, reload." : "Live";
});

/** Shows that the service refuses the token of this page, so that it gets no data and cannot send commands. */
function expire(): void {
  stopCommands();
  isExpired.value = true;
  expiredBanner ??= showBanner("The service refuses this page, mostly because it has restarted: open the address that "
    + "`growbot serve` prints. Until then, stop robots with `growbot estop` on their machine, or cut their power.");
}

/** Uses the page again, because another page of the browser was opened with the new token. */
function renew(): void {
  if (!isExpired.value) return;
  isExpired.value = false;
  expiredBanner?.close();
  expiredBanner = null;
  if (canControl.value) startCommands();
}

function onMessage({ event, data, ageMs = 0 }: ServiceMessage): void {
  isLost.value = event === "lost";
  if (event === "expired") expire();
  else if (!isLost.value) renew();
  if (data) heardAt.value = Math.max(heardAt.value ?? 0, performance.now() - ageMs);
  if (event === "heartbeat") {
    const { time_ms: timeMs, status_age_s: ages } = data as { time_ms: number; status_age_s: Record<string, number> };
    clock.set(timeMs, ageMs);
    setAges(ages, ageMs);
  } else if (event === "robots") {
    const statuses = data as RobotStatus[];
    setRobots(statuses, ageMs);
    areRobotsKnown.value = true;
    addReadings(statuses);
    const states = statuses.map((robot) => `${robot.job} ${robot.state}`).join();
    if (states !== lastStates) void refreshJobs();
    lastStates = states;
  } else if (event === "recovery") recoveries.value = data as Record<string, RecoverySequence>;
  endRecoveries();
  now.value = performance.now();
}

/** Requests the rights of this URL until the service responds. */
async function requestAccess(): Promise<void> {
  for (let failures = 0; canControl.value === null; failures += 1) {
    try {
      const access = await request<{ can_control: boolean }>("access");
      canControl.value = access.can_control;
    } catch (error) {
      const isRefused = error instanceof RejectionError && error.status !== 503;
      const { message } = error as Error;
      jobsProblem.value = isRefused
        ? `The service does not know this address (${message}): open the one that \`growbot serve\` prints`
        : `The service does not respond (${message}): connecting again`;
      await new Promise((resolve) => { setTimeout(resolve, retryDelay(failures)); });
    }
  }
  if (canControl.value) startCommands();
  void refreshJobs();
}

/** Connects the page to the service. */
export function connect(): void {
  // A page that the browser had frozen has lost its connections.
  window.addEventListener("pageshow", ({ persisted }) => { if (persisted) location.reload(); });
  followService(onMessage);
  setInterval(() => { now.value = performance.now(); }, AGE_MS);
  setInterval(() => void refreshJobs(), JOBS_REFRESH_MS);
  void requestAccess();
}
