"""The conditions of a growth: errors of layers and measurements, and feedback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Optional


@dataclass(frozen=True)
class Conditions:
    """Errors of layers and measurements of a growth, and feedback. By default there are no errors and no feedback.

    Noise of layers is uniform, given by its half-width. Noise of sensors is normal, given by its standard deviation. A
    bias is the same in every layer. The names and limits are those of the options of ``growbot simulate``.
    """

    #: Noise of each layer's growth, percent, 0 to 90. It does not change the layer's tilt.
    noise_percent: float = 0.0
    #: Over-deposition, percent, -90 to 90.
    bias_percent: float = 0.0
    #: Noise of each layer's tilt about either axis, degrees, 0 to 90.
    tilt_noise_deg: float = 0.0
    #: Increase of every layer's tilt, percent, -90 to 90.
    tilt_bias_percent: float = 0.0
    #: Noise of each layer's deposition angle, degrees, 0 to 90.
    alpha_noise_deg: float = 0.0
    #: Offset of the deposition angle, degrees, -90 to 90.
    alpha_bias_deg: float = 0.0
    #: Noise of the twist about the tip's axis in each layer, degrees, 0 to 90.
    twist_noise_deg: float = 0.0
    #: Twist about the tip's axis in each layer, degrees, -90 to 90.
    twist_bias_deg: float = 0.0
    #: Noise of the odometry, percent of a layer's growth, 0 to 90. With feedback the default is 1.
    odometry_noise_percent: Optional[float] = None
    #: Noise of the measured direction, degrees, 0 to 90. With feedback the default is 0.5.
    direction_noise_deg: Optional[float] = None
    #: True to measure each layer, and to plan the rest of the path again after it.
    feedback: bool = False
    #: True to measure only the direction of gravity. With feedback and without a board only.
    gravity_only: bool = False
    #: Percentage by which measured lengths are too long, -90 to 90. With feedback and without a board only.
    odometry_scale_percent: float = 0.0
    #: True if the body sags under its own weight. Without a board only.
    sag: bool = False
    #: "exact": equal layers that end exactly at the goal. "whole": whole steps, as in the paper. Without a board only.
    slicing: Literal["exact", "whole"] = "exact"
    #: Height of whole steps, mm, 0.01 to 10,000. The default is the robot's layer.height_mm.
    step_mm: Optional[float] = None
