"""What the end of a move says of the valve: the place, the pressure, and how far that pressure is in doubt. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.belief import Landing
from positioner.laws.nmpc.move import Stage

if TYPE_CHECKING:
    from positioner.laws.nmpc.memory import Move

_OF_GAP, _OF_AWAY, _OF_INERTIA = 0.3, 0.04, 0.25
"""Doubt of the balance: 30 % of what the pressure lacks, 4 % of the step of a move away (its pressure is not waited
for), a quarter of what mass has added."""


def landing_of(
    move: Move, position_m: float, direction: float, pressure_ma: float, spring_ma_per_m: float
) -> tuple[Landing, float]:
    """Return where a move has ended, less what mass has added, and the variance of its pressure in mA².

    Args:
        move: the move.
        position_m: where the stem rests.
        direction: of the stem, +1 or -1.
        pressure_ma: as the model says.
        spring_ma_per_m: k = K/B.
    """
    gap_ma = _OF_GAP * (move.level_ma - pressure_ma)
    if move.stage is Stage.AWAY:
        other_ma = _OF_AWAY * (move.level_ma - move.before_ma)
    else:
        other_ma = _OF_INERTIA * spring_ma_per_m * move.inertia_m
    return Landing(position_m - move.inertia_m, direction, pressure_ma), gap_ma * gap_ma + other_ma * other_ma
