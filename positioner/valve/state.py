"""What is known of the stem after a reading. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.valve.stiction import LearnedSample


@dataclass(frozen=True, slots=True)
class StemState:
    """The estimate after a measurement: position x (m), speed v (m/s), their covariance, and whether the stem sticks.

    `direction` is that of the present or last move (±1); `drift` the smoothed innovation in σ while stuck.
    `learned` is what the reading taught, where the law finds that out by itself; None leaves it to the edges.
    """

    position_m: float
    velocity_m_per_s: float
    stuck: bool
    direction: float
    p_xx: float
    p_xv: float
    p_vv: float
    drift: float = 0.0
    learned: tuple[LearnedSample, ...] | None = None

    @property
    def position_sigma_m(self) -> float:
        """Standard deviation of the position in m."""
        return math.sqrt(max(self.p_xx, 0.0))
