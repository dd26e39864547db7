"""The state of the stem, as estimated from a reading. Pure."""

from __future__ import annotations

from positioner.values import dataclass


@dataclass(frozen=True, slots=True)
class StemState:
    """Position x (m), speed v (m/s), whether the stem sticks, and the direction (±1) of its present or last move."""

    position_m: float
    velocity_m_per_s: float
    stuck: bool
    direction: float
