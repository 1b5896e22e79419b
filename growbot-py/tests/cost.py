"""Prints the cost of Python compared with Rust, and the gain of two threads. Run it on a machine without other work. It
checks nothing.

    cargo build --release -p growbot-plan --example plan_bench
    python growbot-py/tests/cost.py [PLAN_BENCH]

Each batch of work takes about a millisecond. The rounds alternate, and the min of a batch's rounds counts.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Callable

import numpy as np

import growbot
from conftest import ROOT, START, goals

GOALS, BATCH, GROWTHS, ROUNDS = 1000, 50, 200, 20


def seconds(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def plans(loop: str, directory: Path) -> None:
    # The planner is fastest for distant goals, so the cost of Python is visible.
    wanted = goals(GOALS, seed=11) * [3, 3, 3, 1, 1]
    file = directory / "goals.csv"
    file.write_text("".join(",".join(repr(float(number)) for number in goal) + "\n" for goal in wanted))
    start = growbot.Pose(*START)
    batches = [wanted[at : at + BATCH] for at in range(0, GOALS, BATCH)]
    poses = [[growbot.Pose(*goal) for goal in batch] for batch in batches]
    rust = each = many = np.full(len(batches), np.inf)
    for _ in range(ROUNDS):
        lines = subprocess.run([loop, str(file), str(BATCH), "3"], capture_output=True, check=True).stdout.split()
        rust = np.minimum(rust, [float(line) for line in lines])
        each = np.minimum(each, [seconds(lambda: [growbot.plan(start, pose) for pose in batch]) for batch in poses])
        many = np.minimum(many, [seconds(lambda: growbot.plan_many(start, batch, threads=1)) for batch in batches])
    more = 1e6 * float(each.sum() - rust.sum()) / GOALS
    part = float(many.sum() / rust.sum()) - 1
    print(f"a plan: {1e6 * rust.sum() / GOALS:.2f} us in Rust, {more:.2f} us more from Python; plan_many {part:+.1%}")


def growths() -> None:
    height = growbot.Robot().description["layer"]["height_mm"]
    plan = growbot.plan(START, (0, 0, 1000 * height - 0.1, 0, 90))
    conditions = growbot.Conditions(noise_percent=10)
    batches = np.arange(10_000).reshape(-1, GROWTHS)
    times, used = np.full((2, len(batches)), np.inf), np.full((2, len(batches)), np.inf)
    for _ in range(ROUNDS):
        for index, seeds in enumerate(batches):
            for threads in (1, 2):
                begun = time.process_time()
                took = seconds(lambda: growbot.simulate_many(plan, seeds, conditions=conditions, threads=threads))
                processors = time.process_time() - begun
                times[threads - 1, index] = min(times[threads - 1, index], took)
                used[threads - 1, index] = min(used[threads - 1, index], processors)
    gain, alike = (float(np.divide(*each.sum(axis=1))) for each in (times, used))
    print(
        f"10,000 growths of 1,000 layers: {gain:.2f} times as fast on two threads; "
        f"of the processors {1 / alike:.2f} times"
    )


def begin() -> None:
    code = "import time; begun = time.process_time(); import growbot; print(time.process_time() - begun)"
    times = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout) for _ in range(7)
    ]
    print(f"import growbot: {1e3 * min(times):.0f} ms of a processor")


if __name__ == "__main__":
    begin()
    with tempfile.TemporaryDirectory() as directory:
        plans(sys.argv[1] if len(sys.argv) > 1 else str(ROOT / "target/release/examples/plan_bench"), Path(directory))
    growths()
