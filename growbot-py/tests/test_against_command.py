"""Python's results equal the command's to the last bit."""

from __future__ import annotations

import csv
import io
import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import growbot
from conftest import START, goals, run

#: Goals whose layers and growths are compared too. With GROWBOT_PYTHON=complete all are.
LAYERS = 1000 if os.environ.get("GROWBOT_PYTHON") == "complete" else 100
NOISY = growbot.Conditions(noise_percent=10, tilt_noise_deg=0.02, twist_bias_deg=0.01)
NOISY_OPTIONS = ("--noise", "10", "--tilt-noise", "0.02", "--twist-bias", "0.01")


def test_a_thousand_goals(command: Path, tmp_path: Path) -> None:
    wanted = goals(1000)
    header = "id,to_x_mm,to_y_mm,to_z_mm,to_heading_deg,to_pitch_deg\n"
    rows = "".join(f"{i}," + ",".join(repr(float(number)) for number in goal) + "\n" for i, goal in enumerate(wanted))
    answers = [
        json.loads(line) for line in run(command, "plan", "--batch", "-", "--json", stdin=header + rows).splitlines()
    ]
    plans = growbot.plan_many(START, wanted)
    for plan, goal, answer in zip(plans, wanted, answers, strict=True):
        assert plan == growbot.plan(START, goal)
        assert (plan.length_mm, plan.layer_count) == (answer["length_mm"], answer["layers"])
        assert (plan.duration_s, plan.filament_mm) == (answer["duration_s"], answer["filament_mm"])
        assert plan.path_type == answer["path_type"]
        assert [warning.code for warning in plan.warnings] == [warning["code"] for warning in answer["warnings"]]
        for segment, fields in zip(plan.segments, answer["segments"], strict=True):
            assert all(getattr(segment, name) == value for name, value in fields.items())

    def compare(index: int) -> None:
        plan, file = plans[index], str(tmp_path / f"{index}.json")
        plan.save(file)
        # A plan's file has its angles in degrees, and both read them.
        read = growbot.Plan.load(file)
        assert read.length_mm == plan.length_mm
        rows = list(csv.reader(io.StringIO(run(command, "layers", file))))
        layers = read.layers()
        assert tuple(rows[0]) == layers.dtype.names
        assert np.array_equal(np.array(rows[1:], dtype=float), np.array(layers.tolist(), dtype=float))
        options = ("--json", "--seed", str(index), *NOISY_OPTIONS)
        assert_same_growth(
            read.simulate(seed=index, conditions=NOISY), json.loads(run(command, "simulate", file, *options))
        )
        # The same comparison without a file.
        to = "--to=" + ",".join(repr(float(number)) for number in wanted[index])
        output = json.loads(run(command, "simulate", to, "--planner", "shortest", *options))
        assert_same_growth(plan.simulate(seed=index, conditions=NOISY), output)

    with ThreadPoolExecutor() as pool:
        assert len(list(pool.map(compare, range(LAYERS)))) == LAYERS


def assert_same_growth(grown: growbot.SimulationResult, output: dict[str, object]) -> None:
    names = (
        "position_error_mm", "normalized_position_error", "heading_error_deg", "pitch_error_deg",
        "direction_error_deg", "length_mm", "seed",
    )
    assert {name: getattr(grown, name) for name in names} == {name: output[name] for name in names}
    assert grown.layer_count == output["layers"]
    final = output["final"]
    assert isinstance(final, dict)
    pose = grown.final_pose
    assert [final[name] for name in ("x_mm", "y_mm", "z_mm")] == [pose.x_mm, pose.y_mm, pose.z_mm]


def test_all_conditions(command: Path, tmp_path: Path) -> None:
    growbot.plan(START, (300, 200, 400, -40, 10)).save(tmp_path / "plan.json")
    plan = growbot.Plan.load(tmp_path / "plan.json")
    for conditions, options in [
        (growbot.Conditions(), ()),
        (
            growbot.Conditions(bias_percent=-5, alpha_bias_deg=1, tilt_bias_percent=2),
            ("--bias", "-5", "--alpha-bias", "1", "--tilt-bias", "2"),
        ),
        (growbot.Conditions(alpha_noise_deg=2, twist_noise_deg=0.1), ("--alpha-noise", "2", "--twist-noise", "0.1")),
        (growbot.Conditions(noise_percent=10, feedback=True), ("--noise", "10", "--feedback")),
        (
            growbot.Conditions(
                noise_percent=10,
                feedback=True,
                gravity_only=True,
                odometry_scale_percent=1,
                odometry_noise_percent=2,
                direction_noise_deg=0.3,
            ),
            (
                "--noise",
                "10",
                "--feedback",
                "--gravity-only",
                "--odometry-scale",
                "1",
                "--odometry-noise",
                "2",
                "--direction-noise",
                "0.3",
            ),
        ),
        (growbot.Conditions(sag=True), ("--sag",)),
        (growbot.Conditions(slicing="whole", step_mm=3.096), ("--slice", "whole", "--step", "3.096")),
    ]:
        output = json.loads(run(command, "simulate", str(tmp_path / "plan.json"), "--json", "--seed", "7", *options))
        grown = plan.simulate(seed=7, conditions=conditions)
        assert_same_growth(grown, output)
        assert grown.estimated_pose is None or grown.estimated_pose.x_mm == output["feedback"]["estimate"]["x_mm"]


def test_simulate_repeated(command: Path, tmp_path: Path) -> None:
    growbot.plan(START, (100, 0, 300, 20, 30)).save(tmp_path / "plan.json")
    plan = growbot.Plan.load(tmp_path / "plan.json")
    # More growths than are stored at a time.
    output = json.loads(
        run(
            command,
            "simulate",
            str(tmp_path / "plan.json"),
            "--json",
            "--repeat",
            "20000",
            "--seed",
            "5",
            *NOISY_OPTIONS,
        )
    )
    summary = growbot.simulate_repeated(plan, 20_000, seed=5, conditions=NOISY)
    assert summary.growth_count == 20_000 and summary.layer_count == output["layers"]
    errors = (
        "position_error_mm",
        "normalized_position_error",
        "heading_error_deg",
        "pitch_error_deg",
        "direction_error_deg",
    )
    for name in errors:
        assert getattr(summary, name) == output[name]
    assert summary.worst_seed == output["worst_seed"]
    rows = growbot.simulate_many(plan, np.arange(5, 205), conditions=NOISY)
    assert [plan.simulate(seed=int(row["seed"]), conditions=NOISY).position_error_mm for row in rows] == list(
        rows["position_error_mm"]
    )
