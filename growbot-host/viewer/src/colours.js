// Colours of heights, which read on light and on dark ground and to the colour-blind: from blue over sand to orange.

const STOPS = [
  [0x2f, 0x5f, 0xae],
  [0x3f, 0x93, 0xb8],
  [0x8f, 0xb8, 0x9a],
  [0xe0, 0xb6, 0x5c],
  [0xd9, 0x70, 0x2e],
];

/** The colour at a share from 0 to 1, as three bytes. */
export function colourAt(share) {
  const place = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const low = Math.min(STOPS.length - 2, Math.floor(place));
  return STOPS[low].map((from, k) => Math.round(from + (STOPS[low + 1][k] - from) * (place - low)));
}

/** The scale as a CSS gradient. */
export const gradient = `linear-gradient(90deg, ${STOPS.map((stop) => `rgb(${stop.join(" ")})`).join(", ")})`;
