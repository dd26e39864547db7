"""What the whole way of a move teaches: spring, offset, friction, lag and dead time in one step. Pure.

The rollout of `valve.rollout` says where the stem is at each reading, for each value of the numbers

    θ = (k, c, f_c, f_s, ln τ, ln ν, T_d),    τ: lag and a millisecond, ν: viscous friction over the configured one.

A move away and the one back are one way, which shows the friction of both directions. Readings z, in at most 64 blocks,
are a measurement z = h(θ) + noise. What is believed of θ is a Gaussian, so θ is found by Gauss-Newton steps from it
(iterated extended Kalman filter, Bell and Cathey 1993), with derivatives of the rollout by differences.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.slip import both_sides, numbers_of
from positioner.values import dataclass, replace
from positioner.valve.gaussian import condensed
from positioner.valve.rollout import Moving
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.valve.gaussian import Gaussian
    from positioner.valve.pressure import PressureState
    from positioner.valve.rollout import Plant
    from positioner.valve.sensor import SensorLag

_BLOCKS = 64
"""Of readings; when they are full, two become one."""
_MOST_RUNS = 400
"""Changes of the current in one move; a move with more of them is not studied."""
_STEPS, _NEAR = 3, 0.1
"""Gauss-Newton steps at most, and of σ of the way's blocks: a step that changes the way by less is the last one."""
_OWN_M, _OWN = 0.0005, 0.05
"""σ of the rollout itself: 0.5 mm, and 5 % of the way, for what it does not know (Stribeck friction, flow, forces)."""
_MORE = 2.0
"""What the way itself shows of the rollout's variance counts twice, since the numbers were fitted to it; at least as
much as the ways before have shown."""
_INDEPENDENT = 6.0
"""What the rollout does not know is alike in neighbouring blocks: all of them count as six."""


@dataclass(frozen=True, slots=True)
class Way:
    """What was commanded and read since a move began.

    begun: the pressure then; start_m: the stem. runs: currents in mA, and for how many samples each. sums: of the
    readings in each block; size: readings in a block; filled: in the last one.
    """

    begun: PressureState
    start_m: float
    runs: tuple[tuple[float, int], ...] = ()
    sums: tuple[float, ...] = ()
    size: int = 1
    filled: int = 1

    @property
    def is_whole(self) -> bool:
        """Whether all of it was kept."""
        return len(self.runs) < _MOST_RUNS

    def read(self, current_ma: float, measured_m: float) -> Way:
        """Return the way after a sample under a current, at whose end a reading came."""
        if not self.is_whole:
            return self
        runs, sums, size = self.runs, self.sums, self.size
        if runs and runs[-1][0] == current_ma:
            runs = (*runs[:-1], (current_ma, runs[-1][1] + 1))
        else:
            runs = (*runs, (current_ma, 1))
        if self.filled < size and sums:
            return replace(self, runs=runs, sums=(*sums[:-1], sums[-1] + measured_m), filled=self.filled + 1)
        if len(sums) == _BLOCKS:
            sums, size = tuple([sums[i] + sums[i + 1] for i in range(0, _BLOCKS, 2)]), 2 * size
        return replace(self, runs=runs, sums=(*sums, measured_m), size=size, filled=1)


@dataclass(frozen=True, slots=True)
class Linear:
    """The rollout of a way, linear around θ.

    end_m: its last block; line: how that depends on the numbers. square_m2: mean square of what is left of the blocks.
    lines, left_m: what the blocks measure, in a measurement for each number (`condensed`).
    """

    theta: tuple[float, ...]
    end_m: float
    line: tuple[float, ...]
    blocks: int
    square_m2: float
    lines: list[tuple[float, ...]]
    left_m: list[float]

    def change_m2(self, theta: tuple[float, ...]) -> float:
        """Return the mean square in m² by which other numbers change the blocks."""
        total_m2 = 0.0
        for line in self.lines:
            change_m = 0.0
            for place, slope in enumerate(line):
                change_m += slope * (theta[place] - self.theta[place])
            total_m2 += change_m * change_m
        return total_m2 / self.blocks

    def step(self, prior: Gaussian, variance_m2: float) -> tuple[Gaussian, float]:
        """Return what is believed after a Gauss-Newton step, and the logarithm of how likely the way was before it.

        variance_m2: of a block. What all numbers leave of the way is not in that likelihood.
        """
        numbers, log_likelihood = prior, 0.0
        variance_m2 *= max(1.0, self.blocks / _INDEPENDENT)
        for line, left_m in zip(self.lines, self.left_m, strict=True):
            innovation_m = left_m
            for place, slope in enumerate(line):
                innovation_m += slope * (self.theta[place] - numbers.mean[place])
            total_m2 = numbers.variance(line) + variance_m2
            log_likelihood -= 0.5 * (innovation_m * innovation_m / total_m2 + math.log(total_m2))
            numbers = numbers.updated(line, innovation_m, variance_m2)
        return numbers, log_likelihood


@dataclass(frozen=True, slots=True)
class Studied:
    """What a way has taught: the numbers, and whether they explain it.

    left_m2: mean square of what they leave of the way, beside noise_m2, that of the readings; left_part: over the
    variance of the rollout, at most 1. gone_m: the length of the way; missed_m: its end less where it was expected
    before the move; line: how that depends on the numbers. fit: the way around the numbers that explain it;
    variance_m2: of a block beside it.
    """

    numbers: Gaussian
    is_explained: bool
    left_m2: float
    noise_m2: float
    left_part: float
    gone_m: float
    missed_m: float
    line: tuple[float, ...]
    fit: Linear
    variance_m2: float

    def log_factor(self, prior: Gaussian, other: Gaussian) -> float:
        """Return the logarithm of how likely the way is for another prior of the numbers, over how likely for one.

        Both are compared around the numbers that were found.
        """
        return self.fit.step(other, self.variance_m2)[1] - self.fit.step(prior, self.variance_m2)[1]


@dataclass(frozen=True, slots=True)
class Study:
    """One way, and how it was seen.

    local_ma: what the friction near its end takes more than that of the whole valve. stops_m: the ends of the travel,
    beyond which no stem is seen.
    """

    plant: Plant
    way: Way
    local_ma: float
    sensor: SensorLag
    stops_m: tuple[float, float]

    def of(
        self,
        numbers: Gaussian,
        within: Callable[[Gaussian], Gaussian],
        end_m: float,
        reading_m2: float,
        left_part: float,
        near: Linear | None = None,
    ) -> Studied:
        """Return what is believed after a move; a way is explained within σ of the rollout.

        Args:
            numbers: θ before the move.
            within: puts a mean inside its limits.
            end_m: where the stem rests.
            reading_m2: variance of a reading.
            left_part: part of the rollout's variance that is expected to be left of the way.
            near: the way around numbers with which the search begins, in place of the mean of θ.
        """
        gone_m, noise_m2 = self._gone_m(end_m), reading_m2 / self.way.size
        own_m2 = (_OWN_M + _OWN * gone_m) ** 2

        def seen_m2(fit: Linear) -> float:
            """Return the variance of a block, by what is left of the way."""
            shown_m2 = max(_MORE * (fit.square_m2 - noise_m2), left_part * own_m2)
            return noise_m2 + min(shown_m2, own_m2)

        first = fit = near or self._linear(numbers, numbers.mean)
        for _ in range(_STEPS):
            found = within(fit.step(numbers, noise_m2 + own_m2)[0])
            if fit.change_m2(found.mean) < _NEAR * _NEAR * seen_m2(fit):
                break
            fit = self._linear(numbers, found.mean)
        left_m2, variance_m2 = max(fit.square_m2 - noise_m2, 0.0), seen_m2(fit)
        found = within(fit.step(numbers, variance_m2)[0])
        missed_m, part = end_m - first.end_m, min(left_m2 / own_m2, 1.0)
        return Studied(found, left_m2 < own_m2, left_m2, noise_m2, part, gone_m, missed_m, first.line, fit, variance_m2)

    def _gone_m(self, end_m: float) -> float:
        """Return the length of the way, there and back."""
        start_m, full = self.way.start_m, self.way.sums[:-1] or self.way.sums
        places_m = [start_m, end_m, *[total / self.way.size for total in full]]
        return 2.0 * (max(places_m) - min(places_m)) - abs(end_m - start_m)

    def blocks(self, theta: tuple[float, ...]) -> list[float]:
        """Return the means of the full blocks as θ has them."""
        rollout, way = self.plant.rollout(numbers_of(theta, self.local_ma)), self.way
        moving = Moving(way.begun, StemState(way.start_m, 0.0, True, 1.0))
        found: list[float] = []
        total_m, filled, seen_m, (low_m, high_m) = 0.0, 0, way.start_m, self.stops_m
        before_m, size = way.start_m, way.size
        for place_m in rollout.places_m(moving, way.runs):
            stem_m = min(max(place_m, low_m), high_m)
            seen_m = self.sensor.after(before_m, stem_m, seen_m)
            total_m, filled, before_m = total_m + seen_m, filled + 1, stem_m
            if filled == size:
                found.append(total_m / filled)
                total_m, filled = 0.0, 0
        return found

    def _linear(self, prior: Gaussian, theta: tuple[float, ...]) -> Linear:
        """Return the way around θ, with its derivatives by each number that is not certain, by differences."""
        expected = self.blocks(theta)
        columns = []
        for place, variance in enumerate(prior.variances):
            if variance == 0.0:
                columns.append([0.0] * len(expected))
                continue
            apart, higher, lower = both_sides(theta, place)
            ups, downs = self.blocks(higher), self.blocks(lower)
            columns.append([(up - down) / apart for up, down in zip(ups, downs, strict=True)])
        way = self.way
        left_m = [way.sums[block] / way.size - expected_m for block, expected_m in enumerate(expected)]
        square_m2 = sum([miss_m * miss_m for miss_m in left_m]) / len(left_m)
        ends = tuple([column[-1] for column in columns])
        return Linear(theta, expected[-1], ends, len(expected), square_m2, *condensed(columns, left_m))
