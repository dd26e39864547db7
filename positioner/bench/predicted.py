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
from positioner.laws.nmpc.breakaway import load_from_table
from positioner.laws.nmpc.filter import AdaptiveFilter
from positioner.laws.quasi_static.belief import belief_of
from positioner.laws.quasi_static.kept import taught
from positioner.laws.quasi_static.slip import numbers_of
from positioner.valve.motion import Load, MotionModel
from positioner.valve.rollout import Moving, Numbers, plant_of
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
class Believed:
    """What the law knows of the valve.

    samples_before: those in which the pressure comes to its current; 0 without lag. shift_s: by how much later than a
        reading an estimate is: the instant at which commands act, without a lag.
    """

    rollout: Rollout
    samples_before: int
    shift_s: float

    def path_m(
        self, estimate: tuple[Array, Array], begins: NDArray[np.bool_], current_ma: Array, first: int, last: int
    ) -> Array:
        """Return the predicted positions of the samples from `first` to `last`, NaN before the first move in them.

        Args:
            estimate: the law's position in m and speed in m/s of each sample.
            begins: where a prediction begins: as `begins_of`.
            current_ma: the commands, which act from their sample on.
            first: the first sample of interest.
            last: the last one.
        """
        found, since = np.full(last + 1 - first, np.nan), max(first - self.samples_before, 0)
        if not begins[since : last + 1].any():
            return found
        before_ma = float(current_ma[since]) if since else self.rollout.numbers.balance_ma(float(estimate[0][0]))
        moving = Moving(self.rollout.pressure.at_rest(before_ma), StemState(0.0, 0.0, True, 1.0))
        predicts = False
        for sample in range(since, last + 1):
            current = float(current_ma[sample])
            if begins[sample]:
                x, v, predicts = float(estimate[0][sample]), float(estimate[1][sample]), True
                push_ma = current - self.rollout.numbers.balance_ma(x)
                later = v or float(estimate[1][min(sample + 1, last)]) or push_ma
                rests = v == 0.0 and self.samples_before > 0
                moving = Moving(moving.pressure, StemState(x, v, rests, 1.0 if later >= 0.0 else -1.0))
            if predicts and sample >= first:
                found[sample - first] = moving.stem.position_m
            moved = self.rollout.after(moving, current)
            moving = moved if predicts else Moving(moved.pressure, moving.stem)
        return found

    def begins_of(self, slides: NDArray[np.bool_], moves: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return where predictions begin: with the moves of the law, or without lag with the slides of the stem."""
        if self.samples_before:
            return moves
        return np.append(slides[1:] & ~slides[:-1], False)


def believed(configuration: Configuration, table: StictionTable) -> Believed:
    """Return what the law knows of the valve with this table."""
    valve, control = configuration.valve, configuration.control
    period_s, gain, belief = control.sample_period_s, valve.force_gain_n_per_ma, belief_of(valve)
    if not valve.is_immediate:
        middle_m = 0.5 * (valve.travel_min_m + valve.travel_max_m)
        belief = taught(belief, table, valve, measurement_sigma_m(configuration.estimator, valve, middle_m))
        rollout = plant_of(valve, period_s, control.command_delay_s).rollout(numbers_of(belief.numbers.mean))
        return Believed(rollout, math.ceil(_LAGS_BEFORE * valve.lag_s / period_s), 0.0)
    load, ratio = Load.of(valve), 1.0
    if valve.coulomb_friction_n > 0.0:
        ratio, model = valve.static_friction_n / valve.coulomb_friction_n, MotionModel.of(valve)
        sigmas = AdaptiveFilter(control.nmpc.adaptation, model, load).prior_sigmas()
        load, _ = load_from_table(control.nmpc.breakaway, model, table, load, sigmas, ratio)
    sliding_ma, offset_ma = load.friction_n / gain, valve.bench_set_n / gain
    static_ma = ratio * sliding_ma if sliding_ma else valve.static_friction_n / gain
    numbers = Numbers(load.spring_n_per_m / gain, offset_ma, sliding_ma, static_ma)
    return Believed(plant_of(valve, period_s, 0.0).rollout(numbers), 0, control.command_delay_s)
