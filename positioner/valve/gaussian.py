"""A Gaussian over a few numbers: what is believed of them, and what measurements teach. Pure.

The numbers are a vector θ with the mean μ and the covariance P. A measurement is a line: z = hᵀθ + noise (Kalman 1960).
"""

from __future__ import annotations

import math

from positioner.values import dataclass

_MOST_CERTAIN = 0.9
"""Of its variance a bound takes at most this part: a second bound can still correct the first one."""
_TAIL = 3.0
"""A bound so many σ away from what is believed says nothing new."""
_LEAST_VARIANCE = 1e-10
"""In squares of the numbers' units; no measurement makes a variance smaller, which would be rounding."""

_DEPENDENT = 1e-12
"""Of the square of a column, what is left of one that depends on those before it: rounding, not a measurement."""


@dataclass(frozen=True, slots=True)
class Gaussian:
    """The mean, n numbers, and the covariance, n × n numbers row by row, in products of their units."""

    mean: tuple[float, ...]
    covariance: tuple[float, ...]

    def expected(self, line: tuple[float, ...]) -> float:
        """Return hᵀμ."""
        total = 0.0
        for index, weight in enumerate(line):
            total += weight * self.mean[index]
        return total

    def variance(self, line: tuple[float, ...]) -> float:
        """Return hᵀPh."""
        spread, total = self._spread(line), 0.0
        for index, weight in enumerate(line):
            total += weight * spread[index]
        return max(total, _LEAST_VARIANCE)

    @property
    def variances(self) -> tuple[float, ...]:
        """Return the variance of each number."""
        return self.covariance[:: len(self.mean) + 1]

    def widened(self, index: int, variance: float) -> Gaussian:
        """Return the belief in which one number is less certain by this variance."""
        covariance = list(self.covariance)
        covariance[index * (len(self.mean) + 1)] += variance
        return Gaussian(self.mean, tuple(covariance))

    def changed(self, spread: tuple[float, ...]) -> Gaussian:
        """Return the belief in which all numbers have changed together, each by so many σ of one unknown cause."""
        count, covariance = len(self.mean), list(self.covariance)
        for row in range(count):
            for column in range(count):
                covariance[row * count + column] += spread[row] * spread[column]
        return Gaussian(self.mean, tuple(covariance))

    def renewed(self, index: int, mean: float, variance: float) -> Gaussian:
        """Return the belief in which one number is another one, of which the others say nothing."""
        count = len(self.mean)
        covariance = [0.0 if index in divmod(place, count) else known for place, known in enumerate(self.covariance)]
        covariance[index * (count + 1)] = variance
        return Gaussian((*self.mean[:index], mean, *self.mean[index + 1 :]), tuple(covariance))

    def with_mean(self, mean: tuple[float, ...]) -> Gaussian:
        """Return the belief with another mean."""
        return Gaussian(mean, self.covariance)

    def updated(self, line: tuple[float, ...], innovation: float, variance: float) -> Gaussian:
        """Return the belief after a measurement: its innovation z - hᵀμ, and the variance of its noise."""
        spread, total = self._spread(line), self.variance(line) + variance
        return self._moved(spread, innovation / total, 1.0 / total)

    def bounded(self, line: tuple[float, ...], bound: float, variance: float) -> Gaussian:
        """Return the belief after hᵀθ was seen to be above a bound that is known with this variance.

        The mean and the variance of hᵀθ become those of the truncated normal distribution.
        """
        spread, total = self._spread(line), self.variance(line) + variance
        sigma = math.sqrt(total)
        below = (self.expected(line) - bound) / sigma
        if below > _TAIL:
            return self
        hazard = _hazard(-below)
        gain = min(hazard * (hazard + below), _MOST_CERTAIN)
        return self._moved(spread, hazard / sigma, gain / total)

    def _moved(self, spread: tuple[float, ...], step: float, gain: float) -> Gaussian:
        count = len(self.mean)
        mean = [self.mean[index] + spread[index] * step for index in range(count)]
        covariance = list(self.covariance)
        for row in range(count):
            for column in range(count):
                covariance[row * count + column] -= spread[row] * spread[column] * gain
        for row in range(count):
            place = row * (count + 1)
            covariance[place] = max(covariance[place], min(self.covariance[place], _LEAST_VARIANCE))
        return Gaussian(tuple(mean), tuple(covariance))

    def _spread(self, line: tuple[float, ...]) -> tuple[float, ...]:
        """Return Ph; the numbers behind the end of a short line are not in it."""
        count = len(self.mean)
        found = []
        for row in range(count):
            total = 0.0
            for column in range(len(line)):
                total += self.covariance[row * count + column] * line[column]
            found.append(total)
        return tuple(found)


def gaussian_of(mean: tuple[float, ...], sigmas: tuple[float, ...]) -> Gaussian:
    """Return the Gaussian of independent numbers with these standard deviations."""
    count = len(mean)
    covariance = [0.0] * (count * count)
    for index, sigma in enumerate(sigmas):
        covariance[index * (count + 1)] = sigma * sigma
    return Gaussian(mean, tuple(covariance))


def condensed(columns: list[list[float]], residuals: list[float]) -> tuple[list[tuple[float, ...]], list[float]]:
    """Return at most n measurements that say of n numbers what many with independent noise of one variance say.

    The many are r = H dθ + noise. With the Cholesky factor HᵀH = L Lᵀ, they say as much as L⁻¹Hᵀr = Lᵀdθ + noise of the
    same variance, since L⁻¹Hᵀ has orthonormal rows (Golub and Van Loan, Matrix Computations, 5.3).

    Args:
        columns: of H; one of zeros for a number of which the measurements say nothing.
        residuals: r.

    Returns:
        The rows of Lᵀ, and L⁻¹Hᵀr.
    """
    lines: list[tuple[float, ...]] = []
    found: list[float] = []
    for place, column in enumerate(columns):
        line = [0.0] * place
        for other in columns[place:]:
            line.append(_product(column, other))
        total, square = _product(column, residuals), line[place]
        for row, earlier in zip(lines, found, strict=True):
            total -= row[place] * earlier
            for index in range(place, len(line)):
                line[index] -= row[place] * row[index]
        if line[place] <= _DEPENDENT * square:
            continue
        root = math.sqrt(line[place])
        lines.append(tuple([entry / root for entry in line]))
        found.append(total / root)
    return lines, found


def _product(left: list[float], right: list[float]) -> float:
    """Return the scalar product of two vectors."""
    total = 0.0
    for index, entry in enumerate(left):
        total += entry * right[index]
    return total


def _hazard(place: float) -> float:
    """Return φ(a) / (1 - Φ(a)) of the standard normal distribution, also far in its tail."""
    if place > 5.0:  # noqa: PLR2004 - from here on the first terms of the series are exact to 1 %
        return place + 1.0 / place
    density = math.exp(-0.5 * place * place) / math.sqrt(2.0 * math.pi)
    return density / (0.5 * math.erfc(place / math.sqrt(2.0)))
