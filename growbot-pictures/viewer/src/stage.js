// The picture: scene, light, camera, and when it is drawn. The camera is orthographic, so that the scale bar holds everywhere.

import {
  AmbientLight, Box3, Color, DirectionalLight, OrthographicCamera, Scene, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

const FROM = { front: [0, -1, 0], side: [1, 0, 0], top: [0, -1e-4, 1] };

/** Room for labels, legend and scale bar, pixels of the page. */
const MARGIN = { top: 24, bottom: 64, sides: 24 };

/** Of eight corners the one from which these directions are seen best from the side, the first most. */
function bestCorner(directions) {
  let best = { seen: -1 };
  for (let i = 0; i < 8; i += 1) {
    const turn = (-1.01 + i / 4) * Math.PI;
    const view = new Vector3(Math.cos(turn), Math.sin(turn), 0.45).normalize();
    const seen = directions.reduce((sum, direction, k) => {
      const along = new Vector3().fromArray(direction).normalize();
      // Rather towards the camera than away from it.
      return sum + (along.clone().cross(view).length() + 0.2 * along.dot(view)) / (k + 1);
    }, 0);
    if (seen > best.seen + 1e-9) best = { seen, view };
  }
  return best.view;
}

/** A stage on this canvas; `drawn` is called after each picture. */
export function makeStage(canvas, drawn) {
  const renderer = new WebGLRenderer({ canvas, antialias: true });
  renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
  const scene = new Scene();
  const camera = new OrthographicCamera(-1, 1, 1, -1);
  camera.up.set(0, 0, 1);
  const sun = new DirectionalLight(0xffffff, 2.4);
  sun.position.set(-0.5, 0.8, 1);
  camera.add(sun, sun.target);
  sun.target.position.set(0, 0, -1);
  scene.add(camera, new AmbientLight(0xffffff, 1.3));
  const controls = new OrbitControls(camera, canvas);
  controls.zoomToCursor = true;

  let [due, high] = [false, 1];
  const draw = () => {
    due = false;
    renderer.render(scene, camera);
    drawn(stage);
  };
  const redraw = () => {
    if (!due) requestAnimationFrame(draw);
    due = true;
  };
  let following = false;
  controls.addEventListener("change", () => {
    redraw();
    if (!following) stage.linked.forEach((other) => other !== stage && other.follow(stage));
  });

  const frustum = () => {
    const perPixel = (2 * high) / Math.max(1, canvas.clientHeight - MARGIN.top - MARGIN.bottom);
    const wide = (perPixel * canvas.clientWidth) / 2;
    Object.assign(camera, { left: -wide, right: wide, top: high + MARGIN.top * perPixel, bottom: -high - MARGIN.bottom * perPixel });
    camera.updateProjectionMatrix();
  };
  /** Aims at everything from there; returns how much is to be seen above and below the middle, mm. */
  const aim = (from) => {
    camera.position.copy(from);
    camera.lookAt(0, 0, 0);
    camera.updateMatrixWorld();
    const inverse = camera.matrixWorld.clone().invert();
    const seen = new Box3().setFromPoints(stage.points.map((point) => point.clone().applyMatrix4(inverse))).expandByScalar(stage.around);
    stage.centre = seen.getCenter(new Vector3()).applyMatrix4(camera.matrixWorld);
    const far = Math.max(1, stage.points.reduce((max, point) => Math.max(max, point.distanceTo(stage.centre)), 0) + stage.around);
    stage.distance = 4 * far;
    controls.target.copy(stage.centre);
    camera.position.copy(from).normalize().multiplyScalar(stage.distance).add(stage.centre);
    Object.assign(camera, { zoom: 1, near: 0.1 * far - stage.beyond, far: 9 * far + stage.beyond });
    camera.lookAt(stage.centre);
    const size = seen.getSize(new Vector3());
    const shape = (canvas.clientWidth - 2 * MARGIN.sides) / Math.max(1, canvas.clientHeight - MARGIN.top - MARGIN.bottom);
    return Math.max(1, 0.5 * Math.max(size.y, size.x / shape));
  };
  const spread = (half) => {
    high = half;
    frustum();
    controls.update();
    redraw();
  };
  /** Looks at everything from one side, on all that are linked at the same scale. */
  const look = (side) => {
    const from = side === "corner" ? bestCorner(stage.facing) : new Vector3().fromArray(FROM[side]);
    const half = Math.max(...stage.linked.map((one) => one.aim(from)));
    stage.linked.forEach((one) => one.spread(half));
  };
  /** Looks as the other does: from there, as near, and as far from the middle. */
  const follow = (other) => {
    following = true;
    controls.target.subVectors(other.controls.target, other.centre).add(stage.centre);
    camera.position.subVectors(other.camera.position, other.controls.target).setLength(stage.distance).add(controls.target);
    camera.zoom = other.camera.zoom;
    camera.updateProjectionMatrix();
    controls.update();
    redraw();
    following = false;
  };
  const stage = {
    scene, camera, controls, look, aim, spread, follow, redraw,
    /** What is to be seen: these points, and as much around them, mm. */
    points: [],
    around: 0,
    /** How far from its middle there is something that need not be seen, mm. */
    beyond: 0,
    /** Its middle and how far from there the camera is, mm, since it looked at everything. */
    centre: new Vector3(),
    distance: 1,
    /** The stages that turn together. */
    linked: [],
    /** The directions that the view from a corner is to show. */
    facing: [[0, 0, 1]],
    background: (colour) => {
      scene.background = new Color(colour);
      redraw();
    },
    /** Follows the size of the canvas in the page. */
    fit: () => {
      renderer.setSize(canvas.clientWidth, canvas.clientHeight, false);
      frustum();
      redraw();
    },
    /** Lengths in the picture, mm for each pixel of the page. */
    millimetresPerPixel: () => (camera.top - camera.bottom) / camera.zoom / Math.max(1, canvas.clientHeight),
    /** Where a point is in the picture, pixels of the page. */
    onScreen: (point) => {
      const seen = new Vector3().fromArray(point).project(camera);
      return [(0.5 + 0.5 * seen.x) * canvas.clientWidth, (0.5 - 0.5 * seen.y) * canvas.clientHeight];
    },
  };
  stage.linked = [stage];
  return stage;
}

/** Stages that turn together: from where all their directions are seen best, at the same scale, in elements of one size. */
export function linkStages(stages) {
  const max = Math.max(...stages.map((stage) => stage.facing.length));
  const facing = Array.from({ length: max }, (_, k) => stages.flatMap((stage) => stage.facing.slice(k, k + 1))).flat();
  for (const stage of stages) Object.assign(stage, { linked: stages, facing });
  stages[0].look("corner");
}
