"""A motion segment: the motion between two events, with the event that ended it. Pure."""

from __future__ import annotations

from enum import Enum, auto

from positioner.values import dataclass


class Ending(Enum):
    """The event that ended a segment."""

    OPEN = auto()
    """No event: the time was up, or another kind of segment follows."""
    SPEED = auto()
    """The speed reached its bound."""
    BORDER = auto()
    """The stem reached a travel stop or the border of a friction cell."""
    BALANCE = auto()
    """Static friction can hold the stem from here on."""


@dataclass(frozen=True, slots=True)
class Segment:
    """Duration in s, position in m and velocity in m/s at the end, and the event that ended it."""

    duration_s: float
    position_m: float
    velocity_m_per_s: float
    ending: Ending
