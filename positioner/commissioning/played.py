"""The steps of an experiment, played again with an identified valve: what the readings should have been. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.observed import theta_of
from positioner.commissioning.record import Kind
from positioner.commissioning.slips import Candidates, Slips, play

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.record import Stretch
    from positioner.valve.parameters import ValveParameters


def played_steps(
    stretches: Sequence[Stretch], valve: ValveParameters, period_s: float
) -> Iterator[tuple[Stretch, NDArray[np.float64]]]:
    """Yield each step and the positions in m, one for each of its readings, that the valve's parameters give."""
    for each in stretches:
        if each.kind is not Kind.STEP:
            continue
        rest_m = float(np.nanmean(each.measured_m[each.held // 4 : each.held]))
        values = (*theta_of(valve), rest_m, 1.0)
        sets = Candidates(valve.mass_kg, valve.force_gain_n_per_ma, *(np.full((1, 1), value) for value in values))
        applied, readings = np.asarray([each.applied_ma]), np.asarray([each.measured_m])
        yield each, play(Slips(period_s, np.array([each.direction]), applied, readings, 0), sets)[:, 0, 0]
