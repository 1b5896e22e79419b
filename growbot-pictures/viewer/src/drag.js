// Dragging the goal of a plan. The goal moves in the plane of the picture. The page around this one plans on the way, and
// the path to the dragged goal is drawn. The fields of that page do the same by keyboard.

import { onPath, sendGoal } from "./embedding.js";
import { makeTrace } from "./marks.js";

/** Greatest distance from the goal at which a drag begins, pixels of the page. */
const REACH = { mouse: 12, touch: 24 };

/** Lets a person drag the goal on this stage. `ball` is at the goal, and moves with it. */
export function makeGoalDraggable(stage, ball) {
  const canvas = stage.controls.domElement;
  let [goal, pointer, path] = [ball.position.toArray(), null, null];

  const pointOf = ({ clientX, clientY }) => {
    const { left, top } = canvas.getBoundingClientRect();
    return [clientX - left, clientY - top];
  };
  const isNear = (event) => {
    const [x, y] = pointOf(event);
    const [goalX, goalY] = stage.toScreen(goal);
    return Math.hypot(x - goalX, y - goalY) < (event.pointerType === "touch" ? REACH.touch : REACH.mouse);
  };
  // Before the camera's controls, which must not turn the picture at the same time.
  canvas.addEventListener("pointerdown", (event) => {
    if (pointer !== null || event.button !== 0 || !isNear(event)) return;
    pointer = event.pointerId;
    canvas.setPointerCapture(pointer);
    stage.controls.enabled = false;
  }, { capture: true });
  canvas.addEventListener("pointermove", (event) => {
    if (pointer === null) canvas.style.cursor = isNear(event) ? "move" : "";
    if (pointer !== event.pointerId) return;
    goal = stage.fromScreen(pointOf(event), { depthOf: goal });
    ball.position.fromArray(goal);
    stage.redraw();
    sendGoal(goal, false);
  });
  const drop = (event) => {
    if (pointer !== event.pointerId) return;
    pointer = null;
    stage.controls.enabled = true;
    sendGoal(goal, true);
  };
  canvas.addEventListener("pointerup", drop);
  canvas.addEventListener("pointercancel", drop);
  onPath((points) => {
    if (path) {
      path.geometry.dispose();
      path.material.dispose();
      stage.scene.remove(path);
    }
    path = makeTrace(points, ball.material.color);
    stage.scene.add(path);
    stage.redraw();
  });
}
