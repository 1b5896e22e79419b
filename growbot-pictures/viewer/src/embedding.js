// The page around this one, if a page of growbot shows this one in a frame. It gets what its charts and texts show, and
// can move the slider. Its side is growbot-page/src/viewer_messages.ts.

/** Maximum number of points along a body, and of temperatures, that the other page gets. */
const MAX_POINTS = 400;

/** True if a page of growbot shows this page in a frame. Other pages, such as notebooks, show the whole page. */
export const isEmbedded = window.frameElement?.dataset.growbotView !== undefined;

/** True if the page around this one plans again when a person drags the goal. */
export const hasDraggableGoal = isEmbedded && window.frameElement.dataset.growbotDrag !== undefined;

/** Returns whether a drag of the goal can begin now: not if the page has another goal meanwhile. */
export const canDragGoal = () => window.frameElement?.dataset.growbotDrag === "true";

function send(message) {
  if (isEmbedded) window.parent.postMessage({ growbot: message }, location.origin);
}

/** Returns indices of at most `MAX_POINTS` of `count` values, the last one included. */
function thinned(count) {
  const stride = Math.max(1, Math.ceil(count / MAX_POINTS));
  const indices = Array.from({ length: Math.ceil(count / stride) }, (_, i) => i * stride);
  if (count > 0 && indices.at(-1) !== count - 1) indices.push(count - 1);
  return indices;
}

/**
 * Sends the body: its final number of layers `total`, the planned body, the deviations from it (mm, `null` for a plan)
 * and the distance of the reached position from the goal (mm, `null` before the end).
 */
export function sendBody(body, { total, planned, deviations, goalErrorMm }) {
  const { count, height } = body.layers;
  const at = thinned(count);
  const along = (values) => at.map((layer) => values[layer + 1]);
  send({
    kind: "body", layers: count, total, lengthMm: body.lengths[count], plannedMm: planned.lengths.at(-1),
    lengths: along(body.lengths), heights: at.map((layer) => height[layer]),
    deviations: deviations && along(deviations),
    latestDeviationMm: deviations ? deviations[count] : null,
    maxDeviationMm: deviations ? deviations.reduce((max, deviation) => Math.max(max, deviation), 0) : null,
    // The end of an unfinished body is far from the goal, which is not an error.
    goalErrorMm: count >= planned.layers.count ? goalErrorMm : null,
  });
}

/** Sends the part of the body that the slider shows, and the pose of its tip. */
export function sendCursor(layers, lengthMm, { position, heading, pitch }) {
  send({ kind: "cursor", layers, lengthMm, position, heading, pitch });
}

/** Sends temperatures: time in s, temperature and target in degrees Celsius. */
export function sendReadings(readings) {
  if (isEmbedded) send({ kind: "readings", readings: thinned(readings.length).map((index) => readings[index]) });
}

/**
 * Sends the position to which the goal is dragged, mm, or null if a drag is cancelled. `isDropped` is false while it
 * moves.
 */
export function sendGoal(position, isDropped) {
  send({ kind: "goal", position, isDropped });
}

/** Calls `use` with each message of this kind from the page around this one. */
function onMessage(kind, use) {
  if (!isEmbedded) return;
  window.addEventListener("message", ({ origin, source, data }) => {
    const message = data?.growbot;
    if (origin === location.origin && source === window.parent && message?.kind === kind) use(message);
  });
}

/** Calls `move(lengthMm)` when the other page moves the slider. */
export function onCursor(move) {
  onMessage("cursor", ({ lengthMm }) => { if (Number.isFinite(lengthMm)) move(lengthMm); });
}

/** Calls `draw(points)` when the other page has a path to the dragged goal: its centreline, mm. */
export function onPath(draw) {
  onMessage("path", ({ points }) => draw(points));
}
