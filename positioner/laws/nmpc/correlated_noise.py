"""How noisy the sensor is if each error remembers a part ρ of the one before: by likelihood, over all rests. Pure.

While the stem rests at x, a reading is y_k = x + n_k, with n_k = ρ n_(k-1) + e_k and white e. Then y_k - ρ y_(k-1) is
(1 - ρ) x + e_k: for each ρ, the scatter of these differences around their mean, rest by rest, gives the variance of e,
and its likelihood. Three sums hold the scatter for every ρ. A rest may be short, and no x need be known, so that a law
that moves again and again learns, too. Of one rest only the first reading and the mean are lost.

The average of n readings has V σ²/n as variance, V = var(e)/(1 - ρ)², so that a correlated sensor counts for what it is
worth. `averaged` is the mean of V over all ρ, by their probabilities.
"""

from __future__ import annotations

import math

from positioner.values import dataclass, replace

_RHOS = (0.0, 0.3, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995)
_WHITE_BEFORE = math.log(50.0)
"""Log odds of white noise, against each other ρ, before anything is learned."""
_AS_GOOD_AS_WHITE = 0.1
_PRIOR_PAIRS, _PRIOR_FADES = 4.0, 10.0
"""Weight of the configured noise, in pairs of readings, which is half as much after so many pairs."""
_PAIRS_KEPT = 4000.0
"""The sums are halved at this many pairs, so that the estimate follows a sensor that ages."""
_EVERY = 8.0
"""The variances are computed once in so many readings, and at the end of a rest."""
_LEAST = 1e-12
"""Variance of e, in units of the configured σ², below which noise is none."""
_FEW_PAIRS = 3.0
"""Fewer pairs of readings teach no ρ."""


@dataclass(frozen=True, slots=True)
class CorrelatedNoise:
    """The sums over all rests, the means and sums of this rest, and what follows from them.

    Readings are in units of the configured σ, variances in its square. yy, yz, zz: centred sums of products of a
    reading y and the one before, z, over all finished `rests`, with `pairs` degrees of freedom. count, mean_y, mean_z,
    own_yy, own_yz, own_zz: of this rest. last: the last reading.
    averaged: variance of the mean of n readings, times n: at first that of the ρ that are assumed. of_reading: variance
        of one reading.
    """

    yy: float = 0.0
    yz: float = 0.0
    zz: float = 0.0
    pairs: float = 0.0
    rests: float = 0.0
    count: float = 0.0
    mean_y: float = 0.0
    mean_z: float = 0.0
    own_yy: float = 0.0
    own_yz: float = 0.0
    own_zz: float = 0.0
    last: float | None = None
    averaged: float = 13.0
    of_reading: float = 1.0

    def followed_by(self, value: float) -> CorrelatedNoise:
        """Return the noise after one more reading of this rest."""
        before = self.last
        if before is None:
            return replace(self, last=value)
        count = self.count + 1.0
        by_y, by_z = value - self.mean_y, before - self.mean_z
        mean_y, mean_z = self.mean_y + by_y / count, self.mean_z + by_z / count
        own_yy = self.own_yy + by_y * (value - mean_y)
        own_yz = self.own_yz + by_y * (before - mean_z)
        own_zz = self.own_zz + by_z * (before - mean_z)
        averaged, of_reading = self.averaged, self.of_reading
        if count % _EVERY == 0.0:
            free = self.pairs + count - 1.0
            averaged, of_reading = _variances(
                self.yy + own_yy, self.yz + own_yz, self.zz + own_zz, free, self.rests + 1.0
            )
        return CorrelatedNoise(
            self.yy,
            self.yz,
            self.zz,
            self.pairs,
            self.rests,
            count,
            mean_y,
            mean_z,
            own_yy,
            own_yz,
            own_zz,
            value,
            averaged,
            of_reading,
        )

    def at_new_place(self) -> CorrelatedNoise:
        """Return the noise of a stem that rests at another place: this rest is over, and its sums count."""
        if self.count == 0.0:
            return replace(self, last=None)
        pairs = self.pairs + self.count - 1.0
        keep = 0.5 if pairs > _PAIRS_KEPT else 1.0
        yy, yz, zz = keep * (self.yy + self.own_yy), keep * (self.yz + self.own_yz), keep * (self.zz + self.own_zz)
        pairs, rests = keep * pairs, keep * (self.rests + 1.0)
        averaged, of_reading = _variances(yy, yz, zz, pairs, rests)
        return CorrelatedNoise(yy, yz, zz, pairs, rests, averaged=averaged, of_reading=of_reading)


def _variances(yy: float, yz: float, zz: float, pairs: float, rests: float) -> tuple[float, float]:
    """Return the variance of an average and of a reading, means over all ρ by their probabilities."""
    highest, logs = -math.inf, list[float]()
    length = (pairs + rests) / rests
    likeliest = yz / zz if zz > 0.0 else 0.0
    # the unknown mean of a short rest takes a part of the correlation away
    likeliest = min(max(likeliest + (1.0 + likeliest) / length, 0.0), _RHOS[-1])
    rhos = (*_RHOS, likeliest)
    for rho in rhos:
        scatter = max(yy - 2.0 * rho * yz + rho * rho * zz, 0.0) / max(pairs, 1.0) + _LEAST
        # how far the variance of a reading is from the configured one: by a heavy tail, since it may be far
        away = math.log(scatter / (1.0 - rho * rho))
        log = -0.5 * max(pairs - _FEW_PAIRS, 0.0) * math.log(scatter) - 2.0 * math.log(1.0 + 0.25 * away * away)
        # the unknown mean of each rest, integrated out
        log -= 0.5 * rests * math.log(1.0 + length * (1.0 - rho) / (1.0 + rho))
        if rho < _AS_GOOD_AS_WHITE:
            log += _WHITE_BEFORE
        logs.append(log)
        highest = max(highest, log)
    prior = _PRIOR_PAIRS * _PRIOR_FADES / (_PRIOR_FADES + pairs)
    total, averaged, of_reading = 0.0, 0.0, 0.0
    for index in range(len(rhos)):
        rho = rhos[index]
        if logs[index] < highest - _IMPROBABLE:
            continue
        weight = math.exp(logs[index] - highest)
        scatter = max(yy - 2.0 * rho * yz + rho * rho * zz, 0.0)
        variance = (scatter + prior * (1.0 - rho * rho)) / (pairs + prior)
        total += weight
        averaged += weight * variance / ((1.0 - rho) * (1.0 - rho))
        of_reading += weight * variance / (1.0 - rho * rho)
    return averaged / total, of_reading / total


_IMPROBABLE = 20.0
"""Log probability, below that of the best ρ, under which a ρ does not count."""
