// What is looked at: a plan or a growth, from what the page was given of it.

import { decodeLayers, growBody } from "./body.js";

/**
 * `given` with its bodies grown: `planned`, `built` (null for a plan), `body`, the one of them that is grown by the slider, and the
 * robot's `sizes`, mm.
 */
export function readSubject(given) {
  const { robot } = given;
  const planned = growBody(given.start, decodeLayers(given.planned));
  const built = given.built === null ? null : growBody(given.start, decodeLayers(given.built));
  const sizes = { outerRadius: robot.outer_radius_mm, tipRadius: robot.tip_radius_mm, wall: robot.wall_mm };
  return { ...given, planned, built, body: built ?? planned, sizes };
}
