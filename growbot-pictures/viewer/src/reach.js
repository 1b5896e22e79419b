// The positions that a body of a given length reaches with any direction of its tip, without obstacles: a translucent
// surface. The shortest path to a position is an arc of the least radius and a line, or two arcs if the position is
// within the circle of that arc. The surface is what arcs with a line reach, turned about the direction of the start.

import { DoubleSide, LatheGeometry, Matrix4, Mesh, MeshLambertMaterial, Vector2, Vector3 } from "three";

const OPACITY = 0.16;
const STEPS = 96;
const SECTORS = 64;

/**
 * Returns the outline of the surface as pairs: distance from the axis, and position along it, mm. It begins straight
 * ahead and ends on the axis behind the start, or on the circle if the body is too short for that.
 */
export function reachOutline(radius, length) {
  const longest = Math.min(length / radius, 2 * Math.PI);
  const pointAt = (angle) => {
    const line = length - radius * angle;
    const [sine, cosine] = [Math.sin(angle), Math.cos(angle)];
    return [radius * (1 - cosine) + line * sine, radius * sine + line * cosine];
  };
  const outline = [];
  for (let step = 0; step <= STEPS; step += 1) {
    const point = pointAt((longest * step) / STEPS);
    if (point[0] < 0) {
      // Beyond the axis are the positions of the other side.
      const [away, along] = outline.at(-1);
      const share = away / (away - point[0]);
      outline.push([0, along + share * (point[1] - along)]);
      return outline;
    }
    outline.push(point);
  }
  // The arc itself closes the surface of a short body.
  for (let step = STEPS - 1; step >= 0; step -= 1) {
    const angle = (longest * step) / STEPS;
    outline.push([radius * (1 - Math.cos(angle)), radius * Math.sin(angle)]);
  }
  return outline;
}

/** Returns the `mesh` of the surface, and the corners of its box as `points`. `start` is a frame of 12 numbers. */
export function makeReach(start, { radius_mm: radius, length_mm: length }) {
  const outline = reachOutline(radius, length).map(([away, along]) => new Vector2(away, along));
  const geometry = new LatheGeometry(outline, SECTORS);
  const [x, y, z, at] = [0, 3, 6, 9].map((first) => new Vector3(...start.slice(first, first + 3)));
  // The lathe turns about its y axis.
  geometry.applyMatrix4(new Matrix4().makeBasis(x, z, y.negate()).setPosition(at));
  geometry.computeBoundingBox();
  const material = new MeshLambertMaterial({
    transparent: true, opacity: OPACITY, depthWrite: false, side: DoubleSide,
  });
  const mesh = new Mesh(geometry, material);
  // It is drawn after everything opaque, and before obstacles.
  mesh.renderOrder = 1;
  mesh.visible = false;
  const { min, max } = geometry.boundingBox;
  const corner = (bits) => new Vector3(...["x", "y", "z"].map((axis, bit) => (bits & (1 << bit) ? max : min)[axis]));
  return { mesh, points: Array.from({ length: 8 }, (_, bits) => corner(bits)) };
}
