// Builds a body from its layers: the frames of the tip, layer by layer, as in growbot-core (Eqs 4 and 5).
//
// A layer is 12 bytes, three little-endian 32-bit numbers: alpha in 2^-32 turns, height in 2^-24 mm, tilt in 2^-32 rad.

const LAYER_BYTES = 12;

/** Decodes layers from hexadecimal digits, 24 each: alpha and tilt in radians, height in mm. */
export function decodeLayers(hex) {
  const bytes = new Uint8Array(hex.length / 2);
  for (let i = 0; i < bytes.length; i += 1) bytes[i] = Number.parseInt(hex.slice(2 * i, 2 * i + 2), 16);
  const view = new DataView(bytes.buffer);
  const count = Math.floor(bytes.length / LAYER_BYTES);
  const alpha = new Float64Array(count);
  const height = new Float64Array(count);
  const tilt = new Float64Array(count);
  for (let i = 0; i < count; i += 1) {
    alpha[i] = (view.getUint32(i * LAYER_BYTES, true) / 2 ** 32) * 2 * Math.PI;
    height[i] = view.getUint32(i * LAYER_BYTES + 4, true) / 2 ** 24;
    tilt[i] = view.getUint32(i * LAYER_BYTES + 8, true) / 2 ** 32;
  }
  return { count, alpha, height, tilt };
}

/** Returns sin(x) / x. */
const sineRatio = (x) => (Math.abs(x) > 1e-4 ? Math.sin(x) / x : 1 - (x * x) / 6);
/** Returns (1 - cos(x)) / x. */
const versineRatio = (x) => {
  const half = Math.sin(0.5 * x);
  return Math.abs(x) > 1e-4 ? (2 * half * half) / x : 0.5 * x;
};

/**
 * Returns the frames of the tip from the start (12 numbers: x, y and z axis, position) through all layers, 12 numbers
 * each. Also returns the length of the body up to each, mm. There is one frame more than there are layers.
 */
export function growBody(start, layers) {
  const { count } = layers;
  const frames = new Float64Array((count + 1) * 12);
  const lengths = new Float64Array(count + 1);
  frames.set(start);
  for (let i = 0; i < count; i += 1) {
    const from = i * 12;
    const to = from + 12;
    const tilt = layers.tilt[i];
    const height = layers.height[i];
    // The tip bends away from the angle of greatest deposition.
    const bendDirection = [-Math.cos(layers.alpha[i]), -Math.sin(layers.alpha[i])];
    const sine = Math.sin(tilt);
    const half = Math.sin(0.5 * tilt);
    const versine = 2 * half * half;
    const lateral = height * versineRatio(tilt);
    const axial = height * sineRatio(tilt);
    for (let k = 0; k < 3; k += 1) {
      const x = frames[from + k];
      const y = frames[from + 3 + k];
      const z = frames[from + 6 + k];
      // The direction of the bend in the plane of the tip.
      const bend = bendDirection[0] * x + bendDirection[1] * y;
      const turned = -versine * bend - sine * z;
      frames[to + k] = x + bendDirection[0] * turned;
      frames[to + 3 + k] = y + bendDirection[1] * turned;
      frames[to + 6 + k] = z * (1 - versine) + sine * bend;
      frames[to + 9 + k] = frames[from + 9 + k] + lateral * bend + axial * z;
    }
    orthonormalize(frames, to);
    lengths[i + 1] = lengths[i] + height;
  }
  return { layers, frames, lengths };
}

/** Makes the axes of a frame perpendicular and of length 1 again. */
function orthonormalize(frames, at) {
  const [x, y, z] = [at, at + 3, at + 6].map((axis) => frames.subarray(axis, axis + 3));
  normalize(z);
  const along = x[0] * z[0] + x[1] * z[1] + x[2] * z[2];
  for (let k = 0; k < 3; k += 1) x[k] -= along * z[k];
  normalize(x);
  y[0] = z[1] * x[2] - z[2] * x[1];
  y[1] = z[2] * x[0] - z[0] * x[2];
  y[2] = z[0] * x[1] - z[1] * x[0];
}

function normalize(vector) {
  const norm = Math.hypot(vector[0], vector[1], vector[2]);
  for (let k = 0; k < 3; k += 1) vector[k] /= norm;
}

/** Returns the pose of the tip after this number of layers: position in mm, heading and pitch in degrees. */
export function poseAt(body, layers) {
  const at = layers * 12;
  const [zx, zy, zz] = body.frames.subarray(at + 6, at + 9);
  const level = Math.hypot(zx, zy);
  const degrees = 180 / Math.PI;
  return {
    position: Array.from(body.frames.subarray(at + 9, at + 12)),
    heading: level < 1e-9 ? 0 : Math.atan2(zy, zx) * degrees,
    pitch: Math.atan2(zz, level) * degrees,
  };
}

/** Returns the number of layers of a body within this length, mm. */
export function layersAt({ lengths }, length) {
  let [low, high] = [0, lengths.length - 1];
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (lengths[middle] <= length) low = middle;
    else high = middle - 1;
  }
  return low;
}
