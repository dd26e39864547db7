"""What a signature shows: spring, friction by place, breakaway, hysteresis, bench set, seat load. Pure.

A sliding stem follows B·p = F_0 + K·x ± (F_c + F_v·v). Half the sum of both branches at one place is the spring, half
their difference the friction. Both are taken in bins of the travel, so that friction that varies does not tilt the
spring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.breakaways import Breakaway, breakaways_of
from positioner.commissioning.identified import Interval
from positioner.commissioning.loop_branches import branches, slow_and_sliding
from positioner.errors import PositionerError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.loop_branches import Branch
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.record import Stretch
    from positioner.valve.parameters import ValveParameters

    Array = NDArray[np.float64]

_BIN_OF_SPAN, _BIN_M = 0.05, 0.005
_FEWEST_BINS = 3
_FEWEST_IN_BIN = 5
_LEAST_OF_USUAL = 0.2
_Z = 1.96
_BAND_POINTS = 200
_STOP_OF_SPAN = 0.03
"""A stem that is farther than this from where it would slide to stands at a stop."""


class SignatureError(PositionerError):
    """Strokes that show no signature; the message says why."""


@dataclass(frozen=True, slots=True)
class FrictionAt:
    """Sliding friction in N at a place in m: half the width of the loop, less the viscous part."""

    position_m: float
    friction_n: float


@dataclass(frozen=True, slots=True)
class Signature:
    """The result, in SI units.

    spring_n_per_m, preload_n: K, and F_0, the spring's force at position 0.
    sliding_n: F_c, the mean over the travel; by_place: in bins; static_n: F_s; breakaways: each one.
    dynamic_error_band_m: the largest difference of the branches over the current, at this ramp.
    reached_m: the lowest and the highest place of the strokes.
    closed_m, open_m: stops that it met, NaN where it met none; seat_load_n: force of the spring on the closed
    stop beyond that of the pressure, without friction, NaN where it did not meet that stop.
    strokes: those that show the sliding stem; rate_ma_per_s, speed_m_per_s: theirs; slow_ma_per_s: of the error band.
    """

    spring_n_per_m: Interval
    preload_n: Interval
    sliding_n: Interval
    static_n: Interval
    by_place: tuple[FrictionAt, ...]
    breakaways: tuple[Breakaway, ...]
    dynamic_error_band_m: float
    rate_ma_per_s: float
    slow_ma_per_s: float
    speed_m_per_s: float
    reached_m: tuple[float, float]
    closed_m: float
    open_m: float
    seat_load_n: float
    strokes: tuple[Branch, ...] = field(compare=False, repr=False)

    @property
    def hysteresis_m(self) -> float:
        """The difference of the branches at equal pressure in m, 2 F_c/K."""
        return 2.0 * self.sliding_n.value / self.spring_n_per_m.value


def signature(
    stretches: Sequence[Stretch], valve: ValveParameters, limits: ProcedureLimits, period_s: float
) -> Signature:
    """Return what the strokes and breakaways of a signature show.

    Raises:
        SignatureError: the stem has not slid over some bins of the travel in both directions.
    """
    slow, loop = slow_and_sliding(branches(stretches, valve, limits, period_s))
    width_m = min(_BIN_M, _BIN_OF_SPAN * limits.span_m)
    numbers, up_ma, down_ma = _bins(loop, width_m)
    if len(numbers) < _FEWEST_BINS:
        raise SignatureError(
            f"the stem slid in both directions over {len(numbers)} bins of {width_m * 1e3:g} mm only: look at the "
            "range of the current in [guard], at the air supply, and at the travel stops"
        )
    gain, places_m = valve.force_gain_n_per_ma, (numbers + 0.5) * width_m
    spring, preload = _line(places_m, 0.5 * gain * (up_ma + down_ma))
    rate = loop[0].rate_ma_per_s
    speed = gain * rate / spring.value
    widths_n = 0.5 * gain * (up_ma - down_ma)
    scatter_n = float(np.std(widths_n, ddof=1)) / math.sqrt(len(widths_n))
    sliding_n = float(np.mean(widths_n))
    sliding = Interval(sliding_n, sliding_n - _Z * scatter_n, sliding_n + _Z * scatter_n)
    fitted = replace(
        valve,
        spring_rate_n_per_m=spring.value,
        bench_set_n=preload.value,
        coulomb_friction_n=sliding_n,
        static_friction_n=max(valve.static_friction_n, 1.01 * sliding_n),
    )
    breakaways = breakaways_of(stretches, limits, fitted, period_s)
    closed_m, open_m = (_stop(loop, side, limits, fitted) for side in (-1.0, 1.0))
    return Signature(
        spring,
        preload,
        sliding,
        _mean([each.static_n for each in breakaways], valve.static_friction_n),
        tuple(FrictionAt(float(x), float(f)) for x, f in zip(places_m, widths_n, strict=True)),
        breakaways,
        dynamic_error_band_m=_error_band_m(slow),
        rate_ma_per_s=rate,
        slow_ma_per_s=slow[0].rate_ma_per_s,
        speed_m_per_s=speed,
        reached_m=(
            min(float(each.position_m.min()) for each in loop),
            max(float(each.position_m.max()) for each in loop),
        ),
        closed_m=closed_m,
        open_m=open_m,
        seat_load_n=_seat_load_n(loop, closed_m, fitted),
        strokes=loop,
    )


def _bins(loop: Sequence[Branch], width_m: float) -> tuple[Array, Array, Array]:
    """Return the numbers of the bins over which the stem slid both ways, and the pressure up and down at their middles.

    The pressures are moved to the middle of the bin along the slope that both branches have together.
    """
    sides = []
    for direction in (1.0, -1.0):
        found = [each for each in loop if each.direction == direction]
        x = np.concatenate([each.position_m[each.slides] for each in found]) if found else np.empty(0)
        p = np.concatenate([each.static_ma[each.slides] for each in found]) if found else np.empty(0)
        sides.append((x, p, np.floor(x / width_m).astype(int)))
    slope = _common_slope(sides)
    common = sorted(set(_full(sides[0][2])) & set(_full(sides[1][2])))
    means = []
    for x, p, numbers in sides:
        moved = p - slope * (x - (numbers + 0.5) * width_m)
        means.append(np.array([float(np.mean(moved[numbers == number])) for number in common]))
    return np.array(common), means[0], means[1]


def _full(numbers: NDArray[np.int64]) -> list[int]:
    """Return the bins through which the stem slid, and did not jump."""
    values, counts = np.unique(numbers, return_counts=True)
    usual = float(np.median(counts)) if len(counts) else 0.0
    return [int(value) for value in values[counts >= max(_FEWEST_IN_BIN, _LEAST_OF_USUAL * usual)]]


def _common_slope(sides: Sequence[tuple[Array, Array, NDArray[np.int64]]]) -> float:
    """Return the slope in mA/m of two parallel lines through the points of both sides."""
    above = sum(float(np.sum((x - x.mean()) * (p - p.mean()))) for x, p, _ in sides if len(x))
    below = sum(float(np.sum((x - x.mean()) ** 2)) for x, _, _ in sides if len(x))
    return above / below if below else 0.0


def _line(x: Array, force_n: Array) -> tuple[Interval, Interval]:
    """Return slope and value at 0 of a line, each with its 95 % interval."""
    matrix = np.column_stack([x, np.ones_like(x)])
    (slope, start), *_ = np.linalg.lstsq(matrix, force_n, rcond=None)
    left = force_n - matrix @ np.array([slope, start])
    variance = float(left @ left) / max(len(x) - 2, 1)
    sigmas = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) * variance)
    found = [
        Interval(float(v), float(v - _Z * s), float(v + _Z * s)) for v, s in zip((slope, start), sigmas, strict=True)
    ]
    return found[0], found[1]


def _mean(values: Sequence[float], believed: float) -> Interval:
    """Return the mean with its 95 % interval; the believed value where there is none."""
    if not values:
        return Interval(believed, believed, believed, seen=False)
    mean = float(np.mean(values))
    error = _Z * float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else math.inf
    return Interval(mean, mean - error, mean + error)


def _error_band_m(loop: Sequence[Branch]) -> float:
    """Return the largest difference in m of the branches at one current, over those that both have, NaN without any."""
    largest_m = math.nan
    ups, downs = ([each for each in loop if each.direction == side] for side in (1.0, -1.0))
    for up, down in zip(ups, downs, strict=False):
        low, high = max(up.current_ma.min(), down.current_ma.min()), min(up.current_ma.max(), down.current_ma.max())
        at = np.linspace(low, high, _BAND_POINTS)
        rising = np.interp(at, up.current_ma, up.position_m)
        falling = np.interp(at, down.current_ma[::-1], down.position_m[::-1])
        largest_m = float(np.fmax(largest_m, np.max(falling - rising)))
    return largest_m


def _stop(loop: Sequence[Branch], direction: float, limits: ProcedureLimits, fitted: ValveParameters) -> float:
    """Return the place in m of the stop that the strokes in `direction` met, NaN without one.

    A stem that no stop holds slides to where friction alone holds the spring, or sticks (F_s - F_c)/K before.
    """
    spring = fitted.spring_rate_n_per_m
    most_m = (fitted.static_friction_n - fitted.coulomb_friction_n) / spring + _STOP_OF_SPAN * limits.span_m
    met = []
    for each in loop:
        free_n = fitted.force_gain_n_per_ma * each.end_ma - fitted.bench_set_n - direction * fitted.coulomb_friction_n
        if each.direction == direction and direction * (free_n / spring - each.end_m) > most_m:
            met.append(each.end_m)
    return float(np.mean(met)) if met else math.nan


def _seat_load_n(loop: Sequence[Branch], closed_m: float, fitted: ValveParameters) -> float:
    """Return the spring's force at the closed stop less that of the pressure, in N; NaN where none met that stop."""
    if math.isnan(closed_m):
        return math.nan
    end_ma = float(np.mean([each.end_ma for each in loop if each.direction < 0.0]))
    return max(fitted.bench_set_n + fitted.spring_rate_n_per_m * closed_m - fitted.force_gain_n_per_ma * end_ma, 0.0)
