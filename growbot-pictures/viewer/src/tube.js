// The printed tube as one mesh that grows by its draw range, and the rim on which the next layer is laid.

import {
  BufferAttribute, BufferGeometry, DoubleSide, Mesh, MeshBasicMaterial, MeshLambertMaterial, SRGBColorSpace, Color,
} from "three";
import { colourAt } from "./colours.js";

const SEGMENTS = 32;
/** Greatest number of rings. Beyond it only every second, third and so on layer has a ring. */
const MAX_RINGS = 5000;

/**
 * Height of partial layers, as a share of the highest layer. Lower layers lie between two pieces of a path and do not
 * stretch the scale.
 */
const PARTIAL_LAYER_SHARE = 0.2;

/**
 * Percentiles of the heights at which the colours end, so that outliers do not stretch the scale
 * (growbot-pictures/src/view/heights.rs).
 */
export const PERCENTILES = [1, 99];

/** Returns the min and max height of each layer of a body, on the middle of its wall, mm, in order of height. */
function sortedHeights({ layers }, tipRadius) {
  const partialHeight = PARTIAL_LAYER_SHARE * layers.height.reduce((a, b) => Math.max(a, b), 0);
  const found = [];
  for (let i = 0; i < layers.count; i += 1) {
    if (layers.height[i] < partialHeight) continue;
    const lean = tipRadius * layers.tilt[i];
    found.push(layers.height[i] - lean, layers.height[i] + lean);
  }
  return Float64Array.from(found).sort();
}

/** Returns the heights of the bodies' layers at which the colours end, mm. */
export function heightRange(subjects) {
  const all = subjects.map(({ body, sizes }) => sortedHeights(body, sizes.tipRadius));
  const found = Float64Array.from(all.flatMap((values) => [...values])).sort();
  if (found.length === 0) return [0, 1];
  const [low, high] = PERCENTILES.map((percent) => (percent / 100) * (found.length - 1));
  const [min, max] = [found[Math.floor(low)], found[Math.ceil(high)]];
  // Layers of equal height are in the middle of the scale.
  return max - min > 1e-3 ? [min, max] : [min - 0.05, max + 0.05];
}

/** Returns two flags: true if a body has layers below this range, and true if it has layers above it. */
export function heightsBeyond(body, { tipRadius }, [min, max]) {
  const found = sortedHeights(body, tipRadius);
  return [found[0] < min - 1e-6, found.at(-1) > max + 1e-6];
}

/** Converts a colour to linear light, because the graphics card interpolates colours in linear light. */
function linearBytes(share) {
  const [r, g, b] = colourAt(share);
  const colour = new Color().setRGB(r / 255, g / 255, b / 255, SRGBColorSpace);
  return [colour.r * 255, colour.g * 255, colour.b * 255];
}

/**
 * Makes the tube of a body, with room for a body of at least `minCapacity` layers, so that a growing one needs no more
 * memory. The result has `mesh`, `capacity`, `replaceBody(body, range)` for a body that fits, and `show(layers)`, which
 * sets the visible part. Lengths are in mm.
 */
export function makeTube(body, { outerRadius, tipRadius, wall }, range, minCapacity = 0) {
  const capacity = Math.max(minCapacity, body.layers.count);
  const stride = Math.max(1, Math.ceil(capacity / MAX_RINGS));
  const maxRings = Math.ceil(capacity / stride) + 1;
  const palette = Array.from({ length: 256 }, (_, i) => linearBytes(i / 255));
  const round = Array.from({ length: SEGMENTS + 1 }, (_, j) => (j / SEGMENTS) * 2 * Math.PI);
  const [cosines, sines] = [round.map(Math.cos), round.map(Math.sin)];
  const vertices = maxRings * (SEGMENTS + 1);
  const position = new Float32Array(vertices * 3);
  const normal = new Float32Array(vertices * 3);
  const colour = new Uint8Array(vertices * 3);
  const ring = new Float32Array(vertices);
  const index = new Uint32Array((maxRings - 1) * SEGMENTS * 6);
  let n = 0;
  for (let i = 0; i + 1 < maxRings; i += 1) {
    for (let j = 0; j < SEGMENTS; j += 1) {
      const a = i * (SEGMENTS + 1) + j;
      const b = a + SEGMENTS + 1;
      index.set([a, a + 1, b, b, a + 1, b + 1], n);
      n += 6;
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(position, 3));
  geometry.setAttribute("normal", new BufferAttribute(normal, 3));
  geometry.setAttribute("color", new BufferAttribute(colour, 3, true));
  geometry.setAttribute("ring", new BufferAttribute(ring, 1));
  geometry.setIndex(new BufferAttribute(index, 1));
  const mesh = new Mesh(geometry, withLayerLines(new MeshLambertMaterial({ vertexColors: true, side: DoubleSide })));
  mesh.frustumCulled = false;
  const rim = makeRim(outerRadius, wall);
  mesh.add(rim.mesh);

  // Current body, and its last ring.
  let [current, last] = [body, 0];
  const show = (count) => {
    const { frames, layers } = current;
    // Number of rings within these layers. The last ring may have a smaller distance from the one before.
    const rings = count >= layers.count ? last : Math.floor(count / stride);
    geometry.setDrawRange(0, rings * SEGMENTS * 6);
    rim.moveTo(frames, (rings === last ? layers.count : rings * stride) * 12);
  };
  const replaceBody = (replacement, [min, max]) => {
    current = replacement;
    const { frames, layers } = current;
    last = Math.ceil(layers.count / stride);
    let v = 0;
    for (let i = 0; i <= last; i += 1) {
      const layer = Math.min(i * stride, layers.count);
      const f = layer * 12;
      const below = Math.max(0, layer - 1);
      const [alpha, height, lean] = [layers.alpha[below], layers.height[below], tipRadius * layers.tilt[below]];
      for (let j = 0; j <= SEGMENTS; j += 1) {
        for (let k = 0; k < 3; k += 1) {
          const out = cosines[j] * frames[f + k] + sines[j] * frames[f + 3 + k];
          normal[v * 3 + k] = out;
          position[v * 3 + k] = frames[f + 9 + k] + outerRadius * out;
        }
        const share = (height + lean * Math.cos(round[j] - alpha) - min) / (max - min);
        colour.set(palette[Math.round(255 * Math.min(1, Math.max(0, share)))] ?? palette[127], v * 3);
        ring[v] = layer;
        v += 1;
      }
    }
    for (const attribute of Object.values(geometry.attributes)) attribute.needsUpdate = true;
    show(layers.count);
  };
  replaceBody(body, range);
  return { mesh, capacity, replaceBody, show };
}

/** Makes the planned tube, translucent and a little narrower than the one as built. */
export function makeGhost(body, { outerRadius, tipRadius, wall }) {
  const { mesh } = makeTube(body, { outerRadius: 0.985 * outerRadius, tipRadius, wall }, [0, 1]);
  mesh.material = new MeshBasicMaterial({ transparent: true, opacity: 0.22, depthWrite: false });
  mesh.clear();
  return mesh;
}

/** Draws a fine line between layers if they are large enough in the picture. */
function withLayerLines(material) {
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute float ring;\nvarying float vRing;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nvRing = ring;");
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", "#include <common>\nvarying float vRing;")
      .replace(
        "#include <color_fragment>",
        `#include <color_fragment>
        float perPixel = fwidth(vRing);
        float edge = abs(fract(vRing + 0.5) - 0.5);
        float line = 1.0 - smoothstep(0.06, 0.06 + max(perPixel, 0.06), edge);
        diffuseColor.rgb *= 1.0 - 0.5 * line * (1.0 - smoothstep(0.12, 0.45, perPixel));`,
      );
  };
  return material;
}

/** Makes the rim of the wall at the tip. */
function makeRim(outerRadius, wall) {
  const position = new Float32Array((SEGMENTS + 1) * 6);
  const index = [];
  for (let j = 0; j < SEGMENTS; j += 1) index.push(2 * j, 2 * j + 1, 2 * j + 2, 2 * j + 2, 2 * j + 1, 2 * j + 3);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(position, 3));
  geometry.setAttribute("normal", new BufferAttribute(new Float32Array(position.length), 3));
  geometry.setIndex(index);
  const mesh = new Mesh(geometry, new MeshLambertMaterial({ color: 0x8a94a3, side: DoubleSide }));
  mesh.frustumCulled = false;
  const moveTo = (frames, f) => {
    const normal = geometry.attributes.normal.array;
    for (let j = 0; j <= SEGMENTS; j += 1) {
      const angle = (j / SEGMENTS) * 2 * Math.PI;
      for (let k = 0; k < 3; k += 1) {
        const out = Math.cos(angle) * frames[f + k] + Math.sin(angle) * frames[f + 3 + k];
        position[j * 6 + k] = frames[f + 9 + k] + outerRadius * out;
        position[j * 6 + 3 + k] = frames[f + 9 + k] + (outerRadius - wall) * out;
        normal[j * 6 + k] = frames[f + 6 + k];
        normal[j * 6 + 3 + k] = frames[f + 6 + k];
      }
    }
    geometry.attributes.position.needsUpdate = true;
    geometry.attributes.normal.needsUpdate = true;
  };
  return { mesh, moveTo };
}
