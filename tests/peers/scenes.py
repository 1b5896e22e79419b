"""Plans through the random scenes of growbot-scene with OMPL's RRT* and BIT*, in the spaces of Vana and Vana-Owen.

    scenes.py DIRECTORY_1_S DIRECTORY_10_S

`tests/peers/run --scenes` calls it. The directories contain scenes and growbot's paths through them, found within 1 s
and 10 s. The example `families` of growbot-scene writes them with `best`. Only scenes with a planted path and a goal
with a direction count. OMPL tests states at its own resolution (a hundredth of the space's extent). This program checks
each of its paths again, every 0.5 mm.
"""

import collections
import json
import math
import statistics
import sys
from pathlib import Path

import numpy
from ompl import base, geometric, util
from scipy.spatial import cKDTree

# Margin of the space in which OMPL draws states, beyond scene, start and goal, mm.
ROOM = 300
# Distance between two checked points of a path, mm.
APART = 0.5
PLANNERS = {"RRT*": geometric.RRTstar, "BIT*": geometric.BITstar}
SPACES = {"Vana": base.VanaStateSpace, "Vana-Owen": base.VanaOwenStateSpace}


class Obstacles:
    """Distance of a point from the nearest obstacle. Inside a mesh it is the distance from the surface."""

    def __init__(self, scene):
        shapes = collections.defaultdict(list)
        for shape in scene["shapes"]:
            shapes[shape["kind"]].append(shape)
        of = lambda kind, name: numpy.array([shape[name] for shape in shapes[kind]])
        self.boxes = self.balls = self.capsules = self.faces = self.points = None
        if shapes["box"]:
            rotations = of("box", "rotation_by_columns").reshape(-1, 3, 3)
            self.boxes = of("box", "centre"), of("box", "half"), rotations
        if shapes["ball"]:
            self.balls = of("ball", "centre"), of("ball", "radius")
        if shapes["capsule"]:
            self.capsules = of("capsule", "from"), of("capsule", "to"), of("capsule", "radius")
        if scene["faces"]:
            self.faces = numpy.array(scene["faces"], dtype=float).transpose(1, 0, 2)
        if scene["points"]:
            self.points, self.point_radius = cKDTree(scene["points"]), scene["point_radius"]

    def distance(self, point):
        found = [math.inf]
        if self.boxes:
            centre, half, rotation = self.boxes
            beside = numpy.abs(numpy.einsum("nij,nj->ni", rotation, point - centre)) - half
            outside = numpy.linalg.norm(numpy.maximum(beside, 0), axis=1)
            found.append((outside + numpy.minimum(beside.max(axis=1), 0)).min())
        if self.balls:
            centre, radius = self.balls
            found.append((numpy.linalg.norm(point - centre, axis=1) - radius).min())
        if self.capsules:
            start, end, radius = self.capsules
            found.append((from_segments(point, start, end) - radius).min())
        if self.faces is not None:
            found.append(from_triangles(point, *self.faces).min())
        if self.points:
            found.append(self.points.query(point)[0] - self.point_radius)
        return min(found)


def from_segments(point, start, end):
    along = end - start
    share = numpy.einsum("ij,ij->i", point - start, along) / numpy.einsum("ij,ij->i", along, along)
    return numpy.linalg.norm(point - start - along * numpy.clip(share, 0, 1)[:, None], axis=1)


def from_triangles(point, a, b, c):
    normal = numpy.cross(b - a, c - a)
    normal /= numpy.linalg.norm(normal, axis=1)[:, None]
    above = numpy.einsum("ij,ij->i", point - a, normal)
    foot = point - normal * above[:, None]
    inside = numpy.ones(len(a), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= numpy.einsum("ij,ij->i", numpy.cross(end - start, foot - start), normal) >= 0
    edges = numpy.minimum.reduce([from_segments(point, *ends) for ends in ((a, b), (b, c), (c, a))])
    return numpy.where(inside, numpy.abs(above), edges)


def bounds_of(scene):
    points = [scene["start"][0], scene["goal"][0], *scene["points"]]
    for face in scene["faces"]:
        points.extend(face)
    for shape in scene["shapes"]:
        points.extend(shape[name] for name in ("centre", "from", "to") if name in shape)
    bounds = base.RealVectorBounds(3)
    for axis, values in enumerate(zip(*points)):
        bounds.setLow(axis, min(values) - ROOM)
        bounds.setHigh(axis, max(values) + ROOM)
    return bounds


def setup_of(scene, space_of, planner_of):
    """Returns the problem for OMPL."""
    obstacles, need = Obstacles(scene), scene["need"]
    space = space_of(scene["radius"], math.pi / 2)
    space.setBounds(bounds_of(scene))
    space.setup()
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    at = lambda state: numpy.array([space.getValueAddressAtIndex(state, index) for index in range(3)])
    setup.setStateValidityChecker(lambda state: bool(obstacles.distance(at(state)) >= need))
    ends = [space.allocState() for _ in range(2)]
    for state, (place, towards) in zip(ends, (scene["start"], scene["goal"])):
        heading, pitch = math.atan2(towards[1], towards[0]), math.asin(max(-1.0, min(1.0, towards[2])))
        space.copyFromReals(state, [*place, pitch, heading])
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(planner_of(information))
    return setup, space, obstacles, at


def nearest(setup, space, obstacles, at):
    """Returns the min distance from an obstacle along the path found, checked every 0.5 mm."""
    states = setup.getSolutionPath().getStates()
    here, least = space.allocState(), math.inf
    for start, end in zip(states, states[1:]):
        count = max(1, math.ceil(space.distance(start, end) / APART))
        for index in range(count + 1):
            space.interpolate(start, end, index / count, here)
            least = min(least, obstacles.distance(at(here)))
    return least


def main():
    util.noOutputHandler()
    one, ten = map(Path, sys.argv[1:3])
    files = sorted(path.name for path in one.glob("*.json"))
    scenes = {name: json.loads((one / name).read_text()) for name in files}
    asked = [name for name, scene in scenes.items() if scene["known"] == "planted" and scene["goal_has_direction"]]
    results, refused = collections.defaultdict(dict), {}
    for name in asked:
        for planner, planner_of in PLANNERS.items():
            for kind, space_of in SPACES.items():
                setup, space, obstacles, at = setup_of(scenes[name], space_of, planner_of)
                for seconds, more in ((1, 1), (10, 9)):
                    try:
                        setup.solve(float(more))
                    except RuntimeError as error:
                        refused[planner] = error
                        break
                    if setup.haveExactSolutionPath():
                        length = setup.getSolutionPath().length()
                        touches = nearest(setup, space, obstacles, at) < scenes[name]["need"] - 1e-6
                        results[f"OMPL {planner}, {kind}", seconds][name] = length, touches
                last = results[f"OMPL {planner}, {kind}", 10].get(name)
                print(name, planner, kind, last, file=sys.stderr, flush=True)
    for name in asked:
        for seconds, directory in ((1, one), (10, ten)):
            path = json.loads((directory / name).read_text())["path"]
            if path:
                results["growbot", seconds][name] = sum(piece["length"] for piece in path), False
    ran = [planner for planner in PLANNERS if planner not in refused]
    names = ["growbot", *(f"OMPL {planner}, {kind}" for planner in ran for kind in SPACES)]
    print(f"{len(asked)} scenes\n")
    print("| planner | seconds | found | of these in contact between samples | median length | against growbot's |")
    print("|---|---|---|---|---|---|")
    for name in names:
        for seconds in (1, 10):
            found, ours = results[name, seconds], results["growbot", seconds]
            lengths = [length for length, _ in found.values()]
            ratios = [length / ours[scene][0] for scene, (length, _) in found.items() if scene in ours]
            median = f"{statistics.median(lengths):.0f} mm" if lengths else "-"
            ratio = f"{statistics.median(ratios):.3f}" if ratios else "-"
            touching = sum(touches for _, touches in found.values())
            print(f"| {name} | {seconds} | {len(found)} | {touching} | {median} | {ratio} |")
    for planner, error in refused.items():
        print(f"\n{planner} does not run in these spaces: {error}")


main()
