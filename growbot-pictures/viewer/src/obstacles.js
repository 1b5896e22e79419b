// The scene of a body: translucent obstacles, and the point of least clearance.
//
// The input (growbot-pictures/src/view/page_data.rs) has these arrays, in mm:
//
// - `boxes`: 15 numbers each, centre, half sides and the axes by columns
// - `balls`: 4 numbers each, centre and radius
// - `capsules`: 7 numbers each, both ends of the axis and radius
// - `squares`: 12 numbers each, corners
// - `triangles`: one flat array, 9 numbers for each
// - `points`: one flat array, 4 numbers for each, centre and radius
//
// `narrowest` has `on_body`, `on_obstacle` and `label`.

import {
  BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, DoubleSide, Group, IcosahedronGeometry, InstancedMesh,
  Line, LineBasicMaterial,
  Matrix4, Mesh, MeshLambertMaterial, Quaternion, SphereGeometry, Vector3,
} from "three";
import { makeBall } from "./marks.js";

const UP = new Vector3(0, 1, 0);
const OPACITY = 0.26;
/** Opacity of half spaces, which are behind everything. */
const HALF_SPACE_OPACITY = 0.12;
/** Smallest radius of the balls of points, mm. */
const MIN_POINT_RADIUS_MM = 0.5;

function makeBox(given) {
  const mesh = new BoxGeometry(...given.slice(3, 6).map((half) => 2 * half));
  const [x, y, z] = [6, 9, 12].map((at) => new Vector3(...given.slice(at, at + 3)));
  return mesh.applyMatrix4(new Matrix4().makeBasis(x, y, z).setPosition(...given.slice(0, 3)));
}

function makeCapsule(given) {
  const [from, to] = [new Vector3(...given.slice(0, 3)), new Vector3(...given.slice(3, 6))];
  const along = to.clone().sub(from);
  const turn = new Quaternion().setFromUnitVectors(UP, along.clone().normalize());
  const middle = from.add(to).multiplyScalar(0.5);
  const placed = new Matrix4().makeRotationFromQuaternion(turn).setPosition(middle);
  return new CapsuleGeometry(given[6], along.length(), 8, 24).applyMatrix4(placed);
}

/** Makes a surface of triangles, 9 numbers each. */
function makeSurface(corners) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(corners), 3));
  geometry.computeVertexNormals();
  return geometry;
}

/** Makes balls of one shape, 4 numbers each. */
function makeBalls(shape, numbers, material) {
  const balls = new InstancedMesh(shape, material, numbers.length / 4);
  for (let i = 0; i < balls.count; i += 1) {
    const [x, y, z, radius] = numbers.slice(4 * i, 4 * i + 4);
    const scale = Array(3).fill(Math.max(MIN_POINT_RADIUS_MM, radius));
    balls.setMatrixAt(i, new Matrix4().makeScale(...scale).setPosition(x, y, z));
  }
  balls.frustumCulled = false;
  return balls;
}

/**
 * Returns the `group` of the obstacles, and the `mark` at the point of least clearance with a ball of this radius at
 * each end. `label` is the text of the mark, and `at` its position. `setColours(obstacles, mark)` sets the colours.
 * `greatestDistance(from)` returns the greatest distance of the obstacles from a point, mm.
 */
export function makeObstacles(given, radius) {
  const material = new MeshLambertMaterial({
    transparent: true, opacity: OPACITY, depthWrite: false, side: DoubleSide,
  });
  const triangles = [0, 1, 2, 0, 2, 3];
  const squares = given.squares.flatMap((square) => triangles.flatMap((i) => square.slice(3 * i, 3 * i + 3)));
  const geometries = [...given.boxes.map(makeBox), ...given.capsules.map(makeCapsule)];
  if (given.triangles.length > 0) geometries.push(makeSurface(given.triangles));
  const group = new Group();
  geometries.forEach((geometry) => group.add(new Mesh(geometry, material)));
  const faint = Object.assign(material.clone(), { opacity: HALF_SPACE_OPACITY });
  if (squares.length > 0) group.add(new Mesh(makeSurface(squares), faint));
  if (given.balls.length > 0) group.add(makeBalls(new SphereGeometry(1, 24, 16), given.balls.flat(), material));
  if (given.points.length > 0) group.add(makeBalls(new IcosahedronGeometry(1, 0), given.points, material));
  // Obstacles are drawn after everything opaque.
  group.children.forEach((part) => {
    part.renderOrder = 2;
  });

  const mark = new Group();
  const line = new LineBasicMaterial({ depthTest: false, transparent: true });
  const { narrowest } = given;
  if (narrowest) {
    const ends = [narrowest.on_body, narrowest.on_obstacle];
    const geometry = new BufferGeometry().setFromPoints(ends.map((end) => new Vector3(...end)));
    mark.add(new Line(geometry, line), ...ends.map((end) => makeBall(end, radius, 0)));
    // The mark is drawn over translucent obstacles, too.
    mark.children.forEach((part) => {
      part.material.transparent = true;
      part.renderOrder = 4;
    });
  }
  const setColours = (obstacles, colour) => {
    material.color.set(obstacles);
    faint.color.set(obstacles);
    mark.children.forEach((part) => part.material.color.set(colour));
  };
  const greatestDistance = (from) => {
    const centres = [given.balls.flat(), given.points].map(centresGeometry);
    const distances = [...geometries, makeSurface(squares), ...centres].flatMap((geometry) => {
      geometry.computeBoundingSphere();
      const sphere = geometry.boundingSphere;
      return sphere && sphere.radius >= 0 ? [sphere.center.distanceTo(from) + sphere.radius] : [];
    });
    return distances.reduce((a, b) => Math.max(a, b), 0);
  };
  const label = narrowest && `narrowest: ${narrowest.label}`;
  return { group, mark, setColours, greatestDistance, label, at: narrowest?.on_obstacle };
}

/** Returns the centres of balls, 4 numbers each, as a geometry. */
function centresGeometry(numbers) {
  const points = Array.from({ length: numbers.length / 4 }, (_, i) => new Vector3(...numbers.slice(4 * i, 4 * i + 3)));
  return new BufferGeometry().setFromPoints(points);
}
