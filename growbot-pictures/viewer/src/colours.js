// Colours of heights. The scale is in the page's data (`height_colours`, growbot-pictures/src/drawing/colours.rs).

let stops = [[0, 0, 0], [0, 0, 0]];

/** Sets the scale: colours of three bytes, from the min height to the max. */
export function setHeightColours(colours) {
  stops = colours;
}

/** Returns the colour at a share from 0 to 1, as three bytes. */
export function colourAt(share) {
  const position = Math.min(1, Math.max(0, share)) * (stops.length - 1);
  const low = Math.min(stops.length - 2, Math.floor(position));
  return stops[low].map((from, k) => Math.round(from + (stops[low + 1][k] - from) * (position - low)));
}

/** Returns the scale as a CSS gradient. */
export const gradient = () => `linear-gradient(90deg, ${stops.map((stop) => `rgb(${stop.join(" ")})`).join(", ")})`;
