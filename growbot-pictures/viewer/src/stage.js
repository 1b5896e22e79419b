// Scene, light, camera and drawing of a picture. The camera is orthographic, so the scale bar is valid everywhere.

import {
  AmbientLight, Box3, Color, DirectionalLight, OrthographicCamera, Scene, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { isEmbedded } from "./embedding.js";

const VIEW_DIRECTIONS = { front: [0, -1, 0], side: [1, 0, 0], top: [0, -1e-4, 1] };

/** Margins for labels, legend and scale bar, pixels of the page. In a frame, buttons lie on the picture. */
const MARGIN = { top: isEmbedded ? 60 : 24, bottom: 64, sides: 24 };

const KEPT_VIEW = "growbot-kept-view";
/** Time for which a view is kept. The page that takes it over is made meanwhile. */
const KEEP_MS = 60_000;

/** Returns the one of eight corners that shows these directions best. The first direction has the most weight. */
function bestCorner(directions) {
  let best = { score: -1 };
  for (let i = 0; i < 8; i += 1) {
    const turn = (-1.01 + i / 4) * Math.PI;
    const view = new Vector3(Math.cos(turn), Math.sin(turn), 0.45).normalize();
    const score = directions.reduce((sum, direction, k) => {
      const along = new Vector3().fromArray(direction).normalize();
      // Directions that point to the camera are preferred.
      return sum + (along.clone().cross(view).length() + 0.2 * along.dot(view)) / (k + 1);
    }, 0);
    if (score > best.score + 1e-9) best = { score, view };
  }
  return best.view;
}

/** Makes a stage on this canvas. `drawn` is called after each picture. */
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

  let [isDrawPending, halfHeight] = [false, 1];
  const draw = () => {
    isDrawPending = false;
    renderer.render(scene, camera);
    drawn(stage);
  };
  const redraw = () => {
    if (!isDrawPending) requestAnimationFrame(draw);
    isDrawPending = true;
  };
  let following = false;
  controls.addEventListener("change", () => {
    redraw();
    if (!following) stage.linked.forEach((other) => other !== stage && other.follow(stage));
  });

  const updateFrustum = () => {
    const perPixel = (2 * halfHeight) / Math.max(1, canvas.clientHeight - MARGIN.top - MARGIN.bottom);
    const halfWidth = (perPixel * canvas.clientWidth) / 2;
    Object.assign(camera, {
      left: -halfWidth, right: halfWidth,
      top: halfHeight + MARGIN.top * perPixel, bottom: -halfHeight - MARGIN.bottom * perPixel,
    });
    camera.updateProjectionMatrix();
  };
  /** Aims the camera at everything from a direction. Returns half of the height that must be visible, mm. */
  const aimCamera = (direction) => {
    camera.position.copy(direction);
    camera.lookAt(0, 0, 0);
    camera.updateMatrixWorld();
    const inverse = camera.matrixWorld.clone().invert();
    const cameraPoints = stage.points.map((point) => point.clone().applyMatrix4(inverse));
    const box = new Box3().setFromPoints(cameraPoints).expandByScalar(stage.margin);
    stage.centre = box.getCenter(new Vector3()).applyMatrix4(camera.matrixWorld);
    const farthest = stage.points.reduce((max, point) => Math.max(max, point.distanceTo(stage.centre)), 0);
    const radius = Math.max(1, farthest + stage.margin);
    stage.distance = 4 * radius;
    controls.target.copy(stage.centre);
    camera.position.copy(direction).normalize().multiplyScalar(stage.distance).add(stage.centre);
    const { obstacleDistance } = stage;
    Object.assign(camera, { zoom: 1, near: 0.1 * radius - obstacleDistance, far: 9 * radius + obstacleDistance });
    camera.lookAt(stage.centre);
    const size = box.getSize(new Vector3());
    const height = Math.max(1, canvas.clientHeight - MARGIN.top - MARGIN.bottom);
    const aspect = (canvas.clientWidth - 2 * MARGIN.sides) / height;
    return Math.max(1, 0.5 * Math.max(size.y, size.x / aspect));
  };
  const setHalfHeight = (half) => {
    halfHeight = half;
    updateFrustum();
    controls.update();
    redraw();
  };
  /** Shows everything from one side, on all linked stages at the same scale. */
  const setViewpoint = (viewpoint) => {
    const isCorner = viewpoint === "corner";
    const direction = isCorner ? bestCorner(stage.facing) : new Vector3().fromArray(VIEW_DIRECTIONS[viewpoint]);
    const half = Math.max(...stage.linked.map((one) => one.aimCamera(direction)));
    stage.linked.forEach((one) => one.setHalfHeight(half));
  };
  /** Takes over the view of another stage: direction, zoom and offset from the centre. */
  const follow = (other) => {
    following = true;
    controls.target.subVectors(other.controls.target, other.centre).add(stage.centre);
    const direction = camera.position.subVectors(other.camera.position, other.controls.target);
    direction.setLength(stage.distance).add(controls.target);
    camera.zoom = other.camera.zoom;
    camera.updateProjectionMatrix();
    controls.update();
    redraw();
    following = false;
  };
  /** Keeps the view for the next page in this frame, which shows a body in its place. */
  const keepView = () => {
    const { position, zoom } = camera;
    const until = Date.now() + KEEP_MS;
    const view = { position: position.toArray(), target: controls.target.toArray(), zoom, halfHeight, until };
    sessionStorage.setItem(KEPT_VIEW, JSON.stringify(view));
  };
  /** Takes over the kept view, if there is one. */
  const restoreView = () => {
    const kept = JSON.parse(sessionStorage.getItem(KEPT_VIEW));
    sessionStorage.removeItem(KEPT_VIEW);
    if (!kept || Date.now() > kept.until) return;
    camera.position.fromArray(kept.position);
    controls.target.fromArray(kept.target);
    camera.zoom = kept.zoom;
    setHalfHeight(kept.halfHeight);
  };
  /** Moves the camera without turning it, so that this point is in the middle. */
  const lookAt = (point) => {
    const move = new Vector3().fromArray(point).sub(controls.target);
    camera.position.add(move);
    controls.target.add(move);
    controls.update();
    redraw();
  };
  const stage = {
    scene, camera, controls, setViewpoint, aimCamera, setHalfHeight, follow, keepView, restoreView, lookAt, redraw,
    /** Points that must be visible, and the margin around them, mm. */
    points: [],
    margin: 0,
    /** Greatest distance of optional objects from the centre, mm. */
    obstacleDistance: 0,
    /** Centre, and distance of the camera from it, mm, set by `aimCamera`. */
    centre: new Vector3(),
    distance: 1,
    /** Stages that turn together. */
    linked: [],
    /** Directions that the view from a corner shows best. */
    facing: [[0, 0, 1]],
    background: (colour) => {
      scene.background = new Color(colour);
      redraw();
    },
    /** Adapts the picture to the size of the canvas in the page. */
    resize: () => {
      renderer.setSize(canvas.clientWidth, canvas.clientHeight, false);
      updateFrustum();
      redraw();
    },
    /** Returns the scale of the picture, mm for each pixel of the page. */
    millimetresPerPixel: () => (camera.top - camera.bottom) / camera.zoom / Math.max(1, canvas.clientHeight),
    /** Returns the position of a point in the picture, pixels of the page. */
    toScreen: (point) => {
      const projected = new Vector3().fromArray(point).project(camera);
      return [(0.5 + 0.5 * projected.x) * canvas.clientWidth, (0.5 - 0.5 * projected.y) * canvas.clientHeight];
    },
    /** Returns the point at this position in the picture, pixels of the page, that is as far away as another point. */
    fromScreen: ([x, y], { depthOf }) => {
      const { z } = new Vector3().fromArray(depthOf).project(camera);
      const [right, up] = [(2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight];
      return new Vector3(right, up, z).unproject(camera).toArray();
    },
  };
  stage.linked = [stage];
  return stage;
}

/**
 * Links stages that turn together. They start with the viewpoint that shows all their directions best, at the same
 * scale. Their elements must have the same size.
 */
export function linkStages(stages) {
  const max = Math.max(...stages.map((stage) => stage.facing.length));
  const facing = Array.from({ length: max }, (_, k) => stages.flatMap((stage) => stage.facing.slice(k, k + 1))).flat();
  for (const stage of stages) Object.assign(stage, { linked: stages, facing });
  stages[0].setViewpoint("corner");
}
