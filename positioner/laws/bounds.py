"""The bounds of a law's plan in one cycle. Pure."""

from __future__ import annotations

from positioner.values import dataclass


@dataclass(frozen=True, slots=True)
class Bounds:
    """Lower and upper limits of the speed θ in m/s and of the current in mA."""

    speed_low_m_per_s: float
    speed_high_m_per_s: float
    current_low_ma: float
    current_high_ma: float
