"""Position, speed, spring rate and friction of the stem: an extended Kalman filter with the stop inside. Pure.

While the stem slides, the filter has the states x, v, K, F_c and F_v of `valve.motion`. The motion model, with its
stop, propagates their covariance, so that the error of a landing corrects the load. While the stem rests, the filter is
a plain average of the position; the load changes with it, by the covariance at the beginning of the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.valve.motion import FRICTION, LOAD, POSITION, SPEED, STATES, Load

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.valve.motion import MotionModel


@dataclass(frozen=True, slots=True, kw_only=True)
class AdaptationSettings(SettingsTable):
    """The `[control.nmpc.adaptation]` table of a configuration; fractions are of the nominal K_m, F_c and F_v.

    spring_sigma, friction_sigma, viscous_sigma: standard deviations of the configured values.
    friction_per_move, friction_per_m: how much F_c changes from move to move, and per metre.
    force_noise_n: force that the model does not know, white per sample, while sliding.
    landing_noise_m: error of a landing that none of the states explains.
    least, most: limits of the estimates.
    """

    spring_sigma: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.12
    friction_sigma: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.12
    viscous_sigma: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.12
    friction_per_move: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.02
    friction_per_m: Annotated[float, Interval(ge=0.0, le=100.0)] = 0.1
    force_noise_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 30.0
    landing_noise_m: Annotated[float, Interval(ge=0.0, le=0.01)] = 2e-4
    least: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.6
    most: Annotated[float, Interval(ge=1.0, le=10.0)] = 1.5


@dataclass(frozen=True, slots=True)
class Sliding:
    """The estimate while the stem slides.

    x in m, v in m/s, the load, and their covariance (STATES, STATES), which is read-only. `direction` is that of
    the move (±1), `stopped` whether friction has ended it.
    """

    x: float
    v: float
    load: Load
    covariance: NDArray[np.float64]
    direction: float
    stopped: bool = False


@dataclass(frozen=True, slots=True)
class Resting:
    """The estimate while the stem rests at x (m): its variance (m²), and the load, which changes with x.

    anchor: the estimate when the stem came to rest. slopes: derivatives of the load to x, from its covariance.
    """

    x: float
    variance_m2: float
    anchor: Sliding
    slopes: Load

    @property
    def load(self) -> Load:
        """The load in SI units."""
        moved = self.x - self.anchor.x
        return Load(*(own + slope * moved for own, slope in zip(self.anchor.load, self.slopes, strict=True)))

    @property
    def sigma_m(self) -> float:
        """Standard deviation of x in m."""
        return math.sqrt(self.variance_m2)


@dataclass(frozen=True, slots=True)
class AdaptiveFilter:
    """The filter of one valve: its motion model, its nominal load, and how uncertain both are."""

    settings: AdaptationSettings
    model: MotionModel
    nominal: Load

    def at_rest(self, x: float, variance_m2: float, load: Load, sigmas: Load) -> Resting:
        """Return the estimate of a stem that rests at x, with the load and its standard deviations."""
        variances = np.zeros(STATES)
        variances[POSITION], variances[LOAD] = variance_m2, [sigma * sigma for sigma in sigmas]
        return self.rest(Sliding(x, 0.0, self._limited(load), np.diag(variances), direction=1.0, stopped=True))

    def prior_sigmas(self) -> Load:
        """Return the standard deviations of the load before anything was learned."""
        own, nominal = self.settings, self.nominal
        return Load(
            own.spring_sigma * nominal.spring_n_per_m,
            own.friction_sigma * nominal.friction_n,
            own.viscous_sigma * nominal.viscous_n_s_per_m,
        )

    def depart(self, rest: Resting, direction: float) -> Sliding:
        """Return the estimate at the start of a move, with the average at rest, and friction a little less certain."""
        covariance = rest.anchor.covariance.copy()
        line = covariance[POSITION] / covariance[POSITION, POSITION]
        covariance -= np.outer(line, line) * (covariance[POSITION, POSITION] - rest.variance_m2)
        covariance[FRICTION, FRICTION] += (self.settings.friction_per_move * self.nominal.friction_n) ** 2
        return Sliding(rest.x, 0.0, self._limited(rest.load), covariance, direction)

    def advance(self, state: Sliding, current_ma: float, duration_s: float) -> Sliding:
        """Return the prediction after `duration_s` under `current_ma`; the stem may stop on the way."""
        s = state.direction
        end = self.model.step(state.x, state.v, current_ma, state.load, s, duration_s)
        jacobian = np.eye(STATES)
        jacobian[POSITION], jacobian[SPEED] = end.rows(s)
        covariance = jacobian @ state.covariance @ jacobian.T
        if not end.stopped:
            covariance[SPEED, SPEED] += (self.settings.force_noise_n / self.model.mass_kg * duration_s) ** 2
        wander_n = self.settings.friction_per_m * self.nominal.friction_n
        covariance[FRICTION, FRICTION] += wander_n * wander_n * abs(end.x - state.x)
        return replace(state, x=end.x, v=end.v, covariance=covariance, stopped=end.stopped)

    def moved_m(self, state: Sliding, ahead: Sliding, current_ma: float, after_s: float) -> float:
        """Return how far in m the stem has moved when it is `ahead`, from `after_s` on, under `current_ma`."""
        return ahead.x - self.model.step(state.x, state.v, current_ma, state.load, state.direction, after_s).x

    def correct(self, state: Sliding, measured_m: float, variance_m2: float) -> Sliding:
        """Return the estimate after a reading with `variance_m2`; friction stops the stem before its speed turns."""
        column = state.covariance[:, POSITION]
        gain = column / (column[POSITION] + variance_m2)
        covariance = state.covariance - np.outer(gain, column)
        change = (gain * (measured_m - state.x)).tolist()
        load = self._limited(Load(*(old + new for old, new in zip(state.load, change[LOAD], strict=True))))
        v = state.v + change[SPEED]
        stopped = state.stopped or (state.v != 0.0 and v * state.direction <= 0.0)
        return replace(
            state,
            x=state.x + change[POSITION],
            v=0.0 if stopped else v,
            load=load,
            covariance=covariance,
            stopped=stopped,
        )

    def rest(self, state: Sliding) -> Resting:
        """Return the estimate of a stem that has come to rest; its position is a little less certain."""
        covariance = state.covariance.copy()
        covariance[SPEED, :] = covariance[:, SPEED] = 0.0
        covariance[POSITION, POSITION] += max(self.settings.landing_noise_m, _SHARPEST_M) ** 2
        by_x = covariance[POSITION].tolist()
        variance_m2 = by_x[POSITION]
        anchor = replace(state, v=0.0, covariance=covariance, stopped=True)
        return Resting(state.x, variance_m2, anchor, Load(*(each / variance_m2 for each in by_x[LOAD])))

    def _limited(self, load: Load) -> Load:
        """Return the load inside its limits."""
        least, most = self.settings.least, self.settings.most
        return Load(*(min(max(own, least * by), most * by) for own, by in zip(load, self.nominal, strict=True)))


_SHARPEST_M = 1e-9
"""The least uncertainty of a landing."""


def spread_of(rest: Resting) -> Load:
    """Return the standard deviations of the load when the stem came to rest."""
    return Load(*np.sqrt(rest.anchor.covariance.diagonal()[LOAD]).tolist())


def average(rest: Resting, measured_m: float, variance_m2: float) -> Resting:
    """Return the estimate after one more reading of a resting stem."""
    gain = rest.variance_m2 / (rest.variance_m2 + variance_m2)
    x = rest.x + gain * (measured_m - rest.x)
    return replace(rest, x=x, variance_m2=(1.0 - gain) * rest.variance_m2)
