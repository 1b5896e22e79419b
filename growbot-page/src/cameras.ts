// The cameras of robots: the current picture, and the pictures of the layers of a job.

import { signal } from "@preact/signals";
import { readResponse, retryDelay } from "../../growbot-pictures/viewer/src/connection.js";
import type { Job } from "./api_types";
import { isExpired } from "./page_state";
import { API, request, robotPath } from "./service";

/** Time between two pictures, ms. */
const PERIOD_MS = 1_000;
const TIMEOUT_MS = 15_000;
/** Time after which a failed request for the names is repeated, ms. */
const RETRY_MS = 10_000;

/** Names of the robots that have a camera. */
export const cameras = signal<ReadonlySet<string>>(new Set());
/** The job whose pictures a person has chosen, by robot. Without an entry it is the latest one. */
export const picturedJobs = signal<ReadonlyMap<string, Job>>(new Map());
/** Number of choices so far. Each moves the focus to the pictures, once. */
export const choices = signal(0);
let shownChoice = 0;

/** The latest picture of a camera. */
export interface CameraPicture {
  /** Empty before the first picture. */
  url: string;
  /** Time at which it arrived. */
  at: number;
  /** Reason why there is no newer picture. Empty if there is one. */
  problem: string;
}

/** Requests the names of the robots that have a camera. */
export async function refreshCameras(): Promise<void> {
  if (isExpired.value) return;
  try {
    cameras.value = new Set(await request<string[]>("cameras"));
  } catch {
    setTimeout(() => void refreshCameras(), RETRY_MS);
  }
}

/** Requests a picture after the other while the page is visible. Returns a function that ends this. */
export function followCamera(robot: string, onPicture: (picture: CameraPicture) => void): () => void {
  const ended = new AbortController();
  let current: CameraPicture = { url: "", at: 0, problem: "" };
  let attempt = 0;
  let timer: ReturnType<typeof setTimeout> | undefined;
  const show = (next: CameraPicture) => {
    if (current.url && current.url !== next.url) URL.revokeObjectURL(current.url);
    current = next;
    onPicture(current);
  };
  const readNext = async () => {
    let pause = PERIOD_MS;
    try {
      if (!document.hidden && !isExpired.value) {
        const url = await readPicture(robot, ended.signal);
        if (ended.signal.aborted) return URL.revokeObjectURL(url);
        show({ url, at: performance.now(), problem: "" });
      }
      attempt = 0;
    } catch (error) {
      if (ended.signal.aborted) return;
      show({ ...current, problem: (error as Error).message });
      pause = retryDelay(attempt);
      attempt += 1;
    }
    timer = setTimeout(() => void readNext(), pause);
  };
  void readNext();
  return () => {
    ended.abort();
    clearTimeout(timer);
    if (current.url) URL.revokeObjectURL(current.url);
  };
}

/** Requests a picture, and returns a URL of it in this page. */
async function readPicture(robot: string, ended: AbortSignal): Promise<string> {
  const signal = AbortSignal.any([ended, AbortSignal.timeout(TIMEOUT_MS)]);
  const response = await fetch(`${API}${robotPath(robot)}/camera`, { signal });
  if (!response.ok) await readResponse(response);
  return URL.createObjectURL(await response.blob());
}

/** Requests the layers of a job of which there are pictures. */
export const readSnapshots = (job: Job) => request<number[]>(`jobs/${job.id}/snapshots`);

export const snapshotUrl = (job: Job, layer: number) => `${API}jobs/${job.id}/snapshots/${layer}`;

/** Shows the pictures of a job, or again those of the latest one if it is null. */
export function showPictures(robot: string, job: Job | null): void {
  const next = new Map(picturedJobs.value);
  if (job) next.set(robot, job);
  else next.delete(robot);
  picturedJobs.value = next;
  if (job) choices.value += 1;
}

/** Returns whether the latest choice has not been shown yet, and notes that it is shown. */
export function takeChoice(): boolean {
  const isNew = shownChoice !== choices.value;
  shownChoice = choices.value;
  return isNew;
}
