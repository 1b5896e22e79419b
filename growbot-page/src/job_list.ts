// The list of jobs of the service.

import type { Job, RobotStatus } from "./api_types";
import { isExpired, jobs, jobsProblem } from "./page_state";
import { request } from "./service";

const MAX_JOBS = 100;
let isRefreshing = false;

/** Requests the latest jobs. One request at a time, so that a frozen service gets no pile of them. */
export async function refreshJobs(): Promise<void> {
  if (isRefreshing || isExpired.value) return;
  isRefreshing = true;
  try {
    jobs.value = await request<Job[]>(`jobs?limit=${MAX_JOBS}`);
    jobsProblem.value = "";
  } catch (error) {
    jobsProblem.value = `The history is not current: ${(error as Error).message}`;
  } finally {
    isRefreshing = false;
  }
}

/** Returns the job of the last body of a robot, if a body can begin at its tip: the board has it, and it is at rest. */
export function continuableJob({ name, plan_id, laid, interrupted }: RobotStatus): Job | undefined {
  const last = jobs.value?.find((job) => job.robot === name && job.laid > 0);
  const isOnBoard = plan_id !== null && last?.laid === laid && interrupted === null;
  return isOnBoard && last?.state !== "active" ? last : undefined;
}

/** Returns the plan with which a job was grown, and whether feedback was on. Reads the first line of its run log. */
export async function readJobPlan(job: Job): Promise<{ plan: unknown; feedback: boolean; ignoreScene: boolean }> {
  const line = await readFirstLine(new URL(`api/v1/jobs/${job.id}/log`, location.href).href);
  const header = JSON.parse(line);
  if (!header.plan) throw new Error(`the run log of ${job.name} has no plan: plan the goal again`);
  return { plan: header.plan, feedback: Boolean(header.feedback), ignoreScene: Boolean(header.ignore_scene) };
}

async function readFirstLine(url: string): Promise<string> {
  const response = await fetch(url);
  if (!response.ok || !response.body) throw new Error(`the run log cannot be read (HTTP status ${response.status})`);
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  while (!text.includes("\n")) {
    const { value, done } = await reader.read();
    if (done) break;
    text += value;
  }
  await reader.cancel();
  return text.slice(0, text.indexOf("\n") < 0 ? undefined : text.indexOf("\n"));
}
