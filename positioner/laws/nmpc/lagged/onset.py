"""When did the stem slip? A bank of hypotheses, each with its own motion, that the readings tell apart. Pure.

On a ramp of pressure the stem slips at an unknown instant. Each sample adds the hypothesis "it slipped now", with a
weight from what is believed of F_s. The model moves every hypothesis on, and each reading changes its likelihood
against that of a stem which still sticks. The bank says how probable a slip is, then where the stem is, and how fast.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.slip import Slip
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.pipeline import Pipeline
    from positioner.laws.nmpc.lagged.sensor_lag import SensorLag


@dataclass(frozen=True, slots=True)
class Onset:
    """The hypothesis that the force `static_n` freed the stem, known to a variance of `static_n2`.

    moved_m, v: how far from where it stuck, and how fast in m/s. seen_m: how far by the sensor. weight: the prior.
    evidence: log likelihood ratio against a stem that still sticks.
    """

    moved_m: float
    v: float
    seen_m: float
    static_n: float
    static_n2: float
    weight: float
    evidence: float


@dataclass(frozen=True, slots=True)
class OnsetBank:
    """The hypotheses, oldest first; `reached`: the prior probability of a slip up to now."""

    onsets: tuple[Onset, ...] = ()
    reached: float = 0.0

    def scored(self, seen_m: float, variance_m2: float) -> OnsetBank:
        """Return the bank after a reading `seen_m` from where the stem stuck; `variance_m2` is of that difference."""
        by = 0.5 / variance_m2
        scored = [
            Onset(
                each.moved_m,
                each.v,
                each.seen_m,
                each.static_n,
                each.static_n2,
                each.weight,
                each.evidence + by * each.seen_m * (2.0 * seen_m - each.seen_m),
            )
            for each in self.onsets
        ]
        return OnsetBank(tuple(scored), self.reached)

    def probability(self) -> float:
        """Return the probability that the stem has slipped."""
        most = self.most()
        slipped = 0.0
        for each in self.onsets:
            slipped += each.weight * math.exp(each.evidence - most)
        return slipped / (slipped + (1.0 - self.reached + _LEAST_WEIGHT) * math.exp(-most) + _TINY)

    def most(self) -> float:
        """Return the evidence of the likeliest hypothesis, 0 where none is likelier than a stem that sticks."""
        most = 0.0
        for each in self.onsets:
            most = max(most, each.evidence)
        return most

    def summary(self) -> OnsetEstimate:
        """Return mean and spread of the hypotheses; there is at least one."""
        most = self.most()
        total, x, v, seen, force = 0.0, 0.0, 0.0, 0.0, 0.0
        for each in self.onsets:
            weight = each.weight * math.exp(each.evidence - most) + _TINY
            total += weight
            x, v = x + weight * each.moved_m, v + weight * each.v
            seen, force = seen + weight * each.seen_m, force + weight * each.static_n
        x, v, seen, force = x / total, v / total, seen / total, force / total
        xx, xv, xy, vv, vy, yy, ff = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for each in self.onsets:
            weight = (each.weight * math.exp(each.evidence - most) + _TINY) / total
            dx, dv, dy, df = each.moved_m - x, each.v - v, each.seen_m - seen, each.static_n - force
            xx, xv, xy = xx + weight * dx * dx, xv + weight * dx * dv, xy + weight * dx * dy
            vv, vy, yy, ff = (
                vv + weight * dv * dv,
                vy + weight * dv * dy,
                yy + weight * dy * dy,
                ff + weight * (df * df + each.static_n2),
            )
        return OnsetEstimate(x, v, seen, force, xx, xv, xy, vv, vy, yy, ff)

    def advanced(
        self,
        slip: Slip,
        sensor: SensorLag,
        before: Pipeline,
        current_ma: float,
        x: float,
        sigma_n: float,
    ) -> OnsetBank:
        """Return the bank one sample later, in which `current_ma` acted on the pressure of `before`.

        Args:
            slip: with the believed F_s and F_c.
            sensor: the lag of the readings.
            before: the pressure before the sample.
            current_ma: what acted in it.
            x: where the stem stuck, in m.
            sigma_n: standard deviation of F_s.
        """
        least_gap_n = _LEAST_GAP * (slip.static_n - slip.sliding_n)
        least_m = _STOPPED_OF_JUMP * (slip.static_n - slip.sliding_n) / slip.spring_n_per_m
        floor = min(self.most(), 0.0) - _REFUTED
        pressure_ma, converter_ma = before.pressure_ma, before.converter_ma
        kept = list[Onset]()
        for each in self.onsets:
            if each.evidence < floor:
                continue
            moved_m, v = each.moved_m, each.v
            if v != 0.0:
                own = Slip(
                    slip.model,
                    slip.drive,
                    slip.direction,
                    slip.spring_n_per_m,
                    each.static_n,
                    min(slip.sliding_n, each.static_n - least_gap_n),
                )
                end = own.after(x + moved_m, v, pressure_ma, converter_ma, current_ma)
                moved_m, v = end[0] - x, end[1]
            if v == 0.0 and abs(moved_m) < least_m:
                continue
            seen_m = sensor.after(each.moved_m, moved_m, each.seen_m)
            kept.append(Onset(moved_m, v, seen_m, each.static_n, each.static_n2, each.weight, each.evidence))
        fresh, reached = self._fresh(slip, sensor, before, current_ma, x, sigma_n)
        kept += fresh
        while len(kept) > _MOST_ONSETS:
            _merge_closest(kept)
        return OnsetBank(tuple(kept), reached)

    def _fresh(
        self, slip: Slip, sensor: SensorLag, before: Pipeline, current_ma: float, x: float, sigma_n: float
    ) -> tuple[list[Onset], float]:
        """Return the hypotheses of a slip in the sample that has ended, and the prior probability up to its end.

        The faster the force rises, and the longer the sample is, the more parts of it have a hypothesis of their own.
        """
        s, period_s = slip.direction, slip.drive.period_s
        begin_ma = before.pressure_ma
        end_ma, _ = slip.drive.after(begin_ma, before.converter_ma, current_ma)
        from_n = s * slip.model.net_n(begin_ma, slip.spring_n_per_m, x)
        rise_n = s * slip.model.gain_n_per_ma * (end_ma - begin_ma)
        by_force = min(math.ceil(abs(rise_n) / (_RISE_PER_PART * slip.static_n)), _MOST_PARTS)
        parts = max(by_force, min(math.ceil(period_s / _PART_S), _MOST_ONSETS // 2), 1)
        fresh, reached = list[Onset](), self.reached
        for part in range(parts):
            share = (part + 0.5) / parts
            force_n = from_n + rise_n * share
            weight = _believed(from_n + rise_n * (part + 1) / parts, slip.static_n, sigma_n) - reached
            if weight <= _LEAST_NEW or force_n < _LEAST_FORCE * slip.static_n:
                continue
            reached += weight
            own = slip.with_sliding(min(slip.sliding_n, force_n - _LEAST_GAP * (slip.static_n - slip.sliding_n)))
            end_x, v = own.begun(x, begin_ma + share * (end_ma - begin_ma), end_ma, (1.0 - share) * period_s)
            if v != 0.0:
                seen_m, width_n = sensor.after(0.0, end_x - x, 0.0), rise_n / parts
                fresh.append(Onset(end_x - x, v, seen_m, force_n, width_n * width_n / 12.0, weight, 0.0))
        return fresh, reached


def _believed(force_n: float, static_n: float, sigma_n: float) -> float:
    """Return the probability that this force has freed the stem, before any reading."""
    likely = 0.5 * (1.0 + math.erf((force_n - static_n) / (sigma_n * _ROOT2)))
    even = min(max((force_n / static_n - _EVEN_FROM) / _EVEN_RANGE, 0.0), 1.0)
    return (1.0 - _EVEN_SHARE) * likely + _EVEN_SHARE * even


@dataclass(frozen=True, slots=True)
class OnsetEstimate:
    """Mean and covariance of the hypotheses: moved (x) in m, speed (v) in m/s, seen (y) in m; force (f) in N."""

    x: float
    v: float
    seen: float
    force_n: float
    xx: float
    xv: float
    xy: float
    vv: float
    vy: float
    yy: float
    ff: float


def _merge_closest(onsets: list[Onset]) -> None:
    """Make one hypothesis of the two neighbours that are nearest to each other by their readings."""
    best, least = 0, math.inf
    for index in range(len(onsets) - 1):
        distance = abs(onsets[index].seen_m - onsets[index + 1].seen_m)
        if distance < least:
            best, least = index, distance
    one, two = onsets[best], onsets[best + 1]
    most = max(one.evidence, two.evidence)
    first = one.weight * math.exp(one.evidence - most) + _TINY
    second = two.weight * math.exp(two.evidence - most) + _TINY
    total = first + second
    a, b = first / total, second / total
    weight, apart_n = one.weight + two.weight, one.static_n - two.static_n
    onsets[best : best + 2] = [
        Onset(
            a * one.moved_m + b * two.moved_m,
            a * one.v + b * two.v,
            a * one.seen_m + b * two.seen_m,
            a * one.static_n + b * two.static_n,
            a * one.static_n2 + b * two.static_n2 + a * b * apart_n * apart_n,
            weight,
            most + math.log(total / weight),
        )
    ]


_ROOT2 = math.sqrt(2.0)
_TINY = 1e-300
_LEAST_WEIGHT = 1e-9
_LEAST_NEW = 1e-7
"""A hypothesis of less prior probability is not made."""
_EVEN_SHARE, _EVEN_FROM, _EVEN_RANGE = 0.1, 0.5, 1.1
"""This part of the prior is even, between 0.5 and 1.6 of the believed F_s: the belief may be wrong."""
_LEAST_FORCE = 0.4
_RISE_PER_PART, _MOST_PARTS = 0.04, 4
"""A sample has one hypothesis for each such rise of the force, as a part of F_s, and so many at most."""
_PART_S = 0.001
"""A long sample has one for each such time."""
_REFUTED = 18.0
"""A hypothesis that is less likely by this exponent is deleted."""
_STOPPED_OF_JUMP = 0.25
"""A hypothesis that has stopped within this part of the natural jump (F_s - F_c)/K is deleted."""
_LEAST_GAP = 0.5
"""Of the believed F_s - F_c: a force that frees the stem exceeds its F_c by so much, or the slip would hardly begin."""
_MOST_ONSETS = 24
