// The subject of a page: a plan or a growth, from the page's data.

import { decodeLayers, growBody } from "./body.js";

/**
 * Returns `given` with its bodies: `planned`, `built` (null for a plan), `existing` (null unless they begin at the tip
 * of another body), `body`, which is the one that the slider grows, and the robot's `sizes`, mm.
 */
export function readSubject(given) {
  const { robot } = given;
  const planned = growBody(given.start, decodeLayers(given.planned));
  const built = given.built === null ? null : growBody(given.start, decodeLayers(given.built));
  const existing = given.existing && growBody(given.existing.start, decodeLayers(given.existing.layers));
  const sizes = { outerRadius: robot.outer_radius_mm, tipRadius: robot.tip_radius_mm, wall: robot.wall_mm };
  return { ...given, planned, built, existing, body: built ?? planned, sizes };
}
