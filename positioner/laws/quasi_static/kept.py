"""What the law keeps over a restart: where its moves have ended, by place and direction. Pure.

The stiction table keeps a landing bias: the place x where a move has ended, less the one at which its pressure p would
have stopped the configured valve, x - (p - c - s f_c)/k. A law that starts believes these landings as if it had seen
them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.quasi_static.belief import Landing
from positioner.valve.stiction import LearnedSample, Quantity, direction_of

if TYPE_CHECKING:
    from positioner.laws.quasi_static.belief import ValveBelief
    from positioner.valve.stiction import StictionTable


def lesson_of(belief: ValveBelief, landing: Landing) -> LearnedSample:
    """Return what the stiction table learns from a landing."""
    configured = belief.as_configured
    beside_ma = configured.landing_ma(landing.position_m, landing.direction) - landing.pressure_ma
    bias_m = beside_ma / configured.spring_ma_per_m
    return LearnedSample(Quantity.LANDING_BIAS, landing.position_m, direction_of(landing.direction), bias_m)


def taught(belief: ValveBelief, table: StictionTable, sigma_m: float) -> ValveBelief:
    """Return the belief after the landings that a table has kept, the oldest first.

    sigma_m: of the place of a landing, beside the spread of those in its cell.
    """
    configured = belief.as_configured
    landings = [(key, cell) for key, cell in table if key.quantity is Quantity.LANDING_BIAS]
    for key, cell in sorted(landings, key=lambda one: one[1].sequence):
        place_m, direction = key.index * table.cell_width_m, key.direction.sign
        pressure_ma = configured.landing_ma(place_m, direction) - configured.spring_ma_per_m * cell.mean
        variance_m2 = (sigma_m * sigma_m + cell.spread * cell.spread) / len(cell.samples)
        belief = belief.landed(Landing(place_m, direction, pressure_ma), variance_m2, 0.0)
    return belief
