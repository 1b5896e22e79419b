// Charts next to the picture: the deviation of a body from its plan along the body, and the nozzle's temperature over
// time.

import { durationText } from "./text.js";

const [WIDE, HIGH, MAX_POINTS] = [280, 90, 400];
/** Time that the temperature chart shows, s, and its min span, degrees Celsius, so that the regulation is visible. */
const [SHOWN_S, MIN_SPAN_C] = [1800, 10];
/** Smallest range of the chart, mm. Smaller deviations are rounding errors. */
const FINEST = 0.001;

/** Returns the distance from the planned body at the same length, mm, for each number of layers. */
export function deviations(built, planned) {
  const off = new Float64Array(built.lengths.length);
  const last = planned.lengths.length - 1;
  let near = 0;
  for (let i = 0; i < off.length; i += 1) {
    const length = built.lengths[i];
    while (near < last - 1 && planned.lengths[near + 1] < length) near += 1;
    const next = Math.min(last, near + 1);
    const step = planned.lengths[next] - planned.lengths[near];
    const share = step > 0 ? Math.min(1, (length - planned.lengths[near]) / step) : 0;
    let sum = 0;
    for (let k = 9; k < 12; k += 1) {
      const there = planned.frames[near * 12 + k] * (1 - share) + planned.frames[next * 12 + k] * share;
      sum += (built.frames[i * 12 + k] - there) ** 2;
    }
    off[i] = Math.sqrt(sum);
  }
  return off;
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

/** Puts a chart into its place, and removes the previous one. */
function put(place, svg) {
  place.querySelector("svg")?.remove();
  place.append(svg);
  place.hidden = false;
}

/** Draws the chart of deviations. `mark(length)` of the result marks a position along the body. */
export function drawChart(place, built, off) {
  const length = Math.max(built.lengths.at(-1), 1e-9);
  const max = Math.max(off.reduce((a, b) => Math.max(a, b), 0), FINEST);
  const stride = Math.max(1, Math.ceil(off.length / MAX_POINTS));
  const points = [];
  for (let i = 0; i < off.length; i += stride) {
    points.push(`${((built.lengths[i] / length) * WIDE).toFixed(1)},${(HIGH - (off[i] / max) * HIGH).toFixed(1)}`);
  }
  const svg = make("svg", { viewBox: `0 -12 ${WIDE} ${HIGH + 28}`, role: "img", "aria-label": `Deviation of ${max.toFixed(3)} mm at most` });
  const line = make("line", { y1: 0, y2: HIGH, x1: WIDE, x2: WIDE, stroke: "var(--accent)", "stroke-dasharray": "2 2" });
  svg.append(
    make("line", { x1: 0, x2: WIDE, y1: HIGH, y2: HIGH, stroke: "var(--edge)" }),
    make("polyline", { points: points.join(" "), fill: "none", stroke: "var(--accent)", "stroke-width": 1.5 }),
    line,
    makeText(0, -3, "start", `${Number(max.toPrecision(2))} mm`),
    makeText(0, HIGH + 14, "start", "0"),
    makeText(WIDE, HIGH + 14, "end", `${length.toFixed(0)} mm`),
  );
  put(place, svg);
  return {
    mark: (at) => ["x1", "x2"].forEach((end) => line.setAttribute(end, (at / length) * WIDE)),
  };
}

/**
 * Draws the temperature of the nozzle over the last half hour. Each reading has the time in s, the temperature and the
 * target, degrees Celsius.
 */
export function drawReadings(place, readings) {
  if (readings.length === 0) return;
  const [now, latest, target] = readings.at(-1);
  const shown = readings.filter(([time]) => time >= now - SHOWN_S);
  const began = shown[0][0];
  const span = Math.max(now - began, 1);
  const all = shown.flatMap(([, celsius, setpoint]) => [celsius, setpoint ?? celsius]);
  const [coldest, hottest] = [Math.min(...all), Math.max(...all)];
  const spare = Math.max(1, 0.5 * (MIN_SPAN_C - (hottest - coldest)));
  const [min, max] = [coldest - spare, hottest + spare];
  const x = (time) => (((time - began) / span) * WIDE).toFixed(1);
  const y = (celsius) => (HIGH - ((celsius - min) / (max - min)) * HIGH).toFixed(1);
  const svg = make("svg", { viewBox: `0 -14 ${WIDE} ${HIGH + 30}`, role: "img", "aria-label": `Nozzle at ${latest.toFixed(1)} °C` });
  svg.append(make("line", { x1: 0, x2: WIDE, y1: HIGH, y2: HIGH, stroke: "var(--edge)" }));
  if (target !== null) {
    svg.append(make("line", { x1: 0, x2: WIDE, y1: y(target), y2: y(target), stroke: "var(--soft)", "stroke-dasharray": "2 2" }));
  }
  const points = shown.map(([time, celsius]) => `${x(time)},${y(celsius)}`).join(" ");
  svg.append(
    make("polyline", { points, fill: "none", stroke: "var(--goal)", "stroke-width": 1.5 }),
    makeText(0, -4, "start", `${latest.toFixed(1)} °C, ${target === null ? "heater off" : `regulated to ${target.toFixed(0)} °C`}`),
    makeText(WIDE, -4, "end", `${max.toFixed(0)}`),
    makeText(WIDE, HIGH - 3, "end", `${min.toFixed(0)}`),
    makeText(0, HIGH + 14, "start", `${durationText(span)} ago`),
    makeText(WIDE, HIGH + 14, "end", "now"),
  );
  put(place, svg);
}
