"""Where the law's model of the valve takes the stem, from the law's own estimate under the commands of the run. Pure.

The model has the parameters that the law had learned when the move began, as far as the stiction table keeps them; else
the configured ones. It begins where the law begins a move, or sees the stem slide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.nmpc.belief import belief_of
from positioner.laws.nmpc.kept import taught
from positioner.laws.nmpc.slip import numbers_of
from positioner.valve.rollout import Moving, plant_of
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.config.schema import Configuration
    from positioner.valve.rollout import Rollout
    from positioner.valve.stiction import StictionTable

    Array = NDArray[np.float64]

_LAGS_BEFORE = 12.0
"""So many lags before a window the pressure is taken to be the current; before a run it balances the stem."""


@dataclass(frozen=True, slots=True)
class Begins:
    """The samples at which predictions begin; at_rest: the stem is still to be freed there."""

    here: NDArray[np.bool_]
    at_rest: bool

    @classmethod
    def of(cls, slides: NDArray[np.bool_], moves: NDArray[np.bool_]) -> Begins:
        """Return where a law begins its moves, or, of one that does not say so, where it sees the stem slide."""
        if moves.any():
            return cls(moves, at_rest=True)
        return cls(np.append(slides[1:] & ~slides[:-1], False), at_rest=False)


@dataclass(frozen=True, slots=True)
class Believed:
    """What the law knows of the valve.

    samples_before: those in which the pressure comes to its current; 0 without lag.
    """

    rollout: Rollout
    samples_before: int

    def path_m(self, estimate: tuple[Array, Array], begins: Begins, current_ma: Array, first: int, last: int) -> Array:
        """Return the predicted positions of the samples from `first` to `last`, NaN before the first move in them.

        Args:
            estimate: the law's position in m and speed in m/s of each sample.
            begins: where predictions begin.
            current_ma: the commands, which act from their sample on.
            first: the first sample of interest.
            last: the last one.
        """
        found, since = np.full(last + 1 - first, np.nan), max(first - self.samples_before, 0)
        if not begins.here[since : last + 1].any():
            return found
        before_ma = float(current_ma[since]) if since else self.rollout.numbers.balance_ma(float(estimate[0][0]))
        moving = Moving(self.rollout.pressure.at_rest(before_ma), StemState(0.0, 0.0, True, 1.0))
        predicts = False
        for sample in range(since, last + 1):
            current = float(current_ma[sample])
            if begins.here[sample]:
                x, v, predicts = float(estimate[0][sample]), float(estimate[1][sample]), True
                push_ma = current - self.rollout.numbers.balance_ma(x)
                later = v or float(estimate[1][min(sample + 1, last)]) or push_ma
                rests = v == 0.0 and begins.at_rest
                moving = Moving(moving.pressure, StemState(x, v, rests, 1.0 if later >= 0.0 else -1.0))
            if predicts and sample >= first:
                found[sample - first] = moving.stem.position_m
            moved = self.rollout.after(moving, current)
            moving = moved if predicts else Moving(moved.pressure, moving.stem)
        return found


def believed(configuration: Configuration, table: StictionTable) -> Believed:
    """Return what the law knows of the valve with this table."""
    valve, period_s = configuration.valve, configuration.control.sample_period_s
    middle_m = 0.5 * (valve.travel_min_m + valve.travel_max_m)
    belief = taught(belief_of(valve), table, valve, measurement_sigma_m(configuration.estimator, valve, middle_m))
    plant = plant_of(valve, period_s, configuration.control.command_delay_s)
    return Believed(plant.rollout(numbers_of(belief.numbers.mean)), math.ceil(_LAGS_BEFORE * valve.lag_s / period_s))
