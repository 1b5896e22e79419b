// The bodies that wait for each robot.

import { signal } from "@preact/signals";
import type { Job, QueuedBody } from "./api_types";
import { confirmGrowth } from "./growth_question";
import { refreshJobs } from "./job_list";
import { requestOf } from "./next_body";
import type { NextBodyForm } from "./next_body";
import { sendOrder } from "./orders";
import { isExpired } from "./page_state";
import { runAction } from "./robot_commands";
import { clock, request, robotPath } from "./service";
import { chooseBody } from "./shown_body";

/** Bodies that wait, by the names of the robots. The next one is first. */
export const queues = signal<ReadonlyMap<string, QueuedBody[]>>(new Map());

/** Problem of reading the queue of a robot. Empty if there is none. */
export const queueProblem = signal("");

/** Returns what a growth does besides its plan. Empty if that is nothing. */
export function optionsText(
  { feedback, force, ignore_scene: ignoresScene }: Pick<QueuedBody, "feedback" | "force" | "ignore_scene">,
): string {
  const texts = [
    feedback && "with feedback", force && "despite its warnings",
    ignoresScene && "ignoring the scene: the body may collide",
  ];
  return texts.filter(Boolean).join(", ");
}

const queuePath = (robot: string) => `${robotPath(robot)}/queue`;

function setQueue(robot: string, bodies: QueuedBody[]): void {
  queues.value = new Map(queues.value).set(robot, bodies);
}

/** Requests the queue of a robot. A queue that cannot be read stays as it was. */
export async function refreshQueue(robot: string): Promise<void> {
  if (isExpired.value) return;
  try {
    setQueue(robot, await request<QueuedBody[]>(queuePath(robot)));
    queueProblem.value = "";
  } catch (error) {
    queueProblem.value = `The queue is not current: ${(error as Error).message}`;
  }
}

/** Adds what is entered in this form to the queue of a robot. Nothing is heated or moved. */
export function enqueue(robot: string, form: NextBodyForm): Promise<boolean> {
  return runAction(robot, "Add to queue", async () => {
    const body = await request<QueuedBody>(queuePath(robot), await requestOf(form));
    void refreshQueue(robot);
    return `${body.name} waits in the queue`;
  });
}

export function moveQueuedToFront(robot: string, body: QueuedBody): Promise<boolean> {
  return runAction(robot, "To front", async () => {
    setQueue(robot, await request<QueuedBody[]>(`${queuePath(robot)}/${body.id}/front`, {}));
    return `${body.name} is the next body of the queue`;
  });
}

export function removeQueued(robot: string, body: QueuedBody): Promise<boolean> {
  return runAction(robot, "Remove", async () => {
    setQueue(robot, await request<QueuedBody[]>(`${queuePath(robot)}/${body.id}/remove`, {}));
    return `${body.name} is removed from the queue`;
  });
}

/** Grows a queued body, after a person has confirmed that the last one is removed. */
export async function growQueued(robot: string, body: QueuedBody): Promise<void> {
  const { name, layers, duration_s: durationS } = body;
  const growth = { title: `Grow ${name} on ${robot}?`, layers, durationS, options: optionsText(body) };
  if (!await confirmGrowth(robot, growth)) return;
  const timeMs = clock.now();
  await runAction(robot, "Grow", async () => {
    const path = `${queuePath(robot)}/${body.id}/grow`;
    const job = await sendOrder<Job>(`Grow on ${robot}`, path, { last_body_removed: true }, timeMs);
    chooseBody(robot, null);
    void refreshQueue(robot);
    void refreshJobs();
    return `Job ${job.id} started`;
  });
}
