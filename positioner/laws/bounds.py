"""The bounds that a law was bound by in one cycle. Pure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Bounds:
    """What the plan must respect: speed θ in m/s and current in mA, each between a lower and an upper limit."""

    speed_low_m_per_s: float
    speed_high_m_per_s: float
    current_low_ma: float
    current_high_ma: float
