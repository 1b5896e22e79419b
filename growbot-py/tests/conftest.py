"""Goals and the command for the tests."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import growbot

ROOT = Path(__file__).resolve().parents[2]
START = (0.0, 0.0, 0.0, 0.0, 90.0)

# A shell starts background processes with Ctrl-C ignored, and their programs inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def command() -> Path:
    """Returns the growbot command. The variable GROWBOT names it, as set by tests/python/run."""
    return Path(os.environ.get("GROWBOT", ROOT / "target/release/growbot"))


@pytest.fixture(scope="session")
def plan() -> growbot.Plan:
    return growbot.plan(START, (200, 100, 600, 0, 45))


def goals(count: int, seed: int = 2026) -> npt.NDArray[np.float64]:
    """Returns goals around the start, 0.5 to 12 radii away."""
    random = np.random.default_rng(seed)
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    position = direction * random.uniform(50, 1200, (count, 1))
    angles = np.column_stack([random.uniform(-180, 180, count), random.uniform(-90, 90, count)])
    return np.column_stack([position, angles])


def environment() -> dict[str, str]:
    """Returns the environment without growbot's variables and those of the tests, which growbot would refuse."""
    return {name: value for name, value in os.environ.items() if not name.startswith("GROWBOT_")}


def run(command: Path, *arguments: str, stdin: str | None = None) -> str:
    done = subprocess.run(
        [str(command), *arguments], input=stdin, capture_output=True, text=True, check=False, env=environment()
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
