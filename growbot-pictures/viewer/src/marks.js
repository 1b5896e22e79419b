// Marks around the tube: arrows for poses, the tip's frame, centrelines, the floor.

import {
  BufferAttribute, BufferGeometry, ConeGeometry, CylinderGeometry, Group, Line, LineBasicMaterial, LineDashedMaterial,
  LineSegments,
  Mesh, MeshBasicMaterial, MeshLambertMaterial, Quaternion, SphereGeometry, Vector3,
} from "three";

const UP = new Vector3(0, 1, 0);

/** Makes an arrow of this length from a point (mm) in a direction. */
export function makeArrow(from, direction, length, colour) {
  const radius = 0.035 * length;
  const material = new MeshLambertMaterial({ color: colour });
  const shaft = new Mesh(new CylinderGeometry(radius, radius, 0.7 * length, 24), material);
  shaft.position.y = 0.35 * length;
  const head = new Mesh(new ConeGeometry(3 * radius, 0.3 * length, 32), material);
  head.position.y = 0.85 * length;
  const group = new Group();
  group.add(shaft, head);
  group.position.fromArray(from);
  group.quaternion.copy(new Quaternion().setFromUnitVectors(UP, new Vector3().fromArray(direction).normalize()));
  return group;
}

/** Makes a ball at a point. It is visible through the tube. */
export function makeBall(at, radius, colour) {
  const ball = new Mesh(new SphereGeometry(radius, 24, 16), new MeshBasicMaterial({ color: colour, depthTest: false }));
  ball.position.fromArray(at);
  ball.renderOrder = 3;
  return ball;
}

/** Makes the frame of the tip, x red, y green, z blue, over everything else. `moveTo(frames, index)` moves it. */
export function makeTipFrame(length) {
  const group = new Group();
  for (const [direction, colour] of [[[1, 0, 0], 0xd93a3a], [[0, 1, 0], 0x2f9e4f], [[0, 0, 1], 0x2f6fe0]]) {
    const axis = makeArrow([0, 0, 0], direction, length, colour);
    axis.children.forEach((part) => {
      part.material = new MeshBasicMaterial({ color: colour, depthTest: false, transparent: true });
      part.renderOrder = 5;
    });
    group.add(axis);
  }
  group.matrixAutoUpdate = false;
  const moveTo = (frames, f) => {
    const m = frames.subarray(f, f + 12);
    group.matrix.set(m[0], m[3], m[6], m[9], m[1], m[4], m[7], m[10], m[2], m[5], m[8], m[11], 0, 0, 0, 1);
    group.matrixWorldNeedsUpdate = true;
  };
  return { group, moveTo, length };
}

function centrelineGeometry(body, map = (x, y, z) => [x, y, z]) {
  const count = body.layers.count + 1;
  const position = new Float32Array(count * 3);
  for (let i = 0; i < count; i += 1) position.set(map(...body.frames.subarray(i * 12 + 9, i * 12 + 12)), i * 3);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(position, 3));
  return geometry;
}

/** Makes the dashed centreline of a body. It is visible through the tube. */
export function makeCentreline(body, colour, dash) {
  const material = new LineDashedMaterial({
    color: colour, dashSize: dash, gapSize: 0.6 * dash, depthTest: false, transparent: true,
  });
  const line = new Line(centrelineGeometry(body), material);
  line.computeLineDistances();
  line.renderOrder = 4;
  line.frustumCulled = false;
  return line;
}

/** Makes a fine line through points. It is visible through the tube. */
export function makeTrace(points, colour) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(points.flat()), 3));
  const line = new Line(geometry, new LineBasicMaterial({ color: colour, depthTest: false, transparent: true }));
  line.renderOrder = 4;
  line.frustumCulled = false;
  return line;
}

/** Makes the body's shadow on the floor. `show(layers)` sets its length. */
export function makeShadow(body, floor) {
  const geometry = centrelineGeometry(body, (x, y) => [x, y, floor]);
  const line = new Line(geometry, new LineBasicMaterial({ transparent: true, opacity: 0.55 }));
  line.frustumCulled = false;
  return { line, show: (layers) => geometry.setDrawRange(0, layers + 1) };
}

/** Makes a floor of squares of this size under a box. */
export function makeFloor(box, square, floor) {
  const [x0, y0] = [box.min.x, box.min.y].map((min) => Math.floor(min / square) - 1);
  const [x1, y1] = [box.max.x, box.max.y].map((max) => Math.ceil(max / square) + 1);
  const ends = [];
  for (let x = x0; x <= x1; x += 1) ends.push(x * square, y0 * square, floor, x * square, y1 * square, floor);
  for (let y = y0; y <= y1; y += 1) ends.push(x0 * square, y * square, floor, x1 * square, y * square, floor);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
  return new LineSegments(geometry, new LineBasicMaterial({ transparent: true }));
}
