"""Position, speed, spring rate and friction of the stem: an extended Kalman filter with the stop inside. Pure.

While the stem slides, the filter has the states x, v, K, F_c and F_v of `valve.motion`. The motion model, with its
stop, propagates their covariance, so that the error of a landing corrects the load. While the stem rests, the filter is
a plain average of the position; the load changes with it, by the covariance at the beginning of the rest.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc import covariance as of_states
from positioner.values import dataclass, replace
from positioner.valve.motion import Load

if TYPE_CHECKING:
    from positioner.laws.nmpc.covariance import Covariance
    from positioner.laws.nmpc.settings import AdaptationSettings
    from positioner.valve.motion import MotionModel


@dataclass(frozen=True, slots=True)
class Sliding:
    """The estimate while the stem slides.

    x in m, v in m/s, the load, and their covariance. `direction` is that of the move (±1), `stopped` whether friction
    has ended it. `unforeseen`: the factor of the noise of this motion (`repeatability`), 0 where none was predicted.
    """

    x: float
    v: float
    load: Load
    covariance: Covariance
    direction: float
    stopped: bool = False
    unforeseen: float = 0.0


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
    def spring_n_per_m(self) -> float:
        """K in N/m."""
        return self.anchor.load.spring_n_per_m + self.slopes.spring_n_per_m * (self.x - self.anchor.x)

    @property
    def load(self) -> Load:
        """The load in SI units."""
        moved, own, slopes = self.x - self.anchor.x, self.anchor.load, self.slopes
        return Load(
            own.spring_n_per_m + slopes.spring_n_per_m * moved,
            own.friction_n + slopes.friction_n * moved,
            own.viscous_n_s_per_m + slopes.viscous_n_s_per_m * moved,
        )

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
        covariance = of_states.independent(variance_m2, sigmas)
        return self.rest(Sliding(x, 0.0, self.limited(load), covariance, direction=1.0, stopped=True))

    def prior_sigmas(self) -> Load:
        """Return the standard deviations of the load before anything was learned."""
        own, nominal = self.settings, self.nominal
        return Load(
            own.spring_sigma * nominal.spring_n_per_m,
            own.friction_sigma * nominal.friction_n,
            own.viscous_sigma * nominal.viscous_n_s_per_m,
        )

    def depart(self, rest: Resting, direction: float, unforeseen: float) -> Sliding:
        """Return the estimate at the start of a move, with the average at rest, and friction a little less certain.

        `unforeseen` is the factor of the noise of this motion.
        """
        before = rest.anchor.covariance
        known = of_states.reduced(before, (before.xx - rest.variance_m2) / (before.xx * before.xx))
        wander_n = self.settings.friction_per_move * self.nominal.friction_n
        covariance = of_states.departing(known, unforeseen * wander_n * wander_n)
        return Sliding(rest.x, 0.0, self.limited(rest.load), covariance, direction, unforeseen=unforeseen)

    def advance(self, state: Sliding, current_ma: float, duration_s: float) -> Sliding:
        """Return the prediction after `duration_s` under `current_ma`; the stem may stop on the way."""
        s, own = state.direction, self.settings
        end = self.model.step(state.x, state.v, current_ma, state.load, s, duration_s)
        # what an unknown white force does to the speed, which forgets with the time m/F_v
        mass_kg, viscous = self.model.mass_kg, state.load.viscous_n_s_per_m
        kept = math.exp(-2.0 * viscous * duration_s / mass_kg)
        kick_m2_per_s2 = own.force_noise_n * own.force_noise_n * _CHANGES_S * (1.0 - kept) / (2.0 * mass_kg * viscous)
        wander_n = own.friction_per_m * self.nominal.friction_n
        friction_n2 = wander_n * wander_n * abs(end.x - state.x)
        part = state.unforeseen
        covariance = of_states.propagated(state.covariance, end, s, part * kick_m2_per_s2, part * friction_n2)
        return Sliding(end.x, end.v, state.load, covariance, s, end.stopped, part)

    def moved_m(self, state: Sliding, ahead: Sliding, current_ma: float, after_s: float) -> float:
        """Return how far in m the stem has moved when it is `ahead`, from `after_s` on, under `current_ma`."""
        return ahead.x - self.model.step(state.x, state.v, current_ma, state.load, state.direction, after_s).x

    def correct(self, state: Sliding, measured_m: float, variance_m2: float) -> Sliding:
        """Return the estimate after a reading with `variance_m2`; friction stops the stem before its speed turns."""
        p, load = state.covariance, state.load
        by = 1.0 / (p.xx + variance_m2)
        change = by * (measured_m - state.x)
        v = state.v + change * p.xv
        stopped = state.stopped or (state.v != 0.0 and v * state.direction <= 0.0)
        corrected = Load(
            load.spring_n_per_m + change * p.xk,
            load.friction_n + change * p.xf,
            load.viscous_n_s_per_m + change * p.xc,
        )
        return Sliding(
            state.x + change * p.xx,
            0.0 if stopped else v,
            self.limited(corrected),
            of_states.reduced(p, by),
            state.direction,
            stopped,
            state.unforeseen,
        )

    def rest(self, state: Sliding) -> Resting:
        """Return the estimate of a stem that has come to rest; its position is a little less certain."""
        doubt_m = max(self.settings.landing_noise_m, _SHARPEST_M)
        p = of_states.at_rest(state.covariance, (state.unforeseen or 1.0) * doubt_m * doubt_m)
        anchor = replace(state, v=0.0, covariance=p, stopped=True)
        return Resting(state.x, p.xx, anchor, Load(p.xk / p.xx, p.xf / p.xx, p.xc / p.xx))

    def limited(self, load: Load) -> Load:
        """Return the load inside its limits."""
        least, most, by = self.settings.least, self.settings.most, self.nominal
        return Load(
            min(max(load.spring_n_per_m, least * by.spring_n_per_m), most * by.spring_n_per_m),
            min(max(load.friction_n, least * by.friction_n), most * by.friction_n),
            min(max(load.viscous_n_s_per_m, least * by.viscous_n_s_per_m), most * by.viscous_n_s_per_m),
        )


_CHANGES_S = 1e-3
"""The unknown force changes once in this time."""
_SHARPEST_M = 1e-9
"""The least uncertainty of a landing."""


def taught(rest: Resting) -> Resting:
    """Return the same rest, whose landing has taught how well landings repeat."""
    return replace(rest, anchor=replace(rest.anchor, unforeseen=0.0))


def spread_of(rest: Resting) -> Load:
    """Return the standard deviations of the load when the stem came to rest."""
    p = rest.anchor.covariance
    return Load(math.sqrt(p.kk), math.sqrt(p.ff), math.sqrt(p.cc))


def believed_m(x: float, variance_m2: float, measured_m: float, noise_m2: float) -> float:
    """Return the reading in m, at most as far from x as a reading with `noise_m2` can be: outliers have less weight."""
    reach_m = _FARTHEST * math.sqrt(variance_m2 + noise_m2)
    return min(max(measured_m, x - reach_m), x + reach_m)


_FARTHEST = 4.0
"""In standard deviations."""


def as_one_more_m2(rest: Resting, variance_m2: float, hidden_m2: float) -> float:
    """Return the variance of the next reading of a rest, for an average that stays uncertain by `hidden_m2`.

    The average of n readings has the variance V/n + H. What the readings of this rest have told so far gives n.
    """
    if hidden_m2 == 0.0:
        return variance_m2
    told = 1.0 / rest.variance_m2 - 1.0 / rest.anchor.covariance.xx
    left = 1.0 - told * hidden_m2
    if left < _NOTHING_MORE:
        return math.inf
    count = max(told, 0.0) * variance_m2 / left
    return (variance_m2 + count * hidden_m2) * (variance_m2 + (count + 1.0) * hidden_m2) / variance_m2


_NOTHING_MORE = 1e-3
"""Where this part of the information is left, no further reading tells anything."""


def average(rest: Resting, measured_m: float, variance_m2: float) -> Resting:
    """Return the estimate after one more reading of a resting stem."""
    if variance_m2 == math.inf:
        return rest
    gain = rest.variance_m2 / (rest.variance_m2 + variance_m2)
    x = rest.x + gain * (measured_m - rest.x)
    return Resting(x, (1.0 - gain) * rest.variance_m2, rest.anchor, rest.slopes)
