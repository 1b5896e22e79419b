"""Robots that move by growing: plans, layers, simulated growths, campaigns, and boards.

>>> import growbot
>>> plan = growbot.plan((0, 0, 0, 0, 90), (200, 100, 600, 0, 45))
>>> plan.path_type, round(plan.length_mm, 1), plan.layer_count
('CSC', 643.0, 832)

Lengths are in mm and angles in degrees, as the names state. A pose is growbot.Pose, or five numbers: x, y, z, heading,
pitch. Pitch 90 is straight up. Every error is a growbot.Error, with value, limit and code.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from growbot import events
from growbot._board import Board, Growth, connect
from growbot._campaign import CampaignResult, CampaignSpec, ChunkResult, merge_chunks, run_campaign, run_chunk
from growbot._conditions import Conditions
from growbot._errors import BoardError, Error, FileError, InputError, InputTypeError, NoPathError
from growbot._growbot import (
    Plan,
    PlanWarning,
    Pose,
    Robot,
    Scene,
    Segment,
    SimulationResult,
    SimulationSummary,
    plan,
    plan_many,
    simulate_many,
    simulate_repeated,
)
from growbot._run import RunLog
from growbot._view import view

__all__ = [
    "Board",
    "BoardError",
    "CampaignResult",
    "CampaignSpec",
    "ChunkResult",
    "Conditions",
    "Error",
    "FileError",
    "Growth",
    "InputError",
    "InputTypeError",
    "NoPathError",
    "Plan",
    "PlanWarning",
    "Pose",
    "Robot",
    "RunLog",
    "Scene",
    "Segment",
    "SimulationResult",
    "SimulationSummary",
    "connect",
    "events",
    "merge_chunks",
    "plan",
    "plan_many",
    "run_campaign",
    "run_chunk",
    "simulate_many",
    "simulate_repeated",
    "view",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> None:
        raise AttributeError(f"growbot has no {name!r} in this release: use one of {', '.join(__all__)}")
