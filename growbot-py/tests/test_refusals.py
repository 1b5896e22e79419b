"""Every function returns a result or raises a growbot.Error for any argument. None aborts or leaks memory."""

from __future__ import annotations

import gc
import math
import os
import pickle
import resource
from typing import Any, Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import growbot
from conftest import START

PLAN = growbot.plan(START, (0, 100, 400, 0, 45))
SPEC = growbot.CampaignSpec([growbot.Robot()], [(0, 0, 100)], [growbot.Conditions()], growths_per_cell=2)
SUMMARY = growbot.simulate_repeated(PLAN, 1)

#: All functions, with one argument each that takes any value.
FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "plan.start": lambda it: growbot.plan(it, (0, 0, 400)),
    "plan.goal": lambda it: growbot.plan(START, it),
    "plan.robot": lambda it: growbot.plan(START, (0, 0, 400), robot=it),
    "plan.radius_mm": lambda it: growbot.plan(START, (0, 0, 400), radius_mm=it),
    "plan.planner": lambda it: growbot.plan(START, (0, 0, 400), planner=it),
    "plan.via": lambda it: growbot.plan(START, (0, 0, 400), via=it),
    "plan.avoid_self_collision": lambda it: growbot.plan(START, (0, 0, 400), avoid_self_collision=it),
    "plan.scene": lambda it: growbot.plan(START, (0, 0, 400), scene=it),
    "plan.effort": lambda it: growbot.plan(START, (0, 0, 400), effort=it),
    "plan.time_limit_s": lambda it: growbot.plan(START, (0, 0, 400), time_limit_s=it),
    "plan_many.starts": lambda it: growbot.plan_many(it, [(0, 0, 400)]),
    "plan_many.goals": lambda it: growbot.plan_many(START, it),
    "plan_many.threads": lambda it: growbot.plan_many(START, [(0, 0, 400)], threads=it),
    "simulate_many.plans": lambda it: growbot.simulate_many(it, [1, 2]),
    "simulate_many.seeds": lambda it: growbot.simulate_many(PLAN, it),
    "simulate_many.conditions": lambda it: growbot.simulate_many(PLAN, [1], conditions=it),
    "simulate_repeated.plan": lambda it: growbot.simulate_repeated(it, 2),
    "simulate_repeated.count": lambda it: growbot.simulate_repeated(PLAN, 2 if _is_number(it) and it > 2 else it),
    "simulate_repeated.seed": lambda it: growbot.simulate_repeated(PLAN, 2, seed=it),
    "Pose.x_mm": lambda it: growbot.Pose(it, 0, 0, 0, 0),
    "Pose.heading_deg": lambda it: growbot.Pose(0, 0, 0, it, 0),
    "Pose.pitch_deg": lambda it: growbot.Pose(0, 0, 0, 0, it),
    "Pose.from_matrix": growbot.Pose.from_matrix,
    "Pose.from_direction": lambda it: growbot.Pose.from_direction((0, 0, 0), it),
    "Pose.from_direction.position": lambda it: growbot.Pose.from_direction(it, (0, 0, 1)),
    "Robot": growbot.Robot,
    "Robot.from_toml": growbot.Robot.from_toml,
    "Robot.from_description": growbot.Robot.from_description,
    "Scene": growbot.Scene,
    "Plan.load": growbot.Plan.load,
    "Plan.from_json": growbot.Plan.from_json,
    "Plan.sample": PLAN.sample,
    "Plan.frames": PLAN.frames,
    "Plan.save": lambda it: PLAN.save(it if not isinstance(it, str) else "/nowhere/plan.json"),
    "Plan.view": lambda it: PLAN.view("/nowhere/plan.html", browser=it) if not isinstance(it, bool) else None,
    "Plan.simulate.seed": lambda it: PLAN.simulate(seed=it),
    "Plan.simulate.conditions": lambda it: PLAN.simulate(conditions=it),
    "Conditions.noise_percent": lambda it: PLAN.simulate(conditions=growbot.Conditions(noise_percent=it)),
    "Conditions.feedback": lambda it: PLAN.simulate(conditions=growbot.Conditions(feedback=it)),
    "Conditions.slicing": lambda it: PLAN.simulate(conditions=growbot.Conditions(slicing=it)),
    "Conditions.step_mm": lambda it: PLAN.simulate(conditions=growbot.Conditions(slicing="whole", step_mm=it)),
    "SimulationSummary.from_json": growbot.SimulationSummary.from_json,
    "SimulationSummary.merged": SUMMARY.merged,
    "RunLog": growbot.RunLog,
    "connect.port": lambda it: growbot.connect(it).close(),
    "CampaignSpec.robots": lambda it: growbot.CampaignSpec(it, [(0, 0, 1)], [growbot.Conditions()], 1),
    "CampaignSpec.goals": lambda it: growbot.CampaignSpec([growbot.Robot()], it, [growbot.Conditions()], 1),
    "CampaignSpec.growths_per_cell": lambda it: growbot.CampaignSpec(
        [growbot.Robot()], [(0, 0, 1)], [growbot.Conditions()], it
    ),
    "run_campaign": growbot.run_campaign,
    "run_campaign.scheduler": lambda it: growbot.run_campaign(SPEC, it),
    "run_campaign.threads": lambda it: growbot.run_campaign(SPEC, threads=it),
    "run_chunk": lambda it: growbot.run_chunk(SPEC, it),
}

NUMBERS: list[Any] = [math.nan, math.inf, -math.inf, -1, 0, 1e300, -1e300, 2**70, -(2**70), 10**400, 1e-320, True]
#: Arrays of many shapes, some without memory.
ARRAYS: list[Any] = [
    np.zeros((0, 5)),
    np.zeros((0,)),
    np.zeros((3, 3, 3)),
    np.full((2, 5), np.nan),
    np.zeros((2, 5), dtype=complex),
    np.array([["a", "b"]]),
    np.zeros((2, 5), dtype=object),
    np.broadcast_to(0.0, (10**11, 5)),
    np.zeros(5)[::-1],
    np.broadcast_to(0.0, (10**13,)),
    np.broadcast_to(np.int8(1), (10**12,)),
    np.zeros((2, 5)),
    np.datetime64("2026-01-01"),
    np.ma.masked_array([1.0, 2.0], [True, False]),
]
OTHERS: list[Any] = [
    None,
    "",
    "abc",
    "\0",
    "a" * 100_000,
    b"abc",
    object(),
    object,
    [],
    {},
    set(),
    [[]],
    [None],
    [[1, 2], [3]],
    lambda: 1,
    range(3),
    iter([1]),
    1j,
    PLAN,
    SUMMARY,
    growbot.Pose(*START),
    growbot.Robot(),
    growbot.Conditions(),
    Ellipsis,
    {"x": 1},
    [[[[1]]]],
    ("sim",),
    growbot.Error("no"),
    "/",
    "/dev/zero",
    "/nowhere/at-all",
    "{}",
    "[1]",
    "tcp:nowhere",
    "null",
]


def _is_number(it: Any) -> bool:
    return isinstance(it, (int, float, np.number))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_anything(name: str) -> None:
    for it in NUMBERS + ARRAYS + OTHERS:
        try:
            FUNCTIONS[name](it)
        except growbot.Error as error:
            assert 0 < len(str(error)) < 2000, (name, it)
            again = pickle.loads(pickle.dumps(error))
            assert type(again) is type(error) and str(again) == str(error) and again.code == error.code
        except (OSError, MemoryError):
            assert name in ("Plan.view",), name


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(sorted(FUNCTIONS)),
    st.recursive(
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats()
        | st.text(max_size=8).map(lambda text: "?" + text)
        | st.binary(max_size=8),
        lambda inner: (
            st.lists(inner, max_size=6)
            | st.tuples(inner, inner, inner)
            | st.dictionaries(st.text(max_size=3), inner, max_size=3)
        ),
        max_leaves=8,
    ),
)
def test_anything_at_random(name: str, it: Any) -> None:
    try:
        FUNCTIONS[name](it)
    except growbot.Error as error:
        assert str(error)
    except OSError:
        assert name == "Plan.view"


def test_refusals_tell_value_and_limit() -> None:
    for call, kind, value, limit in [
        (lambda: growbot.plan(START, (0, 0, 400), radius_mm=5), growbot.InputError, 5.0, 98.2),
        (lambda: growbot.Pose(0, 0, 2e7, 0, 0), growbot.InputError, 2e7, 1e7),
        (lambda: growbot.Pose(0, 0, 0, 0, 91), growbot.InputError, 91.0, 90.0),
        (lambda: PLAN.frames(1e6), growbot.InputError, 1e6, PLAN.length_mm),
        (lambda: PLAN.sample(1), growbot.InputError, 1.0, 2.0),
        (lambda: PLAN.simulate(seed=-1), growbot.InputError, -1.0, 0.0),
        (lambda: PLAN.simulate(conditions=growbot.Conditions(noise_percent=91)), growbot.InputError, 91.0, 90.0),
        (lambda: growbot.plan_many(START, np.broadcast_to(0.0, (2_000_000, 5))), growbot.InputError, 2e6, 1e6),
        (
            lambda: growbot.plan_many(START, [[1, 2]]),
            growbot.InputTypeError,
            "(1, 2)",
            "an array of shape (n, 3) or (n, 5)",
        ),
        (lambda: growbot.plan("up", (0, 0, 1)), growbot.InputTypeError, None, None),
    ]:
        with pytest.raises(kind) as refused:
            call()
        assert value is None or (refused.value.value, refused.value.limit) == (value, limit), str(refused.value)
    with pytest.raises(growbot.InputError, match="row 1: pitch is 95 deg"):
        growbot.plan_many(START, [(0, 0, 1, 0, 0), (0, 0, 1, 0, 95)])
    assert issubclass(growbot.InputError, ValueError) and issubclass(growbot.InputTypeError, TypeError)


def resident() -> int:
    """Returns the memory of this process, bytes."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def test_nothing_leaks() -> None:
    calls = 100_000 if os.environ.get("GROWBOT_PYTHON") == "complete" else 10_000
    short = growbot.plan(START, (0, 0, 5, 0, 90))
    noisy = growbot.Conditions(noise_percent=1)

    def refused() -> None:
        try:
            growbot.Pose(0, 0, math.nan, 0, 0)
        except growbot.Error:
            pass

    functions: list[Callable[[], Any]] = [
        lambda: growbot.plan(START, (10, 0, 60)),
        lambda: growbot.plan_many(START, [(0, 0, 60)], threads=1),
        lambda: short.layers(),
        lambda: short.sample(5),
        lambda: short.frames([0, 1]),
        lambda: short.segments,
        lambda: short.simulate(conditions=noisy),
        lambda: growbot.simulate_many(short, [1, 2], threads=1),
        lambda: pickle.loads(pickle.dumps(short)),
        lambda: short.to_json(),
        lambda: growbot.simulate_repeated(short, 2, threads=1),
        lambda: growbot.Pose(1, 2, 3, 4, 5).matrix,
        lambda: SUMMARY.merged(SUMMARY),
        lambda: growbot.Robot("growbot-a"),
        refused,
    ]
    for function in functions:
        for _ in range(300):
            function()
    gc.collect()
    before = resident()
    each = calls // len(functions)
    for function in functions:
        for _ in range(each):
            function()
    gc.collect()
    # The limit is less than a small object for each call.
    assert resident() - before < max(calls * 24, 2_000_000)


def test_a_name_of_another_release_is_refused_with_the_known_ones() -> None:
    for name in ("Simulated", "Summary", "repeat", "Partial", "campaign", "merge"):
        with pytest.raises(AttributeError) as refused:
            getattr(growbot, name)
        assert str(refused.value).startswith(f"growbot has no {name!r} in this release: use one of Board, BoardError, ")
        assert "simulate_repeated" in str(refused.value)
