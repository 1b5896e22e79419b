"""Typed events of a growth, from a board (growbot.connect) or from a run log.

    for event in board.grow(plan):
        match event:
            case growbot.events.Laid(layer=layer):
                print(layer)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Optional


@dataclass(frozen=True)
class Event:
    """An event. fields has all its values, with the names of a run log."""

    fields: dict[str, Any] = field(repr=False, compare=False, kw_only=True, default_factory=dict)


@dataclass(frozen=True)
class BoardFound(Event):
    """The board has reported its identity."""

    state: str
    laid: int


@dataclass(frozen=True)
class StateChanged(Event):
    """The state of the board has changed: "heating", "homing", "growing", "paused", ..."""

    state: str


@dataclass(frozen=True)
class Status(Event):
    """Status of the board. Temperatures are in C, and None without a reading or with the heater off."""

    state: Optional[str]
    laid: Optional[int]
    temperature_c: Optional[float]
    target_c: Optional[float]
    fault: Optional[str]


@dataclass(frozen=True)
class Laid(Event):
    """A layer was laid: its index from 0, and its values according to the board's steps. Unknown values are None."""

    layer: int
    alpha_deg: Optional[float]
    height_mm: Optional[float]
    tilt_deg: Optional[float]


@dataclass(frozen=True)
class SimulatedLayer(Event):
    """A layer as the plastic of a simulated tip lies."""

    layer: int
    alpha_deg: float
    height_mm: float
    tilt_deg: float


@dataclass(frozen=True)
class Amending(Event):
    """Feedback replaces the layers from first_layer on. The body has total layers from now on."""

    first_layer: int
    total: int


@dataclass(frozen=True)
class NotAmended(Event):
    """The board has not accepted the latest amendment. why is the reason, or None if the amendment came too late."""

    why: Optional[str]


@dataclass(frozen=True)
class Silent(Event):
    """The board does not respond, and the host tries again."""


@dataclass(frozen=True)
class Back(Event):
    """The board responds again."""


@dataclass(frozen=True)
class Ended(Event):
    """The growth has ended. Run logs only."""

    outcome: str


@dataclass(frozen=True)
class Other(Event):
    """Any other event of a run log: "header", "counting", "handing-over", "ordered", "crash", ..."""

    name: str


def from_fields(told: dict[str, Any]) -> Event:
    """Returns the event of a line of a run log."""
    name = str(told.get("event", ""))
    if name == "laid":
        return Laid(
            told["layer"], told.get("alpha_deg"), told.get("height_mm"), told.get("tilt_deg"), fields=told
        )
    if name == "simulated":
        return SimulatedLayer(told["layer"], told["alpha_deg"], told["height_mm"], told["tilt_deg"], fields=told)
    if name == "status":
        return Status(
            told.get("state"), told.get("laid"), told.get("temperature_c"), told.get("target_c"), told.get("fault"),
            fields=told,
        )
    if name == "state":
        return StateChanged(told["state"], fields=told)
    if name == "board":
        return BoardFound(told["state"], told["laid"], fields=told)
    if name == "amending":
        return Amending(told["from"], told["total"], fields=told)
    if name == "not-amended":
        return NotAmended(told.get("why"), fields=told)
    if name == "silent":
        return Silent(fields=told)
    if name == "back":
        return Back(fields=told)
    if name == "end":
        return Ended(told["result"]["outcome"], fields=told)
    return Other(name, fields=told)
