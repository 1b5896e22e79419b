// The picture of a body: the tube with its marks, labels, legend and scale bar.
//
// The picture is in an element of the page with the class `stage`, which contains a canvas, `.labels`, `.legend`,
// `.scale` and `.no-picture`. The code uses nothing outside of that element, so a page can have several stages.

import { Box3, Vector3 } from "three";
import { gradient } from "./colours.js";
import { makeGoalDraggable } from "./drag.js";
import { hasDraggableGoal } from "./embedding.js";
import { makeArrow, makeBall, makeCentreline, makeFloor, makeShadow, makeTipFrame, makeTrace } from "./marks.js";
import { makeObstacles } from "./obstacles.js";
import { makeReach } from "./reach.js";
import { makeStage } from "./stage.js";
import { scaleLength } from "./text.js";
import { makeGhost, makeTube, heightRange, heightsBeyond, PERCENTILES } from "./tube.js";

/** Room for more layers, as a factor, once a body is longer than its plan. */
const GROWTH = 1.25;

const pointAlong = (from, direction, length) => from.map((part, k) => part + direction[k] * length);

/**
 * Makes the picture of `subject` (see subject.js) in `container`. Without WebGL it returns null and shows a note.
 * `range` is the range of the colours and `square` the size of the floor's squares, mm. By default both are chosen for
 * the body.
 *
 * - `show(layers)`: shows this number of layers.
 * - `replaceBody(body)`: replaces the body, for example by a longer one. The view stays, and `show` sets the visible
 *   part.
 * - `setVisible({ built, planned, commanded, estimated })`: shows or hides the body as built, the planned body, the
 *   commanded path and the path that feedback estimated.
 * - `setSceneVisible(isVisible)`: shows or hides the obstacles.
 * - `setReachVisible(isVisible)`: shows or hides the positions within reach, and shows everything from a corner.
 * - `setFollowing(isFollowing)`: keeps the tip in the middle, or not.
 * - `setViewpoint(viewpoint)`: shows everything from `corner`, `front`, `side` or `top`.
 * - `applyTheme()`: applies the colours of the page.
 * - `stage`: see stage.js.
 */
export function makePicture(container, subject, { range, square } = {}) {
  try {
    return buildPicture(container, subject, range, square);
  } catch (error) {
    console.warn(`no picture: ${error.message}`);
    container.querySelector(".no-picture").hidden = false;
    container.querySelectorAll(".legend, .scale").forEach((part) => {
      part.hidden = true;
    });
    return null;
  }
}

function buildPicture(container, subject, range, square) {
  const { start, goal, via, reached, commanded, estimated, planned, built, existing, sizes } = subject;
  const find = (selector) => container.querySelector(selector);
  let body = built ?? planned;
  let shown = body.layers.count;

  const labels = [];
  const stage = makeStage(find("canvas"), (drawnStage) => {
    for (const { element, at } of labels) {
      const [right, y] = drawnStage.toScreen(at());
      // Labels stay within the picture.
      const x = Math.min(right, find("canvas").clientWidth - element.offsetWidth - 12);
      element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(8px, -50%)`;
    }
    showScale(find(".scale"), drawnStage.millimetresPerPixel());
    container.dataset.drawn ??= Math.round(performance.now()).toString();
  });
  const { scene } = stage;
  const label = (text, at, colour) => {
    const element = document.createElement("span");
    element.className = "label";
    element.textContent = text;
    element.style.color = `var(${colour}, var(--text))`;
    find(".labels").append(element);
    labels.push({ element, at });
  };

  const ghost = built && makeGhost(planned, sizes);
  const line = makeCentreline(planned, 0, sizes.outerRadius / 2);
  line.visible = Boolean(built);
  if (ghost) scene.add(ghost);
  const existingGhost = existing && makeGhost(existing, sizes);
  if (existingGhost) scene.add(existingGhost);
  scene.add(line);
  const commandedTrace = commanded && makeTrace(commanded, 0);
  const estimatedTrace = estimated && makeTrace(estimated, 0);
  if (commandedTrace) scene.add(commandedTrace);
  if (estimatedTrace) scene.add(estimatedTrace);

  const bodies = () => [body, planned, existing].filter(Boolean).flatMap(sampleCentreline);
  const box = new Box3().setFromPoints(bodies());
  const arrowLength = Math.max(3 * sizes.outerRadius, 0.06 * box.getSize(new Vector3()).length());
  const startDirection = start.slice(6, 9);
  const startAt = start.slice(9, 12);
  const startTail = pointAlong(startAt, startDirection, -arrowLength);
  const goalEnd = pointAlong(goal.position, goal.direction, 1.1 * arrowLength);
  const arrows = [
    [makeArrow(startTail, startDirection, arrowLength, 0), "--start"],
    [makeArrow(goal.position, goal.direction, arrowLength, 0), "--goal"],
  ];
  scene.add(...arrows.map(([arrow]) => arrow));
  label("start", () => startTail, "--start");
  label("goal", () => goalEnd, "--goal");
  if (existing) label("last body", () => Array.from(existing.frames.subarray(9, 12)), "--text");
  const balls = via.map((at, i) => {
    label(`via ${i + 1}`, () => at, "--goal");
    return makeBall(at, 0.2 * sizes.outerRadius, 0);
  });
  if (reached) {
    label("reached", () => reached, "--planned");
    balls.push(makeBall(reached, 0.12 * sizes.outerRadius, 0));
  }
  const goalBall = hasDraggableGoal && makeBall(goal.position, 0.2 * sizes.outerRadius, 0);
  if (goalBall) balls.push(goalBall);
  if (balls.length > 0) scene.add(...balls);
  const marks = [startTail, goalEnd, goal.position, reached].filter(Boolean).map((point) => new Vector3(...point));
  box.setFromPoints([...bodies(), ...marks]).expandByScalar(sizes.outerRadius);

  const floorAt = box.min.z;
  const floor = makeFloor(box, square ?? squareUnder(box), floorAt);
  scene.add(floor);

  const obstacles = subject.scene && makeObstacles(subject.scene, 0.12 * sizes.outerRadius);
  if (obstacles) {
    scene.add(obstacles.group, obstacles.mark);
    stage.obstacleDistance = obstacles.greatestDistance(box.getCenter(new Vector3()));
    if (obstacles.label) label(obstacles.label, () => obstacles.at, "--alarm");
  }

  const reach = subject.reach && makeReach(start, subject.reach);
  if (reach) scene.add(reach.mesh);

  const frame = makeTipFrame(2 * sizes.outerRadius);
  scene.add(frame.group);
  ["x", "y", "z"].forEach((name, axis) => {
    const tip = () => {
      const f = shown * 12;
      const origin = Array.from(body.frames.subarray(f + 9, f + 12));
      return pointAlong(origin, body.frames.subarray(f + axis * 3, f + axis * 3 + 3), frame.length);
    };
    label(name, tip, "--text");
  });

  let [tube, shadow] = [null, null];
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const applyShadowTheme = () => shadow.line.material.color.set(colour("--shadow"));
  let isFollowing = false;
  const followTip = () => {
    if (isFollowing) stage.lookAt(body.frames.subarray(shown * 12 + 9, shown * 12 + 12));
  };
  const show = (layers) => {
    shown = layers;
    tube.show(layers);
    shadow.show(layers);
    frame.moveTo(body.frames, layers * 12);
    followTip();
    stage.redraw();
  };
  const remove = (object) => {
    if (!object) return;
    object.traverse(dispose);
    scene.remove(object);
  };
  const setPoints = () => {
    stage.points = [...bodies(), ...marks, ...(reach?.mesh.visible ? reach.points : [])];
  };
  const replaceBody = (replacement) => {
    body = replacement;
    const [min, max] = range ?? heightRange([{ body, sizes }]);
    const [below, above] = heightsBeyond(body, sizes, [min, max]);
    const signs = [below ? "< " : "", "", above ? "> " : ""];
    find(".legend span").childNodes.forEach((end, i) => {
      end.textContent = `${signs[i]}${(min + ((max - min) * i) / 2).toFixed(2)}`;
    });
    find(".legend small").textContent = below || above ? `from percentile ${PERCENTILES.join(" to ")}` : "";
    if (tube && body.layers.count <= tube.capacity) {
      tube.replaceBody(body, [min, max]);
    } else {
      const isVisible = tube?.mesh.visible ?? true;
      remove(tube?.mesh);
      // A body in closed loop may become longer than its plan.
      const capacity = tube ? Math.ceil(GROWTH * body.layers.count) : planned.layers.count;
      tube = makeTube(body, sizes, [min, max], capacity);
      tube.mesh.visible = isVisible;
      scene.add(tube.mesh);
    }
    remove(shadow?.line);
    shadow = makeShadow(body, floorAt);
    applyShadowTheme();
    scene.add(shadow.line);
    setPoints();
    show(Math.min(shown, body.layers.count));
  };
  const setVisible = ({ built: asBuilt, planned: asPlanned, commanded: asCommanded, estimated: asEstimated }) => {
    tube.mesh.visible = asBuilt;
    if (ghost) ghost.visible = asPlanned;
    line.visible = asPlanned;
    if (commandedTrace) commandedTrace.visible = asCommanded;
    if (estimatedTrace) estimatedTrace.visible = asEstimated;
    stage.redraw();
  };
  const setSceneVisible = (isVisible) => {
    if (obstacles) obstacles.group.visible = isVisible;
    stage.redraw();
  };
  const setReachVisible = (isVisible) => {
    if (!reach) return;
    reach.mesh.visible = isVisible;
    setPoints();
    stage.setViewpoint("corner");
  };
  const setFollowing = (follows) => {
    isFollowing = follows;
    followTip();
  };
  const applyTheme = () => {
    obstacles?.setColours(colour("--obstacle"), colour("--alarm"));
    reach?.mesh.material.color.set(colour("--goal"));
    floor.material.color.set(colour("--grid"));
    applyShadowTheme();
    line.material.color.set(colour("--planned"));
    ghost?.material.color.set(colour("--planned"));
    existingGhost?.material.color.set(colour("--shadow"));
    commandedTrace?.material.color.set(colour("--commanded"));
    estimatedTrace?.material.color.set(colour("--estimated"));
    for (const [arrow, name] of arrows) arrow.children.forEach((part) => part.material.color.set(colour(name)));
    balls.forEach((ball) => ball.material.color.set(colour("--goal")));
    stage.background(colour("--ground"));
  };

  find(".legend i").style.background = gradient();
  replaceBody(body);
  applyTheme();
  stage.margin = sizes.outerRadius;
  stage.facing = [goal.direction, pointAlong(goal.position, startAt, -1)];
  stage.resize();
  stage.setViewpoint("corner");
  new ResizeObserver(stage.resize).observe(container);
  if (goalBall) makeGoalDraggable(stage, goalBall);
  const { setViewpoint } = stage;
  return {
    show, replaceBody, setVisible, setSceneVisible, setReachVisible, setFollowing, applyTheme, setViewpoint, stage,
  };
}

/** Returns the box around the centrelines of bodies. */
export function boxOf(bodies) {
  return new Box3().setFromPoints(bodies.flatMap(sampleCentreline));
}

/** Returns the side of the floor's squares under a box, mm. */
export function squareUnder(box) {
  return scaleLength(0.3 * Math.max(200, box.getSize(new Vector3()).length() / 2));
}

/** Releases the resources of a part of the scene on the graphics card. */
function dispose(part) {
  part.geometry?.dispose();
  part.material?.dispose();
}

/** Returns a few hundred points of a body's centreline. */
function sampleCentreline(body) {
  const stride = Math.max(1, Math.floor(body.layers.count / 300));
  const at = Array.from({ length: Math.floor(body.layers.count / stride) + 1 }, (_, i) => i * stride);
  return [...at, body.layers.count].map((i) => new Vector3(...body.frames.subarray(i * 12 + 9, i * 12 + 12)));
}

function showScale(scale, millimetresPerPixel) {
  const length = scaleLength(140 * millimetresPerPixel);
  scale.querySelector("i").style.width = `${length / millimetresPerPixel}px`;
  scale.querySelector("b").textContent = length >= 1000 ? `${length / 1000} m` : `${length} mm`;
}
