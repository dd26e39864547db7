"""What the readings of a resting stem teach: how noisy the sensor is, whether the last push freed it, F_s. Pure.

A push that fails to free the stem must not teach that friction slowed it, and small moves hide in the noise. So the
average of a stem that never moved is carried along, and the likelihoods of both are weighed, reading by reading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.nmpc.filter import average
from positioner.laws.nmpc.sensor_noise import NoiseLevel

if TYPE_CHECKING:
    from positioner.laws.nmpc.filter import Resting
    from positioner.laws.nmpc.landing import Landing
    from positioner.valve.stiction import LearnedSample


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchSettings(SettingsTable):
    """The `[control.nmpc.watch]` table of a configuration.

    verdict: log likelihood ratio that decides whether a move has happened.
    ratio_rise, ratio_fall: how F_s/F_c follows a push that failed, and one of no more than Γ that did not.
    ratio_most: how far F_s/F_c may rise.
    surprise_sigma, surprise_weight: smoothed innovation, in its own σ, at which a resting stem must have moved, and
        the weight of the newest innovation in it.
    """

    verdict: Annotated[float, Interval(gt=0.0, le=100.0)] = 4.0
    ratio_rise: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.03
    ratio_fall: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.003
    ratio_most: Annotated[float, Interval(ge=1.0, le=100.0)] = 2.0
    surprise_sigma: Annotated[float, Interval(ge=3.0, le=20.0)] = 5.0
    surprise_weight: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.1


@dataclass(frozen=True, slots=True)
class Trial:
    """A move that is not yet sure to have happened.

    origin: the estimate of a stem that did not move. direction: ±1, of the move.
    at_limit: it was pushed with no more than Γ. way_m: how far it was to go.
    stop: what its end will have taught of the stick speed.
    evidence: log likelihood ratio, positive when it moved.
    """

    origin: Resting
    direction: float
    at_limit: bool
    way_m: float = 0.0
    stop: LearnedSample | None = None
    evidence: float = 0.0

    @property
    def moved(self) -> bool:
        """Whether the evidence says that it happened."""
        return self.evidence > 0.0

    def has_failed(self, stem: Resting) -> bool:
        """Whether a move that ends without evidence has left the stem, as it seems to rest, where it was."""
        doubt_m = _SIGNIFICANT * math.sqrt(stem.variance_m2 + self.origin.variance_m2)
        return self.direction * (stem.x - self.origin.x) < abs(self.way_m) / 2.0 and abs(self.way_m) > doubt_m


@dataclass(frozen=True, slots=True)
class Watch:
    """What is known beside the estimate.

    ratio: F_s/F_c. noise: variance of the sensor. drift: smoothed innovation of the resting stem, in σ.
    trial: the last move, while it is on trial. landing: the last move, until it is known where it ended.
    """

    ratio: float
    noise: NoiseLevel = field(default_factory=NoiseLevel)
    drift: float = 0.0
    trial: Trial | None = None
    landing: Landing | None = None

    def elsewhere(self) -> Watch:
        """Return the watch over a stem that has come to rest at another place."""
        return replace(self, noise=self.noise.moved(), drift=0.0)

    def is_surprised(self, settings: WatchSettings) -> bool:
        """Whether the innovations say that a stem has moved that should rest."""
        weight = settings.surprise_weight
        return abs(self.drift) > settings.surprise_sigma * math.sqrt(weight / (2.0 - weight))


def watch(
    settings: WatchSettings, state: Watch, stem: Resting, measured_m: float, variance_m2: float, sigma_m: float
) -> Watch:
    """Return the watch after a reading with `variance_m2`; `sigma_m` is the sensor's configured σ."""
    innovation = (measured_m - stem.x) / math.sqrt(stem.variance_m2 + variance_m2)
    drift = state.drift + settings.surprise_weight * (innovation - state.drift)
    return Watch(state.ratio, state.noise.heard(measured_m / sigma_m), drift, state.trial, state.landing)


def judge(
    settings: WatchSettings, state: Watch, before: Resting, after: Resting, measured_m: float, variance_m2: float
) -> tuple[Watch, Resting, Trial | None]:
    """Return the watch, the estimate and the decided trial, if any, after a reading took `before` to `after`.

    A stem that did not move is given back the estimate from before the move, and a larger F_s. Where more readings
    would only bring the two estimates together, the trial ends without a lesson, and the landing, which may be none,
    with it.
    """
    trial = state.trial
    if trial is None:
        return state, after, None
    origin = average(trial.origin, measured_m, variance_m2)
    evidence = (
        trial.evidence
        + _log_likelihood(before, measured_m, variance_m2)
        - _log_likelihood(trial.origin, measured_m, variance_m2)
    )
    apart_m = after.x - origin.x
    alike = apart_m * apart_m < _ALIKE * (after.variance_m2 + origin.variance_m2)
    if abs(evidence) < settings.verdict:
        if alike:
            return replace(state, trial=None, landing=None), after, None
        going_on = Trial(origin, trial.direction, trial.at_limit, trial.way_m, trial.stop, evidence)
        return replace(state, trial=going_on), after, None
    decided = Trial(trial.origin, trial.direction, trial.at_limit, trial.way_m, trial.stop, evidence)
    if not decided.moved:
        ratio = min(state.ratio * (1.0 + settings.ratio_rise), max(settings.ratio_most, state.ratio))
        return replace(state, trial=None, landing=None, ratio=ratio, drift=0.0), origin, decided
    ratio = max(1.0, state.ratio * (1.0 - settings.ratio_fall)) if trial.at_limit else state.ratio
    return replace(state, trial=None, ratio=ratio, drift=0.0), after, decided


_SIGNIFICANT = 3.0
"""Standard deviations beyond which a way is no doubt."""
_ALIKE = 0.25
"""Squared distance of the two estimates, in their variances, below which more readings only bring them together."""


def _log_likelihood(stem: Resting, measured_m: float, variance_m2: float) -> float:
    variance = stem.variance_m2 + variance_m2
    error = measured_m - stem.x
    return -0.5 * (error * error / variance + math.log(variance))
