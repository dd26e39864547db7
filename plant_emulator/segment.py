"""A motion segment: the motion between two events, with the event that ended it. Pure."""

from __future__ import annotations

from enum import Enum, auto
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.path import Path


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
    """Duration in s, position in m and velocity in m/s at the end, the event that ended it, and the way there."""

    duration_s: float
    position_m: float
    velocity_m_per_s: float
    ending: Ending
    path: Path
