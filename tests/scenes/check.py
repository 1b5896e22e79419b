"""Checks paths through scenes, as `families` of growbot-scene writes them, with geometry of trimesh, SciPy and its own.

    check.py DIRECTORY COUNT

The program computes each path again from its start, segment by segment, from the angle of each arc. The segments must
join, bend no more than allowed, and end at the goal. No point of the path, every 0.5 mm, may be nearer to an obstacle
than the body needs. A failed check ends the program with a message and exit code 1.
"""

import collections
import json
import math
import sys
from pathlib import Path

import numpy
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

# Distance between two points of a path, mm, and max rounding errors, mm and radians.
APART = 0.5
ROUNDING = 1e-6
REACHED = 1e-6
# Min fraction of the planted paths that are found within 1 s. All must be found within 10 s.
SOON, WITHIN = 0.95, 10


def demand(holds, message):
    if not holds:
        sys.exit(f"tests/scenes: {message}")


def centreline(name, scene):
    """Returns points of the path, and its last direction."""
    position, direction = map(numpy.array, scene["start"])
    points = [position]
    for piece in scene["path"]:
        demand(math.dist(piece["position"], position) < ROUNDING, f"{name}: two pieces are apart")
        demand(math.dist(piece["direction"], direction) < ROUNDING, f"{name}: a kink between two pieces")
        length, curvature = piece["length"], piece["curvature"]
        demand(curvature <= (1 + 1e-9) / scene["radius"], f"{name}: a bend is too tight")
        along = numpy.linspace(0, length, max(2, math.ceil(length / APART) + 1))[1:]
        if curvature == 0:
            points.extend(position + direction * at for at in along)
        else:
            # The arc is a rotation about the axis through its centre.
            towards = numpy.array(piece["towards"])
            demand(abs(towards @ direction) < ROUNDING, f"{name}: an arc bends along itself")
            centre, axis = position + towards / curvature, numpy.cross(direction, towards)
            turns = Rotation.from_rotvec(numpy.outer(along * curvature, axis))
            points.extend(centre + turns.apply(position - centre))
            direction = turns[-1].apply(direction)
        position = points[-1]
    return numpy.array(points), direction


def distance_from_shape(shape, points):
    """Returns distances of points from a shape, 0 inside, computed by SciPy and NumPy."""
    if shape["kind"] == "box":
        turn = numpy.array(shape["rotation_by_columns"]).reshape(3, 3)
        # The matrix is stored by columns, so each row here is an axis of the box.
        inside = (points - shape["centre"]) @ turn.T
        return numpy.linalg.norm(numpy.maximum(numpy.abs(inside) - shape["half"], 0), axis=1)
    if shape["kind"] == "ball":
        return numpy.maximum(numpy.linalg.norm(points - shape["centre"], axis=1) - shape["radius"], 0)
    start, way = numpy.array(shape["from"]), numpy.array(shape["to"]) - numpy.array(shape["from"])
    share = numpy.clip((points - start) @ way / (way @ way), 0, 1)
    return numpy.maximum(numpy.linalg.norm(points - start - share[:, None] * way, axis=1) - shape["radius"], 0)


def clearance(scene, points):
    """Returns the min distance of the points from all obstacles, mm."""
    least = [distance_from_shape(shape, points).min() for shape in scene["shapes"]]
    if scene["points"]:
        least.append(cKDTree(scene["points"]).query(points)[0].min() - scene["point_radius"])
    if scene["faces"]:
        corners = numpy.array(scene["faces"]).reshape(-1, 3)
        mesh = trimesh.Trimesh(corners, numpy.arange(len(corners)).reshape(-1, 3), process=False)
        least.append(trimesh.proximity.closest_point(mesh, points)[1].min())
    return min(least, default=math.inf)


def check(name, scene):
    """Checks a path and returns the clearance beyond the needed one, mm."""
    points, direction = centreline(name, scene)
    goal, towards = scene["goal"]
    demand(math.dist(points[-1], goal) < REACHED, f"{name}: ends {math.dist(points[-1], goal)} mm from the goal")
    if scene["goal_has_direction"]:
        demand(math.dist(direction, towards) < REACHED, f"{name}: arrives in another direction")
    spare = clearance(scene, points) - scene["need"]
    demand(spare >= -ROUNDING, f"{name}: {-spare} mm too near to an obstacle")
    return spare


def main():
    directory, count = Path(sys.argv[1]), int(sys.argv[2])
    files = sorted(directory.iterdir())
    demand(len(files) == count, f"{len(files)} scenes of {count}")
    families = collections.defaultdict(collections.Counter)
    tightest = collections.defaultdict(lambda: math.inf)
    for file in files:
        scene = json.loads(file.read_text())
        counts, known, found = families[scene["family"]], scene["known"], scene["path"] is not None
        counts[known] += 1
        counts[f"{known}, found"] += found
        counts["soon"] += found and known == "planted" and scene["seconds"] <= 1
        counts["late"] += known == "planted" and scene["seconds"] > WITHIN
        if found:
            tightest[scene["family"]] = min(tightest[scene["family"]], check(file.stem, scene))
    print(
        f"{'family':10} {'planted':>8} {'found':>6} {'in 1 s':>7} {'sealed':>7} {'found':>6} {'others':>7} {'found':>6} "
        f"{'spare, mm':>10}"
    )
    for family, counts in families.items():
        keys = ["planted", "planted, found", "soon", "sealed", "sealed, found", "nothing", "nothing, found"]
        numbers = [f"{counts[key]:>{width}}" for key, width in zip(keys, (8, 6, 7, 7, 6, 7, 6))]
        print(f"{family:10} {' '.join(numbers)} {tightest[family]:>10.4f}")
    total = sum(families.values(), collections.Counter())
    demand(total["planted, found"] == total["planted"] and not total["late"], "a planted path was not found in time")
    demand(total["soon"] >= SOON * total["planted"], "too few planted paths were found within 1 s")
    demand(total["sealed, found"] == 0, "a path into a sealed box")


main()
