// Dragging the goal of a plan. The goal moves in the plane of the picture. The page around this one plans on the way,
// and the path to the dragged goal is drawn. Its fields are for the keyboard.

import { canDragGoal, onPath, sendGoal } from "./embedding.js";
import { makeTrace } from "./marks.js";

/** Greatest distance from the goal at which a drag begins, pixels of the page. */
const REACH = { mouse: 12, touch: 24 };
/** Distance from the press at which a drag begins, pixels of the page. A click moves nothing. */
const MIN_MOVE = 4;

/** Lets a person drag the goal on this stage. `ball` is at the goal, and moves with it. */
export function makeGoalDraggable(stage, ball) {
  const canvas = stage.controls.domElement;
  const planned = ball.position.toArray();
  // The press that may become a drag, and the path that is drawn.
  let [press, path] = [null, null];
  stage.restoreView();

  const pointOf = ({ clientX, clientY }) => {
    const { left, top } = canvas.getBoundingClientRect();
    return [clientX - left, clientY - top];
  };
  const distance = ([x, y], [otherX, otherY]) => Math.hypot(x - otherX, y - otherY);
  const isNear = (event) => canDragGoal()
    && distance(pointOf(event), stage.toScreen(planned)) < (event.pointerType === "touch" ? REACH.touch : REACH.mouse);
  const moveTo = (goal) => {
    ball.position.fromArray(goal);
    stage.redraw();
  };
  const drawPath = (points) => {
    if (path) {
      path.geometry.dispose();
      path.material.dispose();
      stage.scene.remove(path);
    }
    path = makeTrace(points, ball.material.color);
    stage.scene.add(path);
    stage.redraw();
  };
  // Before the camera's controls, which must not turn the picture at the same time.
  canvas.addEventListener("pointerdown", (event) => {
    if (press || !event.isPrimary || event.button !== 0 || !isNear(event)) return;
    press = { id: event.pointerId, at: pointOf(event), hasMoved: false };
    canvas.setPointerCapture(press.id);
    stage.controls.enabled = false;
  }, { capture: true });
  canvas.addEventListener("pointermove", (event) => {
    if (!press) canvas.style.cursor = isNear(event) ? "move" : "";
    if (press?.id !== event.pointerId) return;
    press.hasMoved ||= distance(pointOf(event), press.at) >= MIN_MOVE;
    if (!press.hasMoved) return;
    moveTo(stage.fromScreen(pointOf(event), { depthOf: planned }));
    sendGoal(ball.position.toArray(), false);
  });
  const release = (event) => {
    if (press?.id !== event.pointerId) return;
    const { hasMoved } = press;
    press = null;
    stage.controls.enabled = true;
    if (!hasMoved) return;
    // A system gesture gives the goal back.
    const isCancelled = event.type === "pointercancel";
    if (isCancelled) moveTo(planned);
    stage.keepView();
    sendGoal(isCancelled ? null : ball.position.toArray(), true);
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  onPath(drawPath);
}
