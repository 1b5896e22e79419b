"""What Python costs beside Rust. All times are the min of some rounds, the loops by turns."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path
from typing import Callable

import numpy as np
import pytest

import growbot
from conftest import ROOT, START, goals

ROUNDS = 12


def least(*work: Callable[[], object]) -> list[float]:
    """The min time of each, s."""
    times = [float("inf")] * len(work)
    for _ in range(ROUNDS):
        for index, one in enumerate(work):
            begun = time.perf_counter()
            one()
            times[index] = min(times[index], time.perf_counter() - begun)
    return times


def test_a_plan_costs_2_us_more_and_many_5_percent(tmp_path: Path) -> None:
    # Far goals: the planner takes some 15 us, and Python shows.
    wanted = goals(4000, seed=11) * [3, 3, 3, 1, 1]
    file = tmp_path / "goals.csv"
    np.savetxt(file, wanted, delimiter=",", fmt="%r")
    loop = os.environ.get("RUST_LOOP", str(ROOT / "target/release/rust-loop"))
    start, poses = growbot.Pose(*START), [growbot.Pose(*goal) for goal in wanted]
    rust = float("inf")

    def in_rust() -> None:
        nonlocal rust
        rust = min(rust, float(subprocess.run([loop, str(file), "1"], capture_output=True, check=True).stdout))

    _, each, many = least(
        in_rust,
        lambda: [growbot.plan(start, pose) for pose in poses],
        lambda: growbot.plan_many(start, wanted, threads=1),
    )
    more = 1e6 * (each - rust) / len(wanted)
    print(f"a plan: {1e6 * rust / len(wanted):.2f} us in Rust, {more:.2f} us more from Python; plan_many {many / rust - 1:+.1%}")
    assert more <= 2.0
    assert many <= 1.05 * rust


def test_two_threads_grow_nearly_twice_as_fast() -> None:
    if (os.cpu_count() or 1) < 2:
        pytest.fail("this needs two cores")
    height = growbot.Robot().description["layer"]["height_mm"]
    plan = growbot.plan(START, (0, 0, 1000 * height - 0.1, 0, 90))
    assert plan.layer_count == 1000
    conditions = growbot.Conditions(noise_percent=10)
    count = 10_000 if os.environ.get("GROWBOT_PYTHON") == "complete" else 2_000
    seeds = np.arange(count)
    one, two = least(*(
        lambda threads=threads: growbot.simulate_many(plan, seeds, conditions=conditions, threads=threads)
        for threads in (1, 2)
    ))
    print(f"{count} growths of 1,000 layers: {one:.3f} s on one thread, {two:.3f} s on two, {one / two:.2f} times")
    assert one / two >= 1.8
