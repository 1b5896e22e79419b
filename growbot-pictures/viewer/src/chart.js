// Charts next to the picture: the deviation of a body from its plan along the body, and the nozzle's temperature over
// time.

import { durationText } from "./text.js";

const [WIDTH, HEIGHT, MAX_POINTS] = [280, 90, 400];
/** Time span of the temperature chart, s, and its smallest temperature span, degrees Celsius. */
const [TIME_SPAN_S, MIN_SPAN_C] = [1800, 10];
/** Smallest range of the deviation chart, mm. Smaller deviations are rounding errors. */
const MIN_RANGE_MM = 0.001;

/** Returns the distance from the planned body at the same length, mm, for each number of layers. */
export function deviationsFromPlan(built, planned) {
  const deviations = new Float64Array(built.lengths.length);
  const last = planned.lengths.length - 1;
  let before = 0;
  for (let i = 0; i < deviations.length; i += 1) {
    const length = built.lengths[i];
    while (before < last - 1 && planned.lengths[before + 1] < length) before += 1;
    const next = Math.min(last, before + 1);
    const step = planned.lengths[next] - planned.lengths[before];
    const share = step > 0 ? Math.min(1, (length - planned.lengths[before]) / step) : 0;
    let sum = 0;
    for (let k = 9; k < 12; k += 1) {
      const expected = planned.frames[before * 12 + k] * (1 - share) + planned.frames[next * 12 + k] * share;
      sum += (built.frames[i * 12 + k] - expected) ** 2;
    }
    deviations[i] = Math.sqrt(sum);
  }
  return deviations;
}

function make(tag, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  Object.entries(attributes).forEach(([name, value]) => element.setAttribute(name, value));
  return element;
}

function makeText(x, y, anchor, text) {
  const element = make("text", { x, y, "text-anchor": anchor, "font-size": 11, fill: "var(--soft)" });
  element.textContent = text;
  return element;
}

/** Shows a chart in its section in place of the previous one. */
function replaceChart(section, svg) {
  section.querySelector("svg")?.remove();
  section.append(svg);
  section.hidden = false;
}

/** Draws the chart of deviations. `mark(length)` of the result marks a position along the body. */
export function drawDeviationChart(section, built, deviations) {
  const length = Math.max(built.lengths.at(-1), 1e-9);
  const max = Math.max(deviations.reduce((a, b) => Math.max(a, b), 0), MIN_RANGE_MM);
  const stride = Math.max(1, Math.ceil(deviations.length / MAX_POINTS));
  const points = [];
  for (let i = 0; i < deviations.length; i += stride) {
    const [x, y] = [(built.lengths[i] / length) * WIDTH, HEIGHT - (deviations[i] / max) * HEIGHT];
    points.push(`${x.toFixed(1)},${y.toFixed(1)}`);
  }
  const label = `Deviation of at most ${max.toFixed(3)} mm`;
  const svg = make("svg", { viewBox: `0 -12 ${WIDTH} ${HEIGHT + 28}`, role: "img", "aria-label": label });
  const x = { x1: WIDTH, x2: WIDTH };
  const line = make("line", { y1: 0, y2: HEIGHT, ...x, stroke: "var(--accent)", "stroke-dasharray": "2 2" });
  svg.append(
    make("line", { x1: 0, x2: WIDTH, y1: HEIGHT, y2: HEIGHT, stroke: "var(--edge)" }),
    make("polyline", { points: points.join(" "), fill: "none", stroke: "var(--accent)", "stroke-width": 1.5 }),
    line,
    makeText(0, -3, "start", `${Number(max.toPrecision(2))} mm`),
    makeText(0, HEIGHT + 14, "start", "0"),
    makeText(WIDTH, HEIGHT + 14, "end", `${length.toFixed(0)} mm`),
  );
  replaceChart(section, svg);
  return {
    mark: (at) => ["x1", "x2"].forEach((end) => line.setAttribute(end, (at / length) * WIDTH)),
  };
}

/**
 * Draws the temperature of the nozzle over the last half hour. Each reading has the time in s, the temperature and the
 * target in degrees Celsius. The target is null while the heater is off.
 */
export function drawTemperatureChart(section, readings) {
  if (readings.length === 0) return;
  const [now, latest, target] = readings.at(-1);
  const shown = readings.filter(([time]) => time >= now - TIME_SPAN_S);
  const start = shown[0][0];
  const span = Math.max(now - start, 1);
  const all = shown.flatMap(([, celsius, setpoint]) => [celsius, setpoint ?? celsius]);
  const [lowest, highest] = [Math.min(...all), Math.max(...all)];
  const margin = Math.max(1, 0.5 * (MIN_SPAN_C - (highest - lowest)));
  const [min, max] = [lowest - margin, highest + margin];
  const x = (time) => (((time - start) / span) * WIDTH).toFixed(1);
  const y = (celsius) => (HEIGHT - ((celsius - min) / (max - min)) * HEIGHT).toFixed(1);
  const label = `Nozzle at ${latest.toFixed(1)} °C`;
  const svg = make("svg", { viewBox: `0 -14 ${WIDTH} ${HEIGHT + 30}`, role: "img", "aria-label": label });
  svg.append(make("line", { x1: 0, x2: WIDTH, y1: HEIGHT, y2: HEIGHT, stroke: "var(--edge)" }));
  if (target !== null) {
    const targetLine = { x1: 0, x2: WIDTH, y1: y(target), y2: y(target) };
    svg.append(make("line", { ...targetLine, stroke: "var(--soft)", "stroke-dasharray": "2 2" }));
  }
  const targetText = target === null ? "heater off" : `target ${target.toFixed(0)} °C`;
  const points = shown.map(([time, celsius]) => `${x(time)},${y(celsius)}`).join(" ");
  svg.append(
    make("polyline", { points, fill: "none", stroke: "var(--goal)", "stroke-width": 1.5 }),
    makeText(0, -4, "start", `${latest.toFixed(1)} °C, ${targetText}`),
    makeText(WIDTH, -4, "end", `${max.toFixed(0)}`),
    makeText(WIDTH, HEIGHT - 3, "end", `${min.toFixed(0)}`),
    makeText(0, HEIGHT + 14, "start", `${durationText(span)} ago`),
    makeText(WIDTH, HEIGHT + 14, "end", "now"),
  );
  replaceChart(section, svg);
}
