// One plan or growth: its picture, and the numbers beside it.

import { poseAt } from "./body.js";
import { drawChart, offThePlan } from "./chart.js";
import { makePicture } from "./picture.js";
import { makePlayer } from "./player.js";
import { readSubject } from "./subject.js";
import { durationText, fillNumbers, fillRows, fillWarnings, fixed } from "./text.js";

const find = (selector) => document.querySelector(selector);

/** Shows it, and returns its pictures. */
export function showOne(data) {
  const subject = readSubject(data);
  const { body, planned, built, robot } = subject;
  find("#about").textContent = data.about;
  fillNumbers(find("#numbers"), data.numbers);
  fillWarnings(find("#warnings"), data.warnings);
  const off = built && offThePlan(built, planned);
  const chart = off && drawChart(find("#chart"), built, off);
  const picture = makePicture(find(".stage"), subject);

  const shown = ["built", "planned", "estimated"].map((name) => [name, find(`#show-${name}`)]);
  shown.forEach(([, box]) => {
    box.addEventListener("change", () => picture?.reveal(Object.fromEntries(shown.map(([name, { checked }]) => [name, checked]))));
  });
  find("#compared").hidden = !built;
  find("#estimated").hidden = !subject.estimated;

  makePlayer(body.layers.count, (layers) => {
    const pose = poseAt(body, layers);
    const length = body.lengths[layers];
    find("#bar output").textContent = `layer ${layers} of ${body.layers.count} · ${durationText(layers * robot.period_s)}`;
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
  return [picture];
}
