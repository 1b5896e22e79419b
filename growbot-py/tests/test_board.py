"""Growths on the simulated board."""

from __future__ import annotations

import json
import math
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import growbot
from conftest import START, run

PLAN = growbot.plan(START, (5, 0, 60, 0, 85))


def comparable(log: Path) -> list[dict[str, object]]:
    """Returns the lines of a run log without what may differ: times, port, command line and the statuses, whose number
    depends on how often the program asks."""
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    dropped = ("utc", "started_utc", "command_line", "port")
    return [{key: line[key] for key in line if key not in dropped} for line in lines if line["event"] != "status"]


@pytest.mark.parametrize(
    ("options", "conditions", "seed"),
    [
        ((), None, None),
        (("--feedback",), growbot.Conditions(feedback=True), None),
        (("--noise", "5", "--seed", "3"), growbot.Conditions(noise_percent=5), 3),
    ],
)
def test_a_growth_leaves_the_log_of_the_command(
    command: Path,
    tmp_path: Path,
    options: tuple[str, ...],
    conditions: growbot.Conditions | None,
    seed: int | None,
) -> None:
    file, ours, theirs = tmp_path / "plan.json", tmp_path / "python.jsonl", tmp_path / "command.jsonl"
    PLAN.save(file)
    run(command, "grow", str(file), "--port", "sim", "--log", str(theirs), *options)
    with growbot.connect("sim") as board:
        board.grow(growbot.Plan.load(file), conditions=conditions, seed=seed, log=ours).wait()
    assert comparable(ours) == comparable(theirs)


def test_a_growth_is_its_events(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    conditions = growbot.Conditions(noise_percent=5)
    with growbot.connect("sim") as board:
        assert board.simulated
        growth = board.grow(PLAN, conditions=conditions, seed=3, log=log)
        assert growth.result is None
        seen = list(growth)
        result = growth.result
        assert result is not None and result["outcome"] == "done" and result["simulated"] and result["seed"] == 3
        status = board.status()
        assert status["state"] == "done" and status["sensors"]["supply_v"] > 11
    laid = [event.layer for event in seen if isinstance(event, growbot.events.LayerLaid)]
    assert laid == list(range(PLAN.layer_count))
    states = [event.state for event in seen if isinstance(event, growbot.events.StateChanged)]
    assert states[-4:] == ["heating", "homing", "growing", "done"]
    run = growbot.RunLog(log)
    assert (run.outcome, run.simulated, run.damage, run.plan) == (
        "done",
        True,
        None,
        growbot.Plan.from_json(PLAN.to_json()),
    )
    assert run.result == result and len(run.layers()) == PLAN.layer_count
    simulated = run.simulated_layers()
    assert simulated is not None and len(simulated) == PLAN.layer_count
    of_log = list(run.events())
    assert [event for event in of_log if not isinstance(event, (growbot.events.Other, growbot.events.Ended))] == [
        event for event in seen if not isinstance(event, growbot.events.Other)
    ]
    assert isinstance(of_log[-1], growbot.events.Ended) and "simulated" in run.html()
    assert pickle.loads(pickle.dumps(run)) == run
    # The board lays the same layers as the command's. Without one the noise is the same, but layers are not in steps.
    assert abs(PLAN.simulate(seed=3, conditions=conditions).position_error_mm - result["position_error_mm"]) < 0.5
    with growbot.connect() as board, pytest.raises(growbot.FileError, match="already exists.*overwrite=True"):
        board.grow(PLAN, log=log, force=True, ignore_scene=True).wait()
    with growbot.connect() as board:
        assert board.grow(PLAN, log=log, overwrite=True).wait()["outcome"] == "done"


def test_feedback_amends_the_body() -> None:
    conditions = growbot.Conditions(bias_percent=5, feedback=True)
    with growbot.connect("sim") as board:
        growth = board.grow(PLAN, conditions=conditions)
        assert growbot.events.Amendment in {type(event) for event in growth}
        assert growth.result is not None and growth.result["feedback"]["amendments"] > 0


def test_orders_and_leaving_stop_it() -> None:
    with growbot.connect("sim") as board:
        growth = board.grow(PLAN)
        for event in growth:
            if isinstance(event, growbot.events.LayerLaid) and event.layer == 3:
                growth.send_command("stop")
        assert growth.result is not None and growth.result["outcome"] == "stopped"
        with pytest.raises(growbot.InputError, match="unknown command"):
            growth.send_command("jump")
        for event in board.grow(PLAN):
            break
        assert board.status()["state"] is not None
        growth = board.grow(PLAN)
        next(growth)
        with pytest.raises(growbot.BoardError, match="in progress"):
            board.status()
    assert growth.ended and growth.result is not None and growth.result["outcome"] == "stopped"
    with pytest.raises(growbot.BoardError, match="disconnected"):
        board.status()


def test_what_cannot_be_grown_is_refused() -> None:
    with growbot.connect("sim") as board:
        meets, empties = growbot.plan(START, (20, 10, 60, 0, 80)), growbot.plan(START, (0, 0, 4000, 0, 90))
        for call, words, code in [
            (lambda: board.grow(meets), "because of self-collision.*force", "plan-warnings"),
            (lambda: board.grow(empties), "because of filament-short.*force", "plan-warnings"),
            (lambda: board.grow(PLAN, conditions=growbot.Conditions(sag=True)), "without a board", None),
            (lambda: board.grow(PLAN, log="/nowhere/run.jsonl").wait(), "/nowhere/run.jsonl", None),
        ]:
            with pytest.raises(growbot.Error, match=words) as refused:
                call()
            assert refused.value.code == code
        twisted = growbot.plan(START, (20, 10, 60, 0, 80))
        with pytest.raises(growbot.InputError, match="self-collision.*force=True"):
            board.grow(twisted, ignore_scene=True, overwrite=True)
    with pytest.raises(growbot.InputError, match="unknown"):
        growbot.connect("nowhere")
    with pytest.raises(growbot.BoardError, match="127.0.0.1:9"):
        growbot.connect("tcp:127.0.0.1:9")


INTERRUPTED = """
import sys
import growbot
plan = growbot.plan((0, 0, 0, 0, 90), (0, 0, 2000, 0, 90))
with growbot.connect("sim") as board:
    growth = board.grow(plan, log=sys.argv[1])
    try:
        for event in growth:
            if isinstance(event, growbot.events.LayerLaid) and event.layer == 1:
                print("growing", flush=True)
    finally:
        board.close()
        print("closed", growth.result["outcome"], flush=True)
"""


def test_ctrl_c_stops_the_robot_first(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, str(log)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "growing\n"
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=600)
    assert out == "closed stopped\n" and "KeyboardInterrupt" in error
    assert growbot.RunLog(log).outcome == "stopped"


def test_ctrl_c_ends_long_work() -> None:
    script = (
        "import growbot; p = growbot.plan((0,0,0,0,90),(0,0,500,0,90)); print('on', flush=True); "
        "growbot.simulate_repeated(p, 10**9)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "on\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    assert "KeyboardInterrupt" in process.communicate(timeout=600)[1]


def test_the_emulator(command: Path) -> None:
    """The firmware in QEMU heats in real time. With GROWBOT_PYTHON=complete it also grows."""
    image = Path(__file__).resolve().parents[2] / "target/thumbv7em-none-eabihf/firmware/an386"
    if not image.exists():
        raise AssertionError("build the image: cargo build-an386")
    quick = growbot.plan(START, (0, 0, 8, 0, 90), robot="growbot-a2")
    with growbot.connect(f"emulator:{image}", robot="growbot-a2") as board:
        growth = board.grow(quick)
        if os.environ.get("GROWBOT_PYTHON") == "complete":
            assert growth.wait()["outcome"] == "done"
            return
        for event in growth:
            if isinstance(event, growbot.events.Status) and event.state == "heating" and event.target_c:
                break
        growth.stop()
        assert growth.result is not None and growth.result["outcome"] == "stopped"


def test_bodies_among_obstacles_are_kept_clear(tmp_path: Path) -> None:
    near, far = tmp_path / "near.toml", tmp_path / "far.toml"
    text = 'format = "growbot-scene/1"\nmargin_mm = 5.0\n[[ball]]\ncenter_mm = [{}, 0, 60]\nradius_mm = 40\n'
    near.write_text(text.format(60))
    far.write_text(text.format(400))
    with growbot.connect("sim") as board:
        with pytest.raises(growbot.InputError, match="mm into the ball.*ignore_scene=True"):
            board.grow(PLAN, scene=growbot.Scene(near), force=True, overwrite=True)
        feedback = growbot.Conditions(bias_percent=5, feedback=True)
        assert board.grow(PLAN, scene=growbot.Scene(far), conditions=feedback).wait()["outcome"] == "done"
        through = growbot.plan(START, (5, 0, 60, 0, 85), scene=growbot.Scene(far))
        assert board.grow(through).wait()["outcome"] == "done"
        assert "far.toml" in through.html() and "far.toml" in through.simulate(seed=1).html()
        far.write_text(text.format(401))
        with pytest.raises(growbot.FileError, match="not the scene of the plan.*scene="):
            board.grow(through)
        far.unlink()
        with pytest.raises(growbot.FileError, match="scene="):
            board.grow(through)
        with pytest.warns(RuntimeWarning, match="ignore_scene"):
            assert board.grow(through, ignore_scene=True).wait()["outcome"] == "done"


def test_a_body_begins_at_the_tip_of_a_run_log(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    with growbot.connect("sim") as board:
        board.grow(PLAN, log=log).wait()
    run, goal = growbot.RunLog(log), PLAN.goal
    beyond = growbot.Pose(goal.x_mm + 20, goal.y_mm, goal.z_mm + 200, goal.heading_deg, goal.pitch_deg)
    plan = growbot.plan(run, beyond, robot=PLAN.robot)
    assert [warning.code for warning in plan.warnings] == ["continues-body"]
    assert math.dist(plan.start.position_mm, goal.position_mm) < 0.1
    assert np.allclose(plan.start.direction, goal.direction, atol=1e-3)
    assert pickle.loads(pickle.dumps(plan)) == plan and pickle.loads(pickle.dumps(plan.start)) == plan.start
    turned = growbot.Pose(1, 2, 3, 40, 50, roll_deg=60)
    assert turned.roll_deg == 60 and repr(turned).endswith("roll_deg=60.0)")
    assert turned != growbot.Pose(1, 2, 3, 40, 50) and pickle.loads(pickle.dumps(turned)) == turned
    assert np.allclose(turned.matrix[:3, 2], growbot.Pose(1, 2, 3, 40, 50).matrix[:3, 2])
    with growbot.connect("sim") as board:
        assert board.grow(plan).wait()["outcome"] == "done"
    other = growbot.Robot("growbot-b")
    with pytest.raises(growbot.InputError, match="pass the robot of the body"):
        growbot.plan(run, beyond, robot=other)
