"""The load as one candidate sees it: K, F_c, F_v and F_s, each as a multiple of the configured one. Pure.

The force that frees the stem is known to lie between two forces: the largest one that did not, and the one that did. So
the load is a normal distribution, cut off at both ends along the direction of this force (its moments are those of the
truncated normal distribution).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.motion import Load, MotionModel

if TYPE_CHECKING:
    from positioner.laws.nmpc.untold.course import Course
    from positioner.valve.parameters import ValveParameters

_DOUBT = 0.12
"""Standard deviation of the configured values."""
_ALIKE = 0.8
"""Correlation of the errors of F_s and F_c."""
_WANDER = 0.03
"""Standard deviation of the change of F_s and F_c from move to move."""
_SCATTER = 0.02
"""Of F_s from onset to onset."""
_LEAST_PROBABILITY = 1e-12
_LEAST_VARIANCE = 1e-6
_FAR = 39.0
"""In standard deviations: beyond them a density is 0."""
_LEAST_RATIO, _MOST_RATIO = 0.92, 1.3
"""Limits of F_s/F_c, as multiples of the configured ratio."""
LEAST, MOST = 0.5, 1.7
"""Limits of the multiples."""


@dataclass(frozen=True, slots=True)
class Nominal:
    """The configured valve: its model, its load, and F_s in N."""

    model: MotionModel
    load: Load
    static_n: float


def nominal_of(valve: ValveParameters) -> Nominal:
    """Return the constants of `valve`."""
    return Nominal(MotionModel.of(valve), Load.of(valve), max(valve.static_friction_n, 1.0))


@dataclass(frozen=True, slots=True)
class LoadBelief:
    """The multiples of K, F_c, F_v and F_s, and their covariance."""

    values: list[float]
    covariance: list[list[float]]

    def wandered(self) -> LoadBelief:
        """Return the belief before the next move."""
        p = [row[:] for row in self.covariance]
        p[1][1] += _WANDER * _WANDER
        p[3][3] += _WANDER * _WANDER
        return LoadBelief(self.values, p)

    def static_n(self, nominal: Nominal) -> float:
        """Return F_s in N, not far from where F_c puts it: one onset that was taken for another spoils F_s alone."""
        by_sliding = self.values[1] * nominal.static_n
        return min(max(self.values[3] * nominal.static_n, _LEAST_RATIO * by_sliding), _MOST_RATIO * by_sliding)

    def load(self, nominal: Nominal) -> Load:
        """Return the load in SI units."""
        own = nominal.load
        return Load(
            self.values[0] * own.spring_n_per_m, self.values[1] * own.friction_n, self.values[2] * own.viscous_n_s_per_m
        )


def prior() -> LoadBelief:
    """Return the belief before the first move."""
    variance = _DOUBT * _DOUBT
    p = [[0.0] * 4 for _ in range(4)]
    for i in range(4):
        p[i][i] = variance
    p[1][3] = p[3][1] = _ALIKE * variance
    return LoadBelief([1.0, 1.0, 1.0, 1.0], p)


@dataclass(frozen=True, slots=True)
class Threshold:
    """What a belief says of the force that frees the stem of a course, as a multiple of F_s and without the bench set.

    mean, sigma: of it. cross: its covariance with the four multiples.
    """

    mean: float
    sigma: float
    cross: list[float]

    def between(self, belief: LoadBelief, least: float, most: float) -> tuple[LoadBelief, float] | None:
        """Return the belief where the force lies between these multiples, and the logarithm of the probability.

        None where that is as good as impossible.
        """
        a = min(max((least - self.mean) / self.sigma, -_FAR), _FAR)
        z = min(max((most - self.mean) / self.sigma, -_FAR), _FAR)
        inside = _below(-a) - _below(-z) if a > 0.0 else _below(z) - _below(a)
        if inside < _LEAST_PROBABILITY:
            return None
        at_a, at_z = _density(a), _density(z)
        shift = (at_a - at_z) / inside
        variance = max(1.0 + (a * at_a - z * at_z) / inside - shift * shift, _LEAST_VARIANCE)
        by = (1.0 - variance) / (self.sigma * self.sigma)
        values = [belief.values[i] + self.cross[i] * shift / self.sigma for i in range(4)]
        p = [[belief.covariance[i][j] - by * self.cross[i] * self.cross[j] for j in range(4)] for i in range(4)]
        return LoadBelief(values, p), math.log(inside)


def threshold(nominal: Nominal, belief: LoadBelief, course: Course) -> Threshold:
    """Return what `belief` says of the force that frees the stem: s·K·x + F_s."""
    spring = nominal.load.spring_n_per_m / nominal.static_n
    lever = course.direction * spring * course.origin_m
    p = belief.covariance
    cross = [lever * p[i][0] + p[i][3] for i in range(4)]
    variance = lever * cross[0] + cross[3] + _SCATTER * _SCATTER + spring * spring * course.variance_m2
    return Threshold(lever * belief.values[0] + belief.values[3], math.sqrt(variance), cross)


def _below(z: float) -> float:
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def _density(z: float) -> float:
    return math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
