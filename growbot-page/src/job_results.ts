// Results of finished bodies: their distances from the goal, and their tips. The list of jobs does not have them, so
// they are read from the last line of each run log, one log at a time.

import { signal } from "@preact/signals";
import type { Job } from "./api_types";
import { formatNumber } from "./format";
import { isExpired, jobs } from "./page_state";
import { API } from "./service";

/** Numbers of lines of a run log for each layer. A log is read after the largest number that its last line exceeds. */
const LINES_PER_LAYER = [20, 8, 2, 1, 0];
const TIMEOUT_MS = 10_000;

/** Pose of a tip. The heading is null for a tip that points straight up or down. */
interface TipPose {
  x_mm: number;
  y_mm: number;
  z_mm: number;
  heading_deg: number | null;
  pitch_deg: number;
}

/** The part of a growth's result that the page shows. */
interface JobResult {
  position_error_mm: number | null;
  final: TipPose | null;
}

/** The tip of a finished body: its job, and its pose in the frame of its robot. */
export interface Tip {
  jobId: string;
  /** Name of the job. */
  job: string;
  /** X, Y, Z in mm, heading and pitch in degrees. */
  pose: number[];
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
      // A log that cannot be read has none.
      const result = await readResult(job).catch(() => null);
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

/** Returns the tip of the robot's latest body. Null unless that body is done and its result has been read. */
export function latestTip(robot: string): Tip | null {
  const job = jobs.value?.find((latest) => latest.robot === robot);
  const final = job?.state === "done" ? results.value.get(job.id)?.final : null;
  if (!job || !final) return null;
  const { x_mm: x, y_mm: y, z_mm: z, heading_deg: heading, pitch_deg: pitch } = final;
  return { jobId: job.id, job: job.name, pose: [x, y, z, heading ?? 0, pitch] };
}

/** Returns whether a tip is that of the robot's latest body. */
export const isLatestTip = (robot: string, tip: Tip) =>
  jobs.value?.find((latest) => latest.robot === robot)?.id === tip.jobId;

/** Returns a tip for a person. */
export const poseText = ({ pose: [x, y, z, heading, pitch] }: Tip) =>
  `${[x, y, z].map((part) => formatNumber(part, 1)).join(", ")} mm, heading ${formatNumber(heading, 1)}°, `
    + `pitch ${formatNumber(pitch, 1)}°`;
