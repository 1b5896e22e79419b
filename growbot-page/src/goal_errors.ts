// Distances of finished bodies from their goals. The list of jobs does not have them, so they are read from the last
// line of each run log, one log at a time.

import { signal } from "@preact/signals";
import type { Job } from "./api_types";
import { isExpired } from "./page_state";
import { API } from "./service";

/** Numbers of lines of a run log for each layer. A log is read after the largest number that its last line exceeds. */
const LINES_PER_LAYER = [20, 8, 2, 1, 0];
const TIMEOUT_MS = 10_000;

/** Distances by job, mm. Null if the run log has none. */
export const goalErrors = signal<ReadonlyMap<string, number | null>>(new Map());
let isReading = false;

/** Reads the distances of these jobs that are done and not known yet. */
export async function readGoalErrors(jobs: Job[]): Promise<void> {
  if (isReading) return;
  isReading = true;
  try {
    for (const job of jobs) {
      if (isExpired.value) break;
      if (job.state !== "done" || goalErrors.value.has(job.id)) continue;
      // A log that cannot be read has none.
      const distance = await readGoalError(job).catch(() => null);
      goalErrors.value = new Map(goalErrors.value).set(job.id, distance);
    }
  } finally {
    isReading = false;
  }
}

async function readGoalError(job: Job): Promise<number | null> {
  for (const factor of LINES_PER_LAYER) {
    const url = `${API}jobs/${job.id}/events?after=${factor * job.laid}`;
    const response = await fetch(url, { signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (!response.ok) throw new Error(`HTTP status ${response.status}`);
    const lines = (await response.text()).split("\n").filter((line) => line.startsWith("data:"));
    const end = lines.reverse().find((line) => line.includes('"event":"end"'));
    if (end) return JSON.parse(end.slice("data:".length)).result?.position_error_mm ?? null;
  }
  return null;
}
