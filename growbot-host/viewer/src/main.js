// The page that `growbot view` writes: puts the data in it on the stage and joins slider, buttons and keys to it.
//
// The data (`#data`, JSON, written by growbot-host/src/view/): what it is of, the robot's lengths in mm, start and goal, the layers of the
// planned body and of the one as built, and the numbers beside it.

import { Box3, Vector3 } from "three";
import { decodeLayers, growBody, poseAt } from "./body.js";
import { drawChart, offThePlan } from "./chart.js";
import { gradient } from "./colours.js";
import { makeArrow, makeBall, makeCentreline, makeFloor, makeShadow, makeTipFrame } from "./marks.js";
import { makePlayer } from "./player.js";
import { makeStage } from "./stage.js";
import { durationText, fillNumbers, fillRows, fixed, scaleLength } from "./text.js";
import { makeGhost, makeTube, heightRange } from "./tube.js";

const find = (selector) => document.querySelector(selector);
const data = JSON.parse(find("#data").textContent);
const { robot } = data;
const planned = growBody(data.start, decodeLayers(data.planned));
const built = data.built === null ? null : growBody(data.start, decodeLayers(data.built));
const body = built ?? planned;
const off = built && offThePlan(built, planned);
const sizes = { outerRadius: robot.outer_radius_mm, tipRadius: robot.tip_radius_mm, wall: robot.wall_mm };

find("#about").textContent = data.about;
fillNumbers(find("#numbers"), data.numbers);
for (const warning of data.warnings) {
  const line = document.createElement("p");
  line.className = "warning";
  line.textContent = warning;
  find("#warnings").append(line);
}
const chart = off && drawChart(find("#chart"), built, off);
find("#compared").hidden = !built;

let picture = null;
try {
  picture = makePicture();
} catch (error) {
  console.warn(`no picture: ${error.message}`);
  find("#no-picture").hidden = false;
  find(".legend").hidden = true;
  find(".scale").hidden = true;
}

const player = makePlayer(body.layers.count, (layers) => {
  const pose = poseAt(body, layers);
  const length = body.lengths[layers];
  find("#bar output").textContent =
    `layer ${layers} of ${body.layers.count} · ${durationText(layers * robot.period_s)}`;
  fillRows(find("#tip"), [
    ["Body", `${fixed(length, 1)} mm`],
    ["Position", `${pose.position.map((part) => fixed(part, 1)).join(", ")} mm`],
    ["Heading", `${fixed(pose.heading, 2)}°`],
    ["Pitch", `${fixed(pose.pitch, 2)}°`],
    ...(off ? [["Off the plan", `${off[layers].toFixed(3)} mm`]] : []),
  ]);
  chart?.mark(length);
  picture?.show(layers);
});

joinTheme();

/** Everything in three dimensions: `show(layers)` and `paint()`, which takes the colours of the page. */
function makePicture() {
  const [least, greatest] = heightRange(body, sizes.tipRadius);
  find(".legend i").style.background = gradient;
  find(".legend span").childNodes.forEach((end, i) => {
    end.textContent = (least + ((greatest - least) * i) / 2).toFixed(2);
  });

  const labels = [];
  const stage = makeStage(find("canvas"), (seen) => {
    for (const { element, at } of labels) {
      const [right, y] = seen.onScreen(at());
      // Labels stay in the picture.
      const x = Math.min(right, find("canvas").clientWidth - element.offsetWidth - 12);
      element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(8px, -50%)`;
    }
    showScale(seen.millimetresPerPixel());
    if (!document.documentElement.dataset.drawn) {
      document.documentElement.dataset.drawn = Math.round(performance.now()).toString();
    }
  });
  const { scene } = stage;
  const label = (text, at, colour) => {
    const element = document.createElement("span");
    element.className = "label";
    element.textContent = text;
    element.style.color = `var(${colour}, var(--text))`;
    find("#labels").append(element);
    labels.push({ element, at });
  };

  const tube = makeTube(body, sizes, [least, greatest]);
  scene.add(tube.mesh);
  const ghost = built && makeGhost(planned, sizes);
  const line = makeCentreline(planned, 0, sizes.outerRadius / 2);
  line.visible = Boolean(built);
  if (ghost) scene.add(ghost);
  scene.add(line);

  const points = [built, planned].filter(Boolean).flatMap(outline);
  const box = new Box3().setFromPoints(points);
  const reach = Math.max(3 * sizes.outerRadius, 0.06 * box.getSize(new Vector3()).length());
  const axes = data.start;
  const along = (from, direction, length) => from.map((part, k) => part + direction[k] * length);
  const startDirection = Array.from(axes.slice(6, 9));
  const startTail = along(axes.slice(9, 12), startDirection, -reach);
  const goalEnd = along(data.goal.position, data.goal.direction, 1.1 * reach);
  const arrows = [
    [makeArrow(startTail, startDirection, reach, 0), "--start"],
    [makeArrow(data.goal.position, data.goal.direction, reach, 0), "--goal"],
  ];
  scene.add(...arrows.map(([arrow]) => arrow));
  label("start", () => startTail, "--start");
  label("goal", () => goalEnd, "--goal");
  const balls = data.via.map((at, i) => {
    label(`via ${i + 1}`, () => at, "--goal");
    return makeBall(at, 0.2 * sizes.outerRadius, 0);
  });
  if (data.reached) {
    label("reached", () => data.reached, "--planned");
    balls.push(makeBall(data.reached, 0.12 * sizes.outerRadius, 0));
  }
  if (balls.length > 0) scene.add(...balls);
  points.push(...[startTail, goalEnd, data.goal.position, data.reached].filter(Boolean).map((point) => new Vector3(...point)));
  box.setFromPoints(points).expandByScalar(sizes.outerRadius);
  stage.points = points;
  stage.around = sizes.outerRadius;

  const floorAt = box.min.z;
  const floor = makeFloor(box, scaleLength(0.3 * Math.max(200, box.getSize(new Vector3()).length() / 2)), floorAt);
  const shadow = makeShadow(body, floorAt);
  scene.add(floor, shadow.line);

  const frame = makeTipFrame(2 * sizes.outerRadius);
  scene.add(frame.group);
  let shown = body.layers.count;
  ["x", "y", "z"].forEach((name, axis) => {
    const tip = () => {
      const f = shown * 12;
      return along(Array.from(body.frames.subarray(f + 9, f + 12)), body.frames.subarray(f + axis * 3, f + axis * 3 + 3), frame.length);
    };
    label(name, tip, "--text");
  });

  const show = (layers) => {
    shown = layers;
    tube.show(layers);
    shadow.show(layers);
    frame.place(body.frames, layers * 12);
    stage.redraw();
  };
  const paint = () => {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    floor.material.color.set(colour("--grid"));
    shadow.line.material.color.set(colour("--shadow"));
    line.material.color.set(colour("--planned"));
    ghost?.material.color.set(colour("--planned"));
    for (const [arrow, name] of arrows) arrow.children.forEach((part) => part.material.color.set(colour(name)));
    balls.forEach((ball) => ball.material.color.set(colour("--goal")));
    stage.background(colour("--ground"));
  };
  find("#show-built").addEventListener("change", (event) => {
    tube.mesh.visible = event.target.checked;
    stage.redraw();
  });
  find("#show-planned").addEventListener("change", (event) => {
    ghost.visible = event.target.checked;
    line.visible = event.target.checked;
    stage.redraw();
  });
  document.querySelectorAll("[data-look]").forEach((button) => {
    button.addEventListener("click", () => stage.look(button.dataset.look));
  });
  paint();
  stage.fit();
  stage.facing = [data.goal.direction, along(data.goal.position, axes.slice(9, 12), -1)];
  stage.look("corner");
  new ResizeObserver(stage.fit).observe(find("#stage"));
  return { show, paint };
}

/** A few hundred points of a body's centreline. */
function outline(grown) {
  const stride = Math.max(1, Math.floor(grown.layers.count / 300));
  const at = Array.from({ length: Math.floor(grown.layers.count / stride) + 1 }, (_, i) => i * stride);
  return [...at, grown.layers.count].map((i) => new Vector3(...grown.frames.subarray(i * 12 + 9, i * 12 + 12)));
}

function showScale(millimetresPerPixel) {
  const length = scaleLength(140 * millimetresPerPixel);
  find(".scale i").style.width = `${length / millimetresPerPixel}px`;
  find(".scale b").textContent = length >= 1000 ? `${length / 1000} m` : `${length} mm`;
}

/** Light or dark as the system has it, until the button says otherwise. */
function joinTheme() {
  const system = matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  const apply = () => {
    const theme = chosen ?? (system.matches ? "dark" : "light");
    document.documentElement.dataset.theme = theme;
    find("#theme").textContent = theme === "dark" ? "Light" : "Dark";
    picture?.paint();
  };
  system.addEventListener("change", apply);
  find("#theme").addEventListener("click", () => {
    chosen = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    apply();
  });
  apply();
}
