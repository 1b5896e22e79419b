"""Robots that keep running: simulated ones in separate processes, and those that `growbot serve` owns."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Iterator

import pytest

import growbot
from conftest import START, environment, run

ROBOT = "growbot-a2"
PLAN = growbot.plan(START, (0, 0, 40, 0, 90), robot=ROBOT)
SETTINGS = f"""
[robots.lab]
port = "sim:lab"
robot = "{ROBOT}"
pace = 60.0
"""


def wait_for_state(board: growbot.Board, state: str) -> None:
    for _ in range(6000):
        if board.status()["state"] == state:
            return
        time.sleep(0.1)
    raise AssertionError(f"the board is {board.status()['state']}, not {state}, after ten minutes")


@pytest.fixture
def lab(command: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Starts a service that owns the simulated robot sim:lab."""
    (tmp_path / "growbot.toml").write_text(SETTINGS)
    for key, name in [("XDG_STATE_HOME", "state"), ("XDG_RUNTIME_DIR", "run")]:
        monkeypatch.setenv(key, str(tmp_path / name))
        (tmp_path / name).mkdir()
    arguments = [str(command), "serve", "--page-port", "0"]
    with subprocess.Popen(arguments, cwd=tmp_path, env=environment(), stdout=subprocess.PIPE) as service:
        assert service.stdout is not None and b"127.0.0.1" in service.stdout.readline()
        try:
            with growbot.connect("sim:lab") as board:
                wait_for_state(board, "idle")
            yield tmp_path
        finally:
            service.kill()
            run(command, "power", "off", "--port", "sim:lab")


def test_a_robot_of_the_service_is_a_board_like_others(lab: Path) -> None:
    log = lab / "run.jsonl"
    with growbot.connect("sim:lab") as board:
        assert board.simulated
        growth = board.grow(PLAN, log=log)
        seen = list(growth)
        assert growth.result is not None and growth.result["outcome"] == "done" and growth.result["simulated"]
        assert board.status()["state"] == "done"
        with pytest.raises(growbot.FileError, match="overwrite=True"):
            board.grow(PLAN, log=log)
        with pytest.raises(growbot.InputError, match="no noise"):
            board.grow(PLAN, conditions=growbot.Conditions(noise_percent=5))
        with pytest.raises(growbot.BoardError, match="no active job"):
            board.attach()
    assert [event.layer for event in seen if isinstance(event, growbot.events.LayerLaid)] == list(
        range(PLAN.layer_count)
    )
    assert growbot.RunLog(log).outcome == "done"
    with pytest.raises(growbot.BoardError, match="disconnected"):
        board.status()


def test_a_growth_can_be_left_and_met_again(lab: Path) -> None:
    long = growbot.plan(START, (0, 0, 400, 0, 90), robot=ROBOT)
    with growbot.connect("sim:lab") as board:
        growth = board.grow(long)
        next(event for event in growth if isinstance(event, growbot.events.LayerLaid))
        board.detach()
    with growbot.connect("sim:lab") as board:
        growth = board.attach()
        laid = next(event for event in growth if isinstance(event, growbot.events.LayerLaid))
        assert laid.layer == 0
        growth.pause()
        next(event for event in growth if isinstance(event, growbot.events.StateChanged) and event.state == "paused")
        growth.continue_()
        with pytest.raises(growbot.InputError, match="unknown command"):
            growth.send_command("jump")
    # The end of the block has stopped the growth.
    assert growth.ended and growth.result is not None and growth.result["outcome"] == "stopped"


def test_the_service_grows_in_the_scene_that_is_given(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(lab)
    head = 'format = "growbot-scene/1"\nmargin_mm = 2\n'
    Path("wall.toml").write_text(head + "[[box]]\ncenter_mm = [0, 0, 60]\nsize_mm = [200, 200, 60]\n")
    Path("aside.toml").write_text(head + "[[ball]]\ncenter_mm = [300, 0, 20]\nradius_mm = 20\n")
    with growbot.connect("sim:lab") as board:
        with pytest.raises(growbot.InputError, match="wall.toml") as refused:
            board.grow(PLAN, scene=growbot.Scene("wall.toml"))
        assert refused.value.code == "scene-not-clear"
        aside = growbot.Scene("aside.toml")
        assert board.grow(PLAN, scene=aside).wait()["outcome"] == "done"
        # The file's name in the plan is relative to this directory, but the service runs in another one.
        plan = growbot.plan(START, (0, 0, 40, 0, 90), robot=ROBOT, scene=aside)
        assert board.grow(plan).wait()["outcome"] == "done"


def test_a_service_that_another_user_can_replace_is_not_used(lab: Path) -> None:
    folder = lab / "run" / "growbot"
    folder.chmod(0o755)
    with pytest.raises(growbot.BoardError, match="has mode 0755.*chmod go-rwx"):
        growbot.connect("sim:lab")
    folder.chmod(0o700)
    # Only root can give the folder away, and have a program of another user in it.
    if os.geteuid() != 0:
        return
    os.chown(folder, OTHER_USER, -1)
    with pytest.raises(growbot.BoardError, match=f"belongs to user {OTHER_USER}"):
        growbot.connect("sim:lab")
    os.chown(folder, 0, -1)
    path = folder / "serve.sock"
    path.unlink()
    with subprocess.Popen(
        [sys.executable, "-c", FALSE_SERVICE, str(path), str(OTHER_USER)], stdout=subprocess.PIPE
    ) as service:
        assert service.stdout is not None and service.stdout.readline() == b"listening\n"
        with pytest.raises(growbot.BoardError, match=f"listens on .* belongs to user {OTHER_USER}"):
            growbot.connect("sim:lab")
        service.kill()


#: User number that no process of the tests has.
OTHER_USER = 54_321

#: A program that gives up its rights before it listens, as one that another user has started.
FALSE_SERVICE = """
import os, socket, sys, time
listener = socket.socket(socket.AF_UNIX)
listener.bind(sys.argv[1])
os.setuid(int(sys.argv[2]))
listener.listen()
print("listening", flush=True)
time.sleep(3600)
"""

GROWING = f"""
import sys, time
import growbot
plan = growbot.plan((0, 0, 0, 0, 90), (0, 0, 300, 0, 90), robot="{ROBOT}")
board = growbot.connect(sys.argv[1])

def grow():
    growth = board.grow(plan)
    for event in growth:
        if isinstance(event, growbot.events.LayerLaid) and event.layer == 1:
            print("growing", flush=True)
            return growth

"""
WITH_BLOCK = GROWING + "with board:\n    kept = grow()\n"
LEFT = GROWING + "kept = grow()\n"
ONLY_GROWTH = GROWING + "kept = grow()\ndel board\n"
READING = GROWING + "with board:\n    for event in grow():\n        pass\n"

# How a program ends, and the states to which that brings a robot whose port the program has, and one of a service.
# SAFETY.md has the same table for commands.
ENDINGS = {
    "with block": (WITH_BLOCK, None, "stopped", "stopped"),
    "end without a with block": (LEFT, None, "stopped", "done"),
    "end with the growth alone": (ONLY_GROWTH, None, "stopped", "done"),
    "ctrl-c": (READING, signal.SIGINT, "stopped", "stopped"),
    "sigterm": (READING, signal.SIGTERM, "paused", "done"),
    "sigkill": (READING, signal.SIGKILL, "paused", "done"),
}


def state_at_rest(command: Path, port: str) -> str:
    """Returns the state of a robot once it no longer grows. Nothing stays connected, because the time of a simulated
    robot waits for the program that is connected."""
    for _ in range(6000):
        status = json.loads(run(command, "status", "--json", "--port", port))
        # A board without its host pauses, and parks later. A service that starves may let it pause, too.
        is_silent = status["pause_cause"] == "host-silent"
        if status["state"] not in ("heating", "homing", "growing") and not (is_silent and port == "sim:lab"):
            return "paused" if is_silent else str(status["state"])
        time.sleep(0.1)
    raise AssertionError(f"{port}: {status}")


def test_what_the_end_of_a_program_does_to_its_robot(lab: Path, command: Path) -> None:
    own = f"sim:{lab}/own"
    run(command, "power", "on", "--port", own, "--robot", ROBOT, "--pace", "60")
    try:
        for ending, (program, how, of_program, of_service) in ENDINGS.items():
            # Both robots grow at the same time.
            processes = {
                port: subprocess.Popen(
                    [sys.executable, "-c", program, port], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
                )
                for port in (own, "sim:lab")
            }
            for process in processes.values():
                assert process.stdout is not None and process.stdout.readline() == "growing\n", ending
                if how is not None:
                    process.send_signal(how)
            for port, expected in [(own, of_program), ("sim:lab", of_service)]:
                with processes[port] as process:
                    errors = process.communicate(timeout=600)[1]
                assert ("KeyboardInterrupt" in errors) == (ending == "ctrl-c"), errors
                assert state_at_rest(command, port) == expected, (ending, port)
                run(command, "cancel", "--port", port)
    finally:
        run(command, "power", "off", "--port", own)


def test_a_simulated_robot_that_stays_on(command: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    port = f"sim:{tmp_path}/lab"
    with pytest.raises(growbot.BoardError, match="power on"):
        growbot.connect(port)
    run(command, "power", "on", "--port", port, "--robot", ROBOT, "--pace", "1000")
    try:
        with growbot.connect(port) as board:
            assert board.simulated and board.grow(PLAN).wait()["outcome"] == "done"
        with growbot.connect(port) as board:
            assert board.status()["state"] == "done"
            result = board.grow(PLAN, conditions=growbot.Conditions(noise_percent=5), seed=3).wait()
            assert result["outcome"] == "done" and result["seed"] == 3 and result["position_error_mm"] > 0.01
        assert os.path.exists(tmp_path / "lab")
    finally:
        run(command, "power", "off", "--port", port)
