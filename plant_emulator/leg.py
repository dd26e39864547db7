"""A stretch of motion between two events, and what ended it. Pure."""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple


class Ending(Enum):
    """What ended a leg."""

    OPEN = auto()
    """Nothing did: the time was up, or another kind of leg takes over."""
    SPEED = auto()
    """The speed came to the bound that was asked about."""
    BORDER = auto()
    """The stem came to a border of its travel or of a friction cell."""
    BALANCE = auto()
    """Static friction can hold the stem from here."""


class Leg(NamedTuple):
    """How long a leg lasted in s, the position in m and velocity in m/s at its end, and what ended it."""

    duration_s: float
    position_m: float
    velocity_m_per_s: float
    ending: Ending
