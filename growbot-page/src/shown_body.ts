// The body that the 3D view of each robot shows.

import { signal } from "@preact/signals";
import type { Job } from "./api_types";
import { API } from "./service";

/** A body that a person has chosen, in place of the growing or the latest one. */
export interface ChosenBody {
  title: string;
  url: string;
  /** True if the goal in the view can be dragged. */
  isGoalDraggable?: boolean;
  /** True if the page scrolls to the body, because its command is far below. */
  isScrolledTo?: boolean;
}

/** Chosen bodies by the name of the robot. */
export const chosenBodies = signal<ReadonlyMap<string, ChosenBody>>(new Map());

export function chooseBody(robot: string, body: ChosenBody | null): void {
  const next = new Map(chosenBodies.value);
  if (body) next.set(robot, body);
  else next.delete(robot);
  chosenBodies.value = next;
}

/** Shows the planned body of a job and the one as built. */
export function compareJob(job: Job): void {
  chooseBody(job.robot, { title: `${job.name}: planned and as built`, url: jobViewUrl(job.id), isScrolledTo: true });
}

export const jobViewUrl = (id: string) => `${API}jobs/${id}/view`;
export const liveUrl = (id: string) => `${API}jobs/${id}/live/`;
export const planViewUrl = (viewPath: string) => `${API}${viewPath}`;
