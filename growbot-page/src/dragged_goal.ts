// Plans while a person drags the goal in the 3D view. Each path is planned without the scene, which takes too long to
// follow a hand. The preview after the drop avoids it.

import type { PlanResponse } from "./api_types";
import type { Target } from "./goal";
import { enter, formOf, plansPath, preview, requestOf } from "./next_body";
import type { NextBodyForm } from "./next_body";
import { request } from "./service";
import type { GoalMessage } from "./viewer_messages";

type DrawPath = (points: PlanResponse["centreline_mm"]) => void;

/** Robots for whose dragged goal a path is being planned. */
const planning = new Set<string>();

function targetAt({ fields, anyDirection }: Target, [x, y, z]: GoalMessage["position"]): Target {
  const [xText, yText, zText] = [x, y, z].map((part) => part.toFixed(1));
  return { fields: { ...fields, x: xText, y: yText, z: zText }, anyDirection };
}

/** Enters the dragged goal. Draws a path to it on the way, and previews the body when the goal is dropped. */
export function dragGoal(robot: string, { position, isDropped }: GoalMessage, draw: DrawPath): void {
  const { source, target } = formOf(robot);
  if (source !== "goal") return;
  enter(robot, { target: targetAt(target, position) });
  if (isDropped) void preview(robot);
  else void drawLatest(robot, draw);
}

/** Draws the path to the goal that is entered, until the path to the latest goal is drawn. */
async function drawLatest(robot: string, draw: DrawPath): Promise<void> {
  if (planning.has(robot)) return;
  planning.add(robot);
  let planned = -1;
  while (formOf(robot).revision !== planned) {
    const form = formOf(robot);
    planned = form.revision;
    draw(await pathTo(robot, form).catch(() => []));
  }
  planning.delete(robot);
}

/** Returns the centreline of the body that is entered, without its scene. Fails if there is no path to its goal. */
async function pathTo(robot: string, form: NextBodyForm): Promise<PlanResponse["centreline_mm"]> {
  const outline = await requestOf({ ...form, scene: null, ignoreScene: false });
  return (await request<PlanResponse>(`${plansPath(robot)}&page=none`, outline)).centreline_mm;
}
