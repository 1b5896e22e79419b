"""Compares growbot's planners with others and prints one table. tests/peers/run sets everything up and calls this.

All planners get the same queries in one run. In each round, the planners are timed in batches, one after the other. A
ratio is the median of the rounds' ratios.
"""

import argparse
import collections
import datetime
import functools
import gc
import importlib.metadata
import json
import math
import platform
import random
import statistics
import subprocess
import tempfile
import time

import growbot
from ompl import base, util

# Max excess of a path's length over the best known length, radii. A longer path is too long.
TOO_LONG = 1e-9
# Tolerance at the goal, radii and radians. It is so small that a path cannot save TOO_LONG by it.
ARRIVES = 1e-10
# Number of queries of a family that are timed repeatedly. They are few enough to stay in the processor's cache for all
# planners, in any form.
TIMED = 500
# Interpolation parameter just below 1. Interpolation at 1 returns the goal itself, wherever the path ends.
NEARLY_ALL = 1 - 2.0**-40

OMPL = importlib.metadata.version("ompl")

SIDES = {"L": 1, "R": -1, "S": 0}
WORDS = ("LSL", "RSR", "LSR", "RSL", "LRL", "RLR")


def wrapped(angle):
    """Returns the angle between -pi and pi."""
    return math.remainder(angle, math.tau)


def laid_out(start, word, lengths):
    """Returns the end of a path in the plane."""
    x, y, heading = start
    for piece, length in zip(word, lengths):
        turn = SIDES[piece] * length
        chord = 2 * math.sin(length / 2) if turn else length
        x += chord * math.cos(heading + turn / 2)
        y += chord * math.sin(heading + turn / 2)
        heading += turn
    return x, y, heading


# Queries in the plane: start, goal, and the length of a path that is known to lead there, or infinity.

ORIGIN = 0.0, 0.0, 0.0


def anywhere(rng):
    return rng.uniform(-10, 10), rng.uniform(-10, 10), rng.uniform(-math.pi, math.pi)


def random_goal(rng, farthest=10):
    (x, y, heading), distance, direction = anywhere(rng), rng.uniform(0, farthest), rng.uniform(-math.pi, math.pi)
    goal = x + distance * math.cos(direction), y + distance * math.sin(direction), rng.uniform(-math.pi, math.pi)
    return (x, y, heading), goal, math.inf


def known(start, word, lengths):
    return start, laid_out(start, word, lengths), sum(lengths)


def pieces(rng, words, least=0.0, most=math.tau):
    """Returns a path with arcs of random angles in this range and straight lines of up to 10 R."""
    word = rng.choice(words)
    lengths = [rng.uniform(0, 10) if piece == "S" else rng.uniform(least, most) for piece in word]
    return known(ORIGIN, word, lengths)


def antiparallel(rng):
    x = rng.choice((0.0, rng.uniform(-10, 10)))
    y = rng.choice((0.0, 2.0, -2.0, 4.0, -4.0, rng.uniform(-10, 10)))
    return ORIGIN, (x, y, math.pi), math.inf


def tiny(rng, start):
    size, share = 10 ** rng.uniform(-12, -3), rng.random()
    return known(start, rng.choice(WORDS), (size * share, size * (1 - share), size * share * share))


PLANE = {
    "random, 0 to 10 R": random_goal,
    "random, 0 to 4 R": lambda rng: random_goal(rng, farthest=4),
    "one arc, below pi": lambda rng: pieces(rng, "LR", most=math.pi),
    "one arc, above pi": lambda rng: pieces(rng, "LR", least=math.pi),
    "two tangent arcs, below pi": lambda rng: pieces(rng, ("LR", "RL"), most=math.pi),
    "two tangent arcs, any": lambda rng: pieces(rng, ("LR", "RL")),
    "arc, straight": lambda rng: pieces(rng, ("LS", "RS")),
    "straight, arc": lambda rng: pieces(rng, ("SL", "SR")),
    "straight ahead": lambda rng: pieces(rng, "S"),
    "start is goal": lambda rng: (ORIGIN, (0.0, 0.0, rng.randint(-3, 3) * math.tau), 0.0),
    "turned on the spot": lambda rng: (ORIGIN, (0.0, 0.0, rng.uniform(-math.pi, math.pi)), math.inf),
    "antiparallel": antiparallel,
    "tiny steps from the origin": lambda rng: tiny(rng, ORIGIN),
    "tiny steps from anywhere": lambda rng: tiny(rng, anywhere(rng)),
}

DISTANCES = (0.5, 1, 2, 3, 4, 8, 16, 32)


def direction(rng):
    """Returns a direction in space, uniformly distributed: heading and pitch."""
    return rng.uniform(-math.pi, math.pi), math.asin(rng.uniform(-1, 1))


def unit(heading, pitch):
    return math.cos(pitch) * math.cos(heading), math.cos(pitch) * math.sin(heading), math.sin(pitch)


def pair_of_poses(rng, distance):
    where = unit(*direction(rng))
    return (0.0, 0.0, 0.0, *direction(rng)), (*(distance * part for part in where), *direction(rng))


class Helper:
    """The program that finds and times paths of growbot, dubins_paths and the C library."""

    def __init__(self, program):
        self.process = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, **request):
        try:
            self.process.stdin.write(json.dumps(request) + "\n")
            self.process.stdin.flush()
            reply = self.process.stdout.readline()
        except BrokenPipeError:
            reply = ""
        if not reply:
            program = self.process.args[0]
            raise SystemExit(f"compare.py: {program} gave no answer to {request['do']}: see its message above")
        return json.loads(reply)


class Helped:
    """A planner in the helper program. Paths found are (length, distance of its end from the goal) or None."""

    call = None

    def __init__(self, helper, name, pairs):
        self.helper, self.name, self.pairs = helper, name, pairs

    def found(self):
        for (start, goal), path in zip(self.pairs, self.helper.ask(do="paths", planner=self.name)):
            if path is None:
                yield None
            elif "miss" in path:
                yield path["length"], path["miss"]
            else:
                x, y, heading = laid_out(start, path["word"], path["lengths"])
                miss = max(math.hypot(x - goal[0], y - goal[1]), abs(wrapped(heading - goal[2])))
                yield sum(path["lengths"]), miss

    def time(self, passes):
        return self.helper.ask(do="time", planner=self.name, passes=passes)


class Ompl:
    """A planner of OMPL, called through its Python package."""

    def __init__(self, space, dimension, starts, goals):
        bounds = base.RealVectorBounds(dimension)
        bounds.setLow(-1e6)
        bounds.setHigh(1e6)
        space.setBounds(bounds)
        space.setup()
        self.space = space
        self.starts, self.goals = [self.state(at) for at in starts], [self.state(at) for at in goals]
        # A call of the same form, two states in and a number out, with a space whose distance takes no time.
        self.trivial = base.SO2StateSpace()
        self.trivial_states = [self.trivial.allocState() for _ in starts]

    def state(self, reals):
        state = self.space.allocState()
        if len(reals) == 5:
            x, y, z, heading, pitch = reals
            reals = x, y, z, pitch, heading
        self.space.copyFromReals(state, list(reals))
        return state

    def reals(self, state):
        reals = [self.space.getValueAddressAtIndex(state, index) for index in range(self.space.getDimension())]
        return reals if len(reals) == 3 else [*reals[:3], reals[4], reals[3]]

    def found(self):
        end = self.space.allocState()
        for start, goal in zip(self.starts, self.goals):
            path = self.space.getPath(start, goal)
            if path is None:
                yield None
                continue
            length = self.space.distance(start, goal)
            self.space.interpolate(start, goal, NEARLY_ALL, end)
            *at, heading = self.reals(end)
            *wanted, wanted_heading = self.reals(goal)
            if len(at) == 2:
                towards, turned = (math.cos(heading), math.sin(heading)), abs(wrapped(heading - wanted_heading))
            else:
                *at, yaw = at
                *wanted, wanted_yaw = wanted
                towards = unit(yaw, heading)
                turned = math.dist(towards, unit(wanted_yaw, wanted_heading))
            rest = length * (1 - NEARLY_ALL)
            yield length, max(math.dist([a + rest * d for a, d in zip(at, towards)], wanted), turned)

    def time(self, passes):
        self.call = timed(self.trivial.distance, self.trivial_states, self.trivial_states, passes)
        return timed(self.space.distance, self.starts, self.goals, passes)


def python_call(loop, rounds=10, count=4000, batch=50):
    """Returns the additional time of growbot.plan over the planner in Rust, ns per call, for goals 3 to 30 radii away.

    The time of a batch is the min of its rounds, so that other work on the machine has no effect.
    """
    generator = random.Random(2026)
    goals = [
        [*(generator.uniform(300, 1700) * generator.choice((-1, 1)) for _ in range(3)), generator.uniform(-180, 180),
         generator.uniform(-90, 90)]
        for _ in range(count)
    ]
    start, poses = growbot.Pose(0, 0, 0, 0, 90), [growbot.Pose(*goal) for goal in goals]
    batches = [poses[at : at + batch] for at in range(0, count, batch)]
    in_rust = in_python = [math.inf] * len(batches)
    with tempfile.NamedTemporaryFile("w", suffix=".csv") as file:
        file.writelines(",".join(map(repr, goal)) + "\n" for goal in goals)
        file.flush()
        for _ in range(rounds):
            done = subprocess.run([loop, file.name, str(batch), "1"], capture_output=True, check=True)
            in_rust = list(map(min, in_rust, (1e9 * float(line) / batch for line in done.stdout.split())))
            in_python = list(map(min, in_python, (timed(growbot.plan, [start] * batch, some, 1) for some in batches)))
    return statistics.mean(in_python) - statistics.mean(in_rust)


def timed(function, starts, goals, passes):
    """Returns nanoseconds per call, with as little Python around it as possible."""
    gc.disable()
    began = time.perf_counter_ns()
    for _ in range(passes):
        collections.deque(map(function, starts, goals), maxlen=0)
    nanoseconds = time.perf_counter_ns() - began
    gc.enable()
    return nanoseconds / (passes * len(starts))


def in_plane(helper, pairs):
    """Returns all planners in the plane by name."""
    helper.ask(do="load_plane", pairs=pairs)
    planners = {name: Helped(helper, name, pairs) for name in ("growbot", "dubins_paths", "dubins")}
    return planners | {"ompl": Ompl(base.DubinsStateSpace(1.0), 2, *zip(*pairs))}


def in_space(helper, ours, pairs):
    """Returns all planners in space by name."""
    helper.ask(do="load_space", pairs=pairs)
    planners = {name: Helped(helper, name, pairs) for name in ours}
    spaces = {"vana": base.VanaStateSpace, "vana-owen": base.VanaOwenStateSpace}
    return planners | {name: Ompl(space(1.0, math.pi / 2), 3, *zip(*pairs)) for name, space in spaces.items()}


def compare(load, pairs, bounds, rounds, batch):
    """Requests all paths from all planners, and times them.

    `load` returns the planners for pairs of start and goal. `bounds` are lengths of paths that are known beforehand.
    `batch` is the duration of a batch, ns.
    """
    found = {name: list(planner.found()) for name, planner in load(pairs).items()}
    best = [
        min([bound, *(path[0] for path in paths if path and path[1] <= ARRIVES)])
        for bound, *paths in zip(bounds, *found.values())
    ]
    pairs = pairs[:TIMED]
    planners = load(pairs)
    passes = {name: max(1, round(batch / (planner.time(1) * len(pairs)))) for name, planner in planners.items()}
    times, calls = collections.defaultdict(list), collections.defaultdict(list)
    for _ in range(rounds):
        for name, planner in planners.items():
            times[name].append(planner.time(passes[name]))
            calls[name].append(planner.call or 0.0)
    return {
        name: {
            "arriving": [path[0] if path and path[1] <= ARRIVES else None for path in paths],
            "too_long": sum(path is None or path[0] > least + TOO_LONG for path, least in zip(paths, best)) / len(best),
            "longest_excess": max((path[0] - least for path, least in zip(paths, best) if path), default=math.nan),
            "no_path": sum(path is None for path in paths) / len(paths),
            "misses": sum(path is not None and path[1] > ARRIVES for path in paths) / len(paths),
            "worst_miss": max((path[1] for path in paths if path), default=math.nan),
            "ns": times[name],
            "call_ns": calls[name],
        }
        for name, paths in found.items()
    }


def percent(share):
    if share == 0:
        return "0"
    return f"{100 * share:.2g} %" if abs(share) < 0.1 else f"{100 * share:.0f} %"


def signed(share):
    return "0" if share == 0 else f"{100 * share:+.1f} %" if abs(share) >= 0.001 else f"{100 * share:+.1g} %"


def excess(length):
    return "0" if length <= TOO_LONG else f"{length:.2g}" if length < 1 else f"{length:.2f}"


def ratio(value):
    return f"{value:.3f}" if value < 0.1 else f"{value:.2f}" if value < 10 else f"{value:.0f}"


HEADER = (
    "goals",
    "growbot's",
    "the other",
    "time, ours / theirs",
    "less the call",
    "too long, ours",
    "theirs",
    "at most by, R: ours",
    "theirs",
    "theirs miss",
    "length, ours - theirs: mean",
    "greatest",
)


def row(goals, ours_name, theirs_name, ours, theirs):
    """Returns one line of the table: a planner of growbot and another planner, for one family of queries."""
    both = [(a, b) for a, b in zip(ours["arriving"], theirs["arriving"]) if a is not None and b is not None]
    differences = [0.0 if abs(a - b) <= TOO_LONG else (a - b) / b if b > 0 else math.inf for a, b in both]
    whole = statistics.median(a / b for a, b in zip(ours["ns"], theirs["ns"]))
    call = statistics.median(theirs["call_ns"])
    net = statistics.median(a / (b - call) for a, b in zip(ours["ns"], theirs["ns"])) if call else None
    return (
        goals,
        ours_name,
        theirs_name,
        ratio(whole),
        ratio(net) if net else "-",
        percent(ours["too_long"]),
        percent(theirs["too_long"]),
        excess(ours["longest_excess"]),
        excess(theirs["longest_excess"]),
        percent(theirs["misses"]),
        signed(statistics.fmean(differences)) if both else "-",
        signed(max(differences)) if both else "-",
    )


def printed(rows):
    """Returns a table in Markdown with aligned columns."""
    widths = [max(len(cells[column]) for cells in (HEADER, *rows)) for column in range(len(HEADER))]
    rule = ["-" * widths[c] if c < 3 else "-" * (widths[c] - 1) + ":" for c in range(len(HEADER))]
    lines = [HEADER, rule, *rows]
    aligned = [
        [cell.ljust(width) if c < 3 else cell.rjust(width) for c, (cell, width) in enumerate(zip(line, widths))]
        for line in lines
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in aligned)


def cpu():
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    return names[0] if names else platform.machine()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--helper", required=True, help="the program of tests/peers/src")
    parser.add_argument("--plan-bench", required=True, help="the program of growbot-plan/examples/plan_bench.rs")
    parser.add_argument("--versions", required=True, help="versions to print above the table")
    parser.add_argument("--dubins-paths", required=True, help="version of the crate dubins_paths")
    parser.add_argument("--dubins", required=True, help="version of the C library")
    parser.add_argument("--table", required=True, help="where the table goes, beside standard output")
    parser.add_argument("--json", required=True, help="where the figures go that the table sums up")
    parser.add_argument("--quick", action="store_true", help="fewer queries, fewer rounds")
    args = parser.parse_args()

    util.noOutputHandler()
    rounds, batch = (5, 5e6) if args.quick else (21, 20e6)
    plane_queries, space_queries = (1000, 100) if args.quick else (10_000, 1000)
    helper = Helper(args.helper)
    ours = helper.ask(do="planners")["space"]
    called = {
        "growbot": "plane",
        "dubins_paths": f"dubins_paths {args.dubins_paths}",
        "dubins": f"dubins {args.dubins}, C",
        "ompl": f"OMPL {OMPL}, Dubins",
        "vana": f"OMPL {OMPL}, Vana",
        "vana-owen": f"OMPL {OMPL}, Vana-Owen",
    }
    rows, figures = [], {}

    for family, query in PLANE.items():
        rng = random.Random(f"growbot {family}")
        queries = [query(rng) for _ in range(plane_queries)]
        pairs = [(start, goal) for start, goal, _ in queries]
        bounds = [bound for _, _, bound in queries]
        results = figures[family] = compare(functools.partial(in_plane, helper), pairs, bounds, rounds, batch)
        for name in ("dubins_paths", "dubins", "ompl"):
            rows.append((family, "growbot", name, results))

    for distance in DISTANCES:
        family = f"in space, {distance} R away"
        rng = random.Random(f"growbot {family}")
        pairs = [pair_of_poses(rng, distance) for _ in range(space_queries)]
        bounds = [math.inf] * len(pairs)
        results = figures[family] = compare(functools.partial(in_space, helper, ours), pairs, bounds, rounds, batch)
        rows += [(family, mine, name, results) for mine in ours for name in ("vana", "vana-owen")]

    table = printed(
        [row(goals, called.get(a, a), called[b], results[a], results[b]) for goals, a, b, results in rows]
    )
    every = [(family, name, result) for family, results in figures.items() for name, result in results.items()]
    calls = statistics.median(ns for family in PLANE for ns in figures[family]["ompl"]["call_ns"])
    worst = collections.defaultdict(float)
    for _, name, result in every:
        if result["misses"]:
            worst[name] = max(worst[name], result["worst_miss"])
    missing = "; ".join(f"{called.get(name, name)} by at most {miss:.0e}" for name, miss in worst.items()) or "None do"
    nowhere = [(family, name, percent(result["no_path"])) for family, name, result in every if result["no_path"]]
    without = "; ".join(f"{family}: {called.get(name, name)} {share}" for family, name, share in nowhere) or "never"
    text = f"""\
{datetime.date.today()}, {cpu()}; {args.versions}, OMPL {OMPL}{", quick run" if args.quick else ""}

{table}

- {plane_queries} queries a family in the plane, {space_queries} in space. Times: medians of {rounds} rounds' ratios.
- growbot's planner in the plane takes goals as the start sees them: converting them is in its time. Its planners in
  space check that the path arrives: that is in their time. OMPL is called from Python; "less the call": without what an
  empty call from Python takes ({calls:.0f} ns here). growbot's own package for Python adds
  {python_call(args.plan_bench):.0f} ns to a call of its planner: poses, checks, and a plan with its layers counted.
- Vana and Vana-Owen: pitch from -90 to 90 deg.
- Too long: by more than {TOO_LONG:.0e} R, beside the shortest path that is known to arrive: the one by which the goal
  was laid out, or any planner's that does. In space that is the best of those compared, not the shortest there is.
- Miss: end further from the goal than {ARRIVES:.0e} R, or rad. {missing}.
- Length, ours - theirs: in percent of theirs, negative where growbot's path is shorter; only where both arrive.
- No path at all: {without}.
"""
    print(text)
    with open(args.table, "w", encoding="utf-8") as file:
        file.write(text)
    for _, _, result in every:
        del result["arriving"]
    with open(args.json, "w", encoding="utf-8") as file:
        json.dump(figures, file, indent=1)


main()
