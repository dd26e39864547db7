"""Breakaway verification: whether the last push freed the stem, and what that means for F_s/F_c. Pure.

A push that fails to free the stem must not teach that friction slowed the stem, and small moves hide in the noise. So
there are two estimates: of a stem that moved, and of one that did not. Their likelihoods are compared at every reading.
"""

from __future__ import annotations

import math
from dataclasses import field
from typing import TYPE_CHECKING

from positioner.laws.nmpc.filter import average, believed_m
from positioner.laws.nmpc.repeatability import Repeatability
from positioner.laws.nmpc.resolution import Resolution
from positioner.laws.nmpc.sensor_noise import SensorNoise
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
    was_expected: whether the load let the push free the stem; else a failure teaches nothing.
    """

    origin: Resting
    direction: float
    at_limit: bool
    distance_m: float = 0.0
    stop: LearnedSample | None = None
    evidence: float = 0.0
    was_expected: bool = True

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
    resolution: of the sensor. repeatability: of landings.
    """

    ratio: float
    noise: SensorNoise = field(default_factory=SensorNoise)
    drift: float = 0.0
    verification: Verification | None = None
    landing: Landing | None = None
    resolution: Resolution = field(default_factory=Resolution)
    repeatability: Repeatability = field(default_factory=Repeatability)

    def with_reading(
        self, settings: VerificationSettings, stem: Resting, measured_m: float, variance_m2: float, sigma_m: float
    ) -> RestMonitor:
        """Return the monitor after a reading with `variance_m2`; `sigma_m` is the sensor's configured σ."""
        innovation = (measured_m - stem.x) / math.sqrt(stem.variance_m2 + self.scatter_m2(settings, variance_m2))
        drift = self.drift + settings.surprise_weight * (innovation - self.drift)
        noise = self.noise.followed_by(measured_m / sigma_m)
        return RestMonitor(
            self.ratio, noise, drift, self.verification, self.landing, self.resolution, self.repeatability
        )

    def scatter_m2(self, settings: VerificationSettings, variance_m2: float) -> float:
        """Return the variance of a reading for the smoothed innovation, where the average counts it with `variance_m2`.

        Noise that remembers itself is smoothed less, but the smoothed innovation never scatters more than a reading.
        """
        weight, noise = settings.surprise_weight, self.noise
        return variance_m2 * min(1.0, noise.of_reading * (2.0 - weight) / (weight * noise.averaged))

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
    noise_m2: float,
    alone_m2: float,
) -> tuple[RestMonitor, Resting, Verification | None]:
    """Return the monitor, the estimate and the verification if it is decided, after a reading with `noise_m2`.

    It counts with `variance_m2` in an average, alone with `alone_m2`. It took the estimate `before` to `after`. Where
    the stem did not move, the estimate is again the one from before the move, and F_s is larger. Where more readings
    would only bring the two estimates together, or tell nothing new, the verification ends undecided. The landing then
    ends, too, since it may never have happened.
    """
    verification = monitor.verification
    if verification is None:
        return monitor, after, None
    unmoved = verification.origin
    origin = average(unmoved, believed_m(unmoved.x, unmoved.variance_m2, measured_m, noise_m2), variance_m2)
    evidence = verification.evidence + alone_m2 / variance_m2 * (
        _log_likelihood(before, measured_m, alone_m2) - _log_likelihood(unmoved, measured_m, alone_m2)
    )
    apart_m = after.x - origin.x
    alike = apart_m * apart_m < _ALIKE * (after.variance_m2 + origin.variance_m2)
    is_over = alike or variance_m2 == math.inf
    if abs(evidence) < settings.verdict and not is_over:
        return replace(monitor, verification=replace(verification, origin=origin, evidence=evidence)), after, None
    decided = replace(verification, evidence=evidence)
    monitor = ended(settings, monitor, decided)
    if abs(evidence) < settings.verdict:
        stem = origin if evidence < 0.0 or (alike and not verification.was_expected) else after
        return replace(monitor, landing=None), stem, None
    after, landing = (after, monitor.landing) if decided.moved else (origin, None)
    return replace(monitor, landing=landing, drift=0.0), after, decided


def ended(settings: VerificationSettings, monitor: RestMonitor, trial: Verification) -> RestMonitor:
    """Return the monitor without the trial: F_s/F_c learns by the probability that its push has freed the stem.

    Before any evidence the probability is that at which rise and fall are in balance: no evidence teaches nothing. Only
    a push of no more than Γ lowers the ratio, and only one that should have freed the stem raises it.
    """
    rise, fall = settings.ratio_rise, settings.ratio_fall
    before = rise / (rise + fall)
    moved = before / (before + (1.0 - before) * math.exp(-min(max(trial.evidence, -_SURE), _SURE)))
    change = (rise + fall) * (before - moved)
    if not (trial.was_expected if change > 0.0 else trial.at_limit):
        change = 0.0
    ratio = max(1.0, min(monitor.ratio * (1.0 + change), max(settings.ratio_most, monitor.ratio)))
    return replace(monitor, verification=None, ratio=ratio)


_SURE = 50.0
"""Larger log likelihood ratios count as this one."""
_SIGNIFICANT = 3.0
"""Standard deviations beyond which a distance is certain."""
_ALIKE = 0.25
"""Squared distance of the two estimates, in their variances, below which more readings only bring them together."""


def _log_likelihood(stem: Resting, measured_m: float, variance_m2: float) -> float:
    variance = stem.variance_m2 + variance_m2
    error = measured_m - stem.x
    return -0.5 * (min(error * error / variance, _OUTLIER) + math.log(variance))


_OUTLIER = 7.0
"""Squared error of a reading, in its variance, beyond which it is an outlier, which tells nothing more."""
