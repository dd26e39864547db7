"""Breakaway verification: whether the last push freed the stem, and what that means for F_s/F_c. Pure.

A push that fails to free the stem must not teach that friction slowed the stem, and small moves hide in the noise. So
there are two estimates: of a stem that moved, and of one that did not. Their likelihoods are compared at every reading.
"""

from __future__ import annotations

import math
from dataclasses import field
from typing import TYPE_CHECKING

from positioner.laws.nmpc.filter import average
from positioner.laws.nmpc.sensor_noise import Octave, nothing_learned
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.filter import Resting
    from positioner.laws.nmpc.landing import Landing
    from positioner.laws.nmpc.settings import VerificationSettings
    from positioner.valve.stiction import LearnedSample


@dataclass(frozen=True, slots=True)
class Verification:
    """The verification of one move.

    origin: the estimate of a stem that did not move. direction: ±1, of the move.
    at_limit: the push was no stronger than Γ. distance_m: how far the stem was to go.
    stop: what the end of the move teaches of the stick speed, if it happened.
    evidence: log likelihood ratio, positive where the stem seems to have moved.
    """

    origin: Resting
    direction: float
    at_limit: bool
    distance_m: float = 0.0
    stop: LearnedSample | None = None
    evidence: float = 0.0

    @property
    def moved(self) -> bool:
        """Whether the stem has moved, by the evidence."""
        return self.evidence > 0.0

    def has_failed(self, stem: Resting) -> bool:
        """Whether the stem seems to rest where it was, after a move that ended without enough evidence."""
        doubt_m = _SIGNIFICANT * math.sqrt(stem.variance_m2 + self.origin.variance_m2)
        moved_m = self.direction * (stem.x - self.origin.x)
        return moved_m < abs(self.distance_m) / 2.0 and abs(self.distance_m) > doubt_m


@dataclass(frozen=True, slots=True)
class RestMonitor:
    """What the readings of a resting stem show, beside the estimate.

    ratio: F_s/F_c. noise: variance of the sensor. drift: smoothed innovation of the resting stem, in σ.
    verification: of the last move, None once it is decided. landing: the last move, None once its end is known.
    """

    ratio: float
    noise: Octave = field(default_factory=nothing_learned)
    drift: float = 0.0
    verification: Verification | None = None
    landing: Landing | None = None

    def with_reading(
        self, settings: VerificationSettings, stem: Resting, measured_m: float, variance_m2: float, sigma_m: float
    ) -> RestMonitor:
        """Return the monitor after a reading with `variance_m2`; `sigma_m` is the sensor's configured σ."""
        innovation = (measured_m - stem.x) / math.sqrt(stem.variance_m2 + variance_m2)
        drift = self.drift + settings.surprise_weight * (innovation - self.drift)
        noise = self.noise.followed_by(measured_m / sigma_m)
        return RestMonitor(self.ratio, noise, drift, self.verification, self.landing)

    def at_new_place(self) -> RestMonitor:
        """Return the monitor of a stem that has come to rest at another place."""
        return replace(self, noise=self.noise.at_new_place(), drift=0.0)

    def finds_unexpected_move(self, settings: VerificationSettings) -> bool:
        """Whether the innovations show that a stem has moved that should rest."""
        weight = settings.surprise_weight
        return abs(self.drift) > settings.surprise_sigma * math.sqrt(weight / (2.0 - weight))


def verify(
    settings: VerificationSettings,
    monitor: RestMonitor,
    before: Resting,
    after: Resting,
    measured_m: float,
    variance_m2: float,
) -> tuple[RestMonitor, Resting, Verification | None]:
    """Return the monitor, the estimate and the verification if it is decided, after a reading.

    The reading took the estimate `before` to `after`. Where the stem did not move, the estimate is again the one from
    before the move, and F_s is larger. Where more readings would only bring the two estimates together, the
    verification ends without a lesson. The landing then ends, too, since it may never have happened.
    """
    verification = monitor.verification
    if verification is None:
        return monitor, after, None
    origin = average(verification.origin, measured_m, variance_m2)
    evidence = (
        verification.evidence
        + _log_likelihood(before, measured_m, variance_m2)
        - _log_likelihood(verification.origin, measured_m, variance_m2)
    )
    apart_m = after.x - origin.x
    alike = apart_m * apart_m < _ALIKE * (after.variance_m2 + origin.variance_m2)
    if abs(evidence) < settings.verdict:
        if alike:
            return replace(monitor, verification=None, landing=None), after, None
        return replace(monitor, verification=replace(verification, origin=origin, evidence=evidence)), after, None
    decided = replace(verification, evidence=evidence)
    if not decided.moved:
        ratio = min(monitor.ratio * (1.0 + settings.ratio_rise), max(settings.ratio_most, monitor.ratio))
        return replace(monitor, verification=None, landing=None, ratio=ratio, drift=0.0), origin, decided
    ratio = max(1.0, monitor.ratio * (1.0 - settings.ratio_fall)) if verification.at_limit else monitor.ratio
    return replace(monitor, verification=None, ratio=ratio, drift=0.0), after, decided


_SIGNIFICANT = 3.0
"""Standard deviations beyond which a distance is certain."""
_ALIKE = 0.25
"""Squared distance of the two estimates, in their variances, below which more readings only bring them together."""


def _log_likelihood(stem: Resting, measured_m: float, variance_m2: float) -> float:
    variance = stem.variance_m2 + variance_m2
    error = measured_m - stem.x
    return -0.5 * (error * error / variance + math.log(variance))
