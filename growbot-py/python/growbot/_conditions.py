"""The conditions of a growth: what is off, and whether a loop is closed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Optional


@dataclass(frozen=True)
class Conditions:
    """How layers and measurements of a growth are off, and whether a loop is closed; nothing is off by default.

    Noise of layers is uniform, given by its half-width; noise of sensors is normal, given by its standard deviation; a
    bias is the same in every layer. The names and limits are those of the options of ``growbot simulate``.
    """

    #: Noise of each layer's growth, percent, 0 to 90; its tilt is kept.
    noise_percent: float = 0.0
    #: Over-deposition, percent, -90 to 90.
    bias_percent: float = 0.0
    #: Noise of each layer's tilt about either axis, degrees, 0 to 90.
    tilt_noise_deg: float = 0.0
    #: How much more every layer tilts, percent, -90 to 90.
    tilt_bias_percent: float = 0.0
    #: Noise of each layer's deposition angle, degrees, 0 to 90.
    alpha_noise_deg: float = 0.0
    #: Offset of the deposition angle, degrees, -90 to 90.
    alpha_bias_deg: float = 0.0
    #: Noise of the twist about the tip's axis in each layer, degrees, 0 to 90.
    twist_noise_deg: float = 0.0
    #: Twist about the tip's axis in each layer, degrees, -90 to 90.
    twist_bias_deg: float = 0.0
    #: Noise of the odometry, percent of a layer's growth, 0 to 90; in closed loop 1 unless given.
    odometry_noise_percent: Optional[float] = None
    #: Noise of the measured direction, degrees, 0 to 90; in closed loop 0.5 unless given.
    direction_noise_deg: Optional[float] = None
    #: Whether each layer is measured, and the rest of the path planned again after it.
    feedback: bool = False
    #: In closed loop, without a board: whether the direction of gravity alone is measured.
    gravity_only: bool = False
    #: In closed loop, without a board: how much too long the odometry shows everything, percent, -90 to 90.
    odometry_scale_percent: float = 0.0
    #: Without a board: whether the body hangs under its own weight.
    sag: bool = False
    #: Without a board: equal layers that end where the path does, or whole steps, as in the paper.
    slicing: Literal["exact", "whole"] = "exact"
    #: Height of whole steps, mm, 0.01 to 10,000; the robot's layer.height_mm unless given.
    step_mm: Optional[float] = None
