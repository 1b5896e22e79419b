"""Typed events of a growth, from a board (growbot.connect) or from a run log.

    for event in board.grow(plan):
        match event:
            case growbot.events.LayerLaid(layer=layer):
                print(layer)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Optional


@dataclass(frozen=True)
class Event:
    """An event. raw is the line of the run log as a dict."""

    raw: dict[str, Any] = field(repr=False, compare=False, kw_only=True, default_factory=dict)


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
    """Status of the board.

    Temperatures are in C, and None without a reading or with the heater off. pause_cause is None unless the board
    pauses.
    """

    state: Optional[str]
    laid: Optional[int]
    temperature_c: Optional[float]
    target_c: Optional[float]
    fault: Optional[str]
    pause_cause: Optional[str]


@dataclass(frozen=True)
class LayerLaid(Event):
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
class Amendment(Event):
    """Feedback replaces the layers from first_layer on. The body has total layers from now on."""

    first_layer: int
    total: int


@dataclass(frozen=True)
class AmendmentRejected(Event):
    """The board has not accepted the latest amendment. reason is None if the amendment came too late."""

    reason: Optional[str]


@dataclass(frozen=True)
class NoResponse(Event):
    """The board does not respond, and the host tries again."""


@dataclass(frozen=True)
class Reconnected(Event):
    """The board responds again."""


@dataclass(frozen=True)
class Ended(Event):
    """The growth has ended. Run logs only."""

    outcome: str


@dataclass(frozen=True)
class Other(Event):
    """Any other event of a run log: "header", "encoder-reference", "layers-sent", "command", "crash", ..."""

    name: str


def event_from_dict(raw: dict[str, Any]) -> Event:
    """Returns the event of a line of a run log."""
    name = str(raw.get("event", ""))
    if name == "laid":
        return LayerLaid(raw["layer"], raw.get("alpha_deg"), raw.get("height_mm"), raw.get("tilt_deg"), raw=raw)
    if name == "simulated":
        return SimulatedLayer(raw["layer"], raw["alpha_deg"], raw["height_mm"], raw["tilt_deg"], raw=raw)
    if name == "status":
        return Status(
            raw.get("state"), raw.get("laid"), raw.get("temperature_c"), raw.get("target_c"), raw.get("fault"),
            raw.get("pause_cause"),
            raw=raw,
        )
    if name == "state":
        return StateChanged(raw["state"], raw=raw)
    if name == "board":
        return BoardFound(raw["state"], raw["laid"], raw=raw)
    if name == "amendment":
        return Amendment(raw["from"], raw["total"], raw=raw)
    if name == "amendment-rejected":
        return AmendmentRejected(raw.get("reason"), raw=raw)
    if name == "no-response":
        return NoResponse(raw=raw)
    if name == "reconnected":
        return Reconnected(raw=raw)
    if name == "end":
        return Ended(raw["result"]["outcome"], raw=raw)
    return Other(name, raw=raw)
