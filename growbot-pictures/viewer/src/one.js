// A plan or a growth: its picture, and the numbers next to it.

import { layersAt, poseAt } from "./body.js";
import { deviationsFromPlan, drawDeviationChart } from "./chart.js";
import { onCursor, sendBody, sendCursor } from "./embedding.js";
import { makePicture } from "./picture.js";
import { makePlayer } from "./player.js";
import { readSubject } from "./subject.js";
import { durationText, fillNumbers, fillRows, fillWarnings, fixed } from "./text.js";
import { heightRange } from "./tube.js";

const find = (selector) => document.querySelector(selector);

/** Shows the body, and returns its pictures. */
export const showBody = (data) => [mountBody(data).picture];

/**
 * Shows the body, and returns its view. The view has the `picture`, `replaceBuilt(body)` for a running growth, the
 * current number of layers `layers()`, the final number `total`, the distance of the reached position from the goal
 * `goalErrorMm` (null before the end), and `publish()`, which sends the body to the page around this one.
 */
export function mountBody(data) {
  const subject = readSubject(data);
  const { planned, robot, sizes } = subject;
  let { body, built } = subject;
  find("#about").textContent = data.about;
  fillNumbers(find("#numbers"), data.numbers);
  fillWarnings(find("#warnings"), data.warnings);
  // The colours of a growing body do not change.
  const options = data.live ? { range: heightRange([{ body: planned, sizes }]) } : {};
  const picture = makePicture(find(".stage"), subject, options);
  const view = { picture, total: (data.live ? planned : body).layers.count, layers: () => body.layers.count };
  view.goalErrorMm = distance(subject.reached, subject.goal.position);

  const toggles = ["built", "planned", "commanded", "estimated"].map((name) => [name, find(`#show-${name}`)]);
  toggles.forEach(([, box]) => {
    box.addEventListener("change", () => {
      picture?.setVisible(Object.fromEntries(toggles.map(([name, { checked }]) => [name, checked])));
    });
  });
  find("#bodies").hidden = !built;
  find("#scene").hidden = !data.scene;
  find("#show-scene").addEventListener("change", ({ target }) => picture?.setSceneVisible(target.checked));
  find("#reach").hidden = !data.reach;
  find("#show-reach").addEventListener("change", ({ target }) => picture?.setReachVisible(target.checked));
  find("#built-name").textContent = data.built_name;
  find("#commanded").hidden = !subject.commanded;
  find("#estimated").hidden = !subject.estimated;

  let [deviations, chart] = [null, null];
  const updateDeviations = () => {
    deviations = built && deviationsFromPlan(built, planned);
    chart = deviations && drawDeviationChart(find("#chart"), built, deviations);
  };
  updateDeviations();
  view.publish = () => {
    sendBody(body, { total: view.total, planned, deviations, goalErrorMm: view.goalErrorMm });
  };
  view.publish();
  const player = makePlayer(body.layers.count, (layers) => {
    const pose = poseAt(body, layers);
    const length = body.lengths[layers];
    find("#bar output").textContent = `layer ${layers} of ${view.total} · ${durationText(layers * robot.period_s)}`;
    fillRows(find("#tip"), [
      ["Body", `${fixed(length, 1)} mm`],
      ["Position", `${pose.position.map((part) => fixed(part, 1)).join(", ")} mm`],
      ["Heading", `${fixed(pose.heading, 2)}°`],
      ["Pitch", `${fixed(pose.pitch, 2)}°`],
      ...(deviations ? [["Deviation from plan", `${deviations[layers].toFixed(3)} mm`]] : []),
    ]);
    sendCursor(layers, length, pose);
    chart?.mark(length);
    picture?.show(layers);
  });
  view.replaceBuilt = (longer) => {
    built = longer;
    body = longer;
    updateDeviations();
    picture?.replaceBody(longer);
    player.setCount(longer.layers.count);
    view.publish();
  };
  onCursor((length) => player.step(layersAt(body, length)));
  return view;
}

/** Returns the distance of two positions, mm. Null if there is only one. */
function distance(one, other) {
  return one && other ? Math.hypot(...one.map((part, k) => part - other[k])) : null;
}
