"""Overhead of Python over Rust, in counts: calls, objects and threads. `cost.py` measures the time."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path
from typing import Any, Callable

import numpy as np

import growbot
from conftest import START, goals

#: Program for a separate process: endless growths on two threads, and a plan at the same time.
BESIDE = """
import os, threading
import growbot

plan = growbot.plan((0, 0, 0, 0, 90), (0, 0, 500, 0, 90))
count = lambda: len(os.listdir("/proc/self/task"))
before = count()
threading.Thread(target=lambda: growbot.simulate_repeated(plan, 10**12, threads=2), daemon=True).start()
while count() < before + 3:
    pass
assert growbot.plan((0, 0, 0, 0, 90), (0, 0, 500, 0, 90)) == plan
print("planned", count() - before - 1, flush=True)
os._exit(0)
"""


def calls(work: Callable[[], object]) -> int:
    """Returns the number of functions that the interpreter calls."""
    count = 0

    def profile(frame: object, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    # A collection would call the finalizers of what other tests have left.
    gc.collect()
    gc.disable()
    sys.setprofile(profile)
    try:
        work()
    finally:
        sys.setprofile(None)
        gc.enable()
    return count


def test_a_plan_takes_one_call_and_many_take_no_more() -> None:
    start, wanted = growbot.Pose(*START), goals(1000, seed=11)
    nothing = calls(lambda: None)
    pose = growbot.Pose(*wanted[0])
    assert calls(lambda: growbot.plan(start, pose)) - nothing == 1
    assert calls(lambda: (growbot.plan(start, pose), growbot.plan(start, pose))) - nothing == 2
    # The first call makes numpy load more modules.
    growbot.plan_many(start, wanted[:10], threads=1)
    few, many = (calls(lambda: growbot.plan_many(start, wanted[:count], threads=1)) for count in (10, 1000))
    assert few == many


def test_a_plan_is_one_object_and_so_is_each_of_many() -> None:
    start, wanted = growbot.Pose(*START), goals(1000, seed=11)
    gc.disable()
    try:
        growbot.plan_many(start, wanted, threads=1)
        before = sys.getallocatedblocks()
        plans = growbot.plan_many(start, wanted, threads=1)
        more = sys.getallocatedblocks() - before
    finally:
        gc.enable()
    assert len(plans) == 1000
    assert 1000 <= more < 1100, f"{more} blocks of memory for 1,000 plans"


def test_growths_are_rows_of_one_array() -> None:
    plan = growbot.plan(START, (0, 0, 40, 0, 90))
    conditions = growbot.Conditions(noise_percent=10)
    few, many = (
        calls(lambda: growbot.simulate_many(plan, np.arange(count), conditions=conditions, threads=1))
        for count in (10, 1000)
    )
    assert few == many


def test_two_threads_grow_while_python_goes_on(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", BESIDE], capture_output=True, text=True, timeout=600, check=False)
    assert done.stdout == "planned 2\n", done.stderr
