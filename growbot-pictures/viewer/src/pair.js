// Two plans or growths side by side: their pictures, which turn together, and the numbers of both.

import { layersAt, poseAt } from "./body.js";
import { boxOf, makePicture, squareUnder } from "./picture.js";
import { makePlayer } from "./player.js";
import { linkStages } from "./stage.js";
import { readSubject } from "./subject.js";
import { fillTable, fillWarnings, fixed } from "./text.js";
import { heightRange } from "./tube.js";

const find = (selector) => document.querySelector(selector);

/** Shows the bodies, and returns their pictures. */
export function showPair(data) {
  const subjects = data.compared.map(readSubject);
  const names = subjects.map(({ name }) => name);
  find("#difference").textContent = data.difference;
  find("#step").textContent = "a millimetre";
  find("#slider").setAttribute("aria-label", "Length of the body, mm");
  const warnings = subjects.flatMap((subject) => subject.warnings.map((warning) => `${subject.name}: ${warning}`));
  fillWarnings(find("#warnings"), warnings);
  document.querySelectorAll("#at-slider, #numbers").forEach((part) => {
    part.hidden = true;
  });

  document.body.classList.add("pair");
  const pictures = drawSideBySide(subjects);

  const bodies = subjects.map(({ body }) => body);
  const max = Math.ceil(Math.max(...bodies.map(({ lengths }) => lengths.at(-1))));
  makePlayer(max, (length) => {
    const layers = bodies.map((body) => layersAt(body, length));
    find("#bar output").textContent = `${length} of ${max} mm`;
    const poses = bodies.map((body, i) => poseAt(body, layers[i]));
    const row = (name, value) => [name, ...bodies.map((body, i) => value(body, i))];
    const part = (index) => (_, i) => `${fixed(poses[i].position[index], 1)} mm`;
    const tips = [
      row("Body", (body, i) => `${fixed(body.lengths[layers[i]], 1)} mm`),
      row("Layers", (_, i) => layers[i].toString()),
      ...["x", "y", "z"].map((name, index) => row(name, part(index))),
      row("Heading", (_, i) => `${fixed(poses[i].heading, 2)}°`),
      row("Pitch", (_, i) => `${fixed(poses[i].pitch, 2)}°`),
    ];
    fillTable(find("#both"), names, [["Tip at the slider", tips], ...data.numbers]);
    pictures.forEach((picture, i) => picture?.show(layers[i]));
  }, "mm");
  return pictures;
}

/**
 * Draws each body on its own stage below its name. Both share one scale of colours and one size of the floor's squares.
 */
function drawSideBySide(subjects) {
  const first = find(".stage");
  const stages = subjects.map((_, i) => (i === 0 ? first : first.cloneNode(true)));
  const figures = stages.map((stage, i) => {
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    const name = document.createElement("b");
    name.textContent = subjects[i].name;
    caption.append(name, ` ${subjects[i].caption}`);
    figure.append(caption, stage);
    return figure;
  });
  find("#stages").replaceChildren(...figures);

  const range = heightRange(subjects);
  const square = Math.max(...subjects.map(({ body }) => squareUnder(boxOf([body]))));
  const pictures = subjects.map((subject, i) => makePicture(stages[i], subject, { range, square }));
  if (pictures.every(Boolean)) linkStages(pictures.map(({ stage }) => stage));
  return pictures;
}
