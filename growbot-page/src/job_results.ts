// Results of finished bodies: their distances from the goal. The list of jobs does not have them, so they are read from
// the last line of each run log, one log at a time.

import { signal } from "@preact/signals";
import type { Job } from "./api_types";
import { isExpired } from "./page_state";
import { API } from "./service";

/** Numbers of lines of a run log for each layer. A log is read after the largest number that its last line exceeds. */
const LINES_PER_LAYER = [20, 8, 2, 1, 0];
const TIMEOUT_MS = 10_000;

/** The part of a growth's result that the page shows. */
interface JobResult {
  position_error_mm: number | null;
}

/** Results by job. Null if the run log has none. */
export const results = signal<ReadonlyMap<string, JobResult | null>>(new Map());
let isReading = false;

/** Reads the results of these jobs that are done and not known yet. */
export async function readResults(wanted: Job[]): Promise<void> {
  if (isReading) return;
  isReading = true;
  try {
    for (const job of wanted) {
      if (isExpired.value) break;
      if (job.state !== "done" || results.value.has(job.id)) continue;
      // A log that cannot be read now is read again with the next list of jobs.
      const result = await readResult(job).catch(() => undefined);
      if (result === undefined) continue;
      results.value = new Map(results.value).set(job.id, result);
    }
  } finally {
    isReading = false;
  }
}

async function readResult(job: Job): Promise<JobResult | null> {
  for (const factor of LINES_PER_LAYER) {
    const url = `${API}jobs/${job.id}/events?after=${factor * job.laid}`;
    const response = await fetch(url, { signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (!response.ok) throw new Error(`HTTP status ${response.status}`);
    const lines = (await response.text()).split("\n").filter((line) => line.startsWith("data:"));
    const end = lines.reverse().find((line) => line.includes('"event":"end"'));
    if (end) return JSON.parse(end.slice("data:".length)).result ?? null;
  }
  return null;
}
