// Plans while a person drags the goal in the 3D view. Each path is planned without the scene, which takes too long to
// follow a hand. The preview after the drop avoids it.

import type { PlanResponse } from "./api_types";
import type { Target } from "./goal";
import { enter, formOf, plansPath, preview, requestOf } from "./next_body";
import type { NextBodyForm } from "./next_body";
import { request } from "./service";
import type { GoalMessage } from "./viewer_messages";

type DrawPath = (points: PlanResponse["centreline_mm"]) => void;

const TIMEOUT_MS = 5_000;
/** Paths that are planned for a drag, by the name of the robot. */
const drags = new Map<string, AbortController>();
/** Goals as they were typed before a drag, and as the drag has entered them last, by the name of the robot. */
const typedTargets = new Map<string, { typed: Target; entered: Target }>();

function targetAt({ fields, anyDirection }: Target, [x, y, z]: [number, number, number]): Target {
  const [xText, yText, zText] = [x, y, z].map((part) => part.toFixed(1));
  return { fields: { ...fields, x: xText, y: yText, z: zText }, anyDirection };
}

/**
 * Enters the dragged goal, or the typed one again if the drag is cancelled. Draws a path to it on the way, and previews
 * the body when the goal is dropped.
 */
export function dragGoal(robot: string, { position, isDropped }: GoalMessage, draw: DrawPath): void {
  const { source, target } = formOf(robot);
  if (source !== "goal") return;
  const before = typedTargets.get(robot);
  // A drag that has not ended may be that of an earlier goal.
  const typed = before?.entered === target ? before.typed : target;
  const entered = position ? targetAt(target, position) : typed;
  typedTargets.set(robot, { typed, entered });
  enter(robot, { target: entered });
  const drag = drags.get(robot);
  if (isDropped) {
    typedTargets.delete(robot);
    drag?.abort();
    drags.delete(robot);
    // The body that is planned may be another one, or there may be none.
    draw([]);
    void preview(robot);
  } else if (!drag) {
    const started = new AbortController();
    drags.set(robot, started);
    void drawPaths(robot, draw, started.signal);
  }
}

/** Draws the path to the goal that is entered, until the path to the latest goal is drawn or the drag has ended. */
async function drawPaths(robot: string, draw: DrawPath, end: AbortSignal): Promise<void> {
  let planned = -1;
  while (formOf(robot).revision !== planned) {
    const form = formOf(robot);
    planned = form.revision;
    // Some goals on the way have no path.
    const points = await pathTo(robot, form, end).catch(() => []);
    if (end.aborted) return;
    draw(points);
  }
  drags.delete(robot);
}

/** Returns the centreline of the body that is entered, without its scene. */
async function pathTo(robot: string, form: NextBodyForm, end: AbortSignal): Promise<PlanResponse["centreline_mm"]> {
  const outline = await requestOf({ ...form, scene: null, ignoreScene: false });
  const signal = AbortSignal.any([end, AbortSignal.timeout(TIMEOUT_MS)]);
  return (await request<PlanResponse>(`${plansPath(robot)}&page=none`, outline, { signal })).centreline_mm;
}
