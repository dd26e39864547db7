"""Figures of a run, dwell by dwell, from the true motion of the stem. Pure.

Every percentage is of the valve's span and not of the step: small steps then do not inflate it, and the figures of
different setpoints can be compared. Position is the plant's true one: errors of the sensor are not the law's.

| figure | definition | source |
|---|---|---|
| error | mean and largest absolute error over the end of the dwell | ours |
| settling | from the new setpoint until the error stays in the band to the end of the dwell | IEC 60050-351 |
| overshoot | farthest past the setpoint, away from where the dwell began | ISA-75.25.01, there in percent of the step |
| IAE | integral of the absolute error | Åström and Hägglund, Advanced PID Control |
| reversals | turning points of the motion, with hysteresis | ours; the first step of rainflow counting |
| command variation | sum of the absolute changes of the current | Skogestad (2003), total variation |
| limit cycle | range and reversals late in the dwell, both above a threshold | ours |

Where the setpoint moves within a part of the run, the error is the distance from the moving setpoint, over all of that
part; the shortest way is the setpoint's own; a limit cycle is not looked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from statistics import fmean, median
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray


ERROR_WINDOW_S = 0.5
"""The error is taken over this last part of a dwell, or over its second half if that is shorter."""

REVERSAL_THRESHOLD_M = 1e-6
"""Motion back from a turning point that counts as a reversal: 100 steps of the PLANT_TRUTH frame, so that its rounding
has no effect, and about a thousandth of the 1 % band."""

LIMIT_CYCLE_PART = 0.6
"""The last part of a dwell, as a fraction, in which a limit cycle is searched."""

LIMIT_CYCLE_RANGE_PCT = 0.2
"""Range of motion in percent of span above which the motion may be a limit cycle."""

LIMIT_CYCLE_REVERSALS = 2
"""Fewest reversals of a limit cycle: one there and one back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A run as recorded, one sample per plant period; all arrays have shape (n,)."""

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    """True stem position, x of the paper."""
    setpoint_m: NDArray[np.float64]
    current_ma: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellMetrics:
    """Figures of one dwell."""

    setpoint_mm: float
    mean_abs_error_pct: float
    max_abs_error_pct: float
    settle_1pct_s: float | None
    """None: it never settled."""
    settle_2pct_s: float | None
    overshoot_pct: float
    reversals: int
    limit_cycle: bool
    travel_mm: float
    """Length of the path."""
    ideal_travel_mm: float
    """Distance from where the dwell began to its setpoint."""
    iae_mm_s: float
    command_variation_ma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Totals:
    """Figures of all dwells together."""

    dwells: int
    mean_abs_error_pct: float
    """Mean of the dwells' mean errors."""
    worst_mean_abs_error_pct: float
    """Largest of the dwells' mean errors."""
    max_abs_error_pct: float
    median_settle_1pct_s: float | None
    """A dwell that never settles counts as later than all others; None if the median is such a dwell."""
    median_settle_2pct_s: float | None
    unsettled_1pct: int
    unsettled_2pct: int
    overshoot_pct: float
    """Largest of all dwells."""
    limit_cycles: int
    reversals: int
    travel_mm: float
    ideal_travel_mm: float
    travel_ratio: float | None
    """Travel over ideal travel, 1 at best; None if no dwell asks for a move."""
    iae_mm_s: float
    command_variation_ma: float


def dwell_metrics(trace: Trace, dwell_edges_s: Sequence[float], span_m: float) -> tuple[DwellMetrics, ...]:
    """Return the figures of every dwell of `trace`.

    Args:
        trace: the run; its times may have gaps.
        dwell_edges_s: where dwells begin and, last, where the run ends, shape (dwells + 1).
        span_m: length of 100 %.

    Raises:
        ValueError: a dwell has no samples.
    """
    # half a sample early: an edge computed as n * dwell_s may lie a rounding error after its sample
    half_sample_s = float(np.median(np.diff(trace.time_s))) / 2.0
    cuts = np.searchsorted(trace.time_s, np.asarray(dwell_edges_s) - half_sample_s)
    return tuple(
        _of_dwell(trace, slice(int(begin), int(end)), begin_s, end_s, span_m)
        for begin, end, begin_s, end_s in zip(cuts, cuts[1:], dwell_edges_s, dwell_edges_s[1:], strict=False)
    )


def totals(dwells: Sequence[DwellMetrics]) -> Totals:
    """Return the figures of all `dwells` together.

    Raises:
        ValueError: there are none.
    """
    if not dwells:
        raise ValueError("no dwells to sum up")
    travel_mm = sum(dwell.travel_mm for dwell in dwells)
    ideal_travel_mm = sum(dwell.ideal_travel_mm for dwell in dwells)
    return Totals(
        dwells=len(dwells),
        mean_abs_error_pct=fmean(dwell.mean_abs_error_pct for dwell in dwells),
        worst_mean_abs_error_pct=max(dwell.mean_abs_error_pct for dwell in dwells),
        max_abs_error_pct=max(dwell.max_abs_error_pct for dwell in dwells),
        median_settle_1pct_s=median_settling_s(dwell.settle_1pct_s for dwell in dwells),
        median_settle_2pct_s=median_settling_s(dwell.settle_2pct_s for dwell in dwells),
        unsettled_1pct=sum(dwell.settle_1pct_s is None for dwell in dwells),
        unsettled_2pct=sum(dwell.settle_2pct_s is None for dwell in dwells),
        overshoot_pct=max(dwell.overshoot_pct for dwell in dwells),
        limit_cycles=sum(dwell.limit_cycle for dwell in dwells),
        reversals=sum(dwell.reversals for dwell in dwells),
        travel_mm=travel_mm,
        ideal_travel_mm=ideal_travel_mm,
        travel_ratio=travel_mm / ideal_travel_mm if ideal_travel_mm > 0.0 else None,
        iae_mm_s=sum(dwell.iae_mm_s for dwell in dwells),
        command_variation_ma=sum(dwell.command_variation_ma for dwell in dwells),
    )


def median_settling_s(settlings_s: Iterable[float | None]) -> float | None:
    """Return the median settling time in s; a dwell that never settles, None, counts as later than all others."""
    middle_s = median(inf if settling_s is None else settling_s for settling_s in settlings_s)
    return None if middle_s == inf else middle_s


def count_reversals(position_m: NDArray[np.float64], threshold_m: float = REVERSAL_THRESHOLD_M) -> int:
    """Return how often the motion turned back by more than `threshold_m`; `position_m` has shape (n,)."""
    reversals = 0
    direction = 0.0
    turning_point_m = float(position_m[0])
    for here_m in position_m.tolist():
        onward_m = here_m - turning_point_m
        if direction * onward_m > 0.0:
            turning_point_m = here_m
        elif abs(onward_m) > threshold_m:
            reversals += direction != 0.0
            direction = 1.0 if onward_m > 0.0 else -1.0
            turning_point_m = here_m
    return reversals


def _of_dwell(trace: Trace, part: slice, begin_s: float, end_s: float, span_m: float) -> DwellMetrics:
    if part.start >= part.stop:
        raise ValueError(f"no samples between {begin_s:.6g} and {end_s:.6g} s")
    time_s, position_m = trace.time_s[part], trace.position_m[part]
    setpoint_m = float(trace.setpoint_m[part.stop - 1])
    course_m = trace.setpoint_m[part]
    moves = bool(np.ptp(course_m) > 0.0)
    error_m = position_m - course_m if moves else position_m - setpoint_m
    pct = 100.0 / span_m

    # the last sample before the dwell belongs to its path: there the move and the jump of the current begin
    path = slice(max(part.start - 1, 0), part.stop)
    start_m = float(trace.position_m[path.start])
    towards = np.sign(setpoint_m - start_m)

    final = error_m if moves else error_m[_last(time_s, end_s, min(ERROR_WINDOW_S, (end_s - begin_s) / 2.0))]
    late_m = position_m[_last(time_s, end_s, LIMIT_CYCLE_PART * (end_s - begin_s))]
    cycles = (
        not moves and np.ptp(late_m) * pct > LIMIT_CYCLE_RANGE_PCT and count_reversals(late_m) >= LIMIT_CYCLE_REVERSALS
    )
    return DwellMetrics(
        setpoint_mm=setpoint_m * 1e3,
        mean_abs_error_pct=float(np.mean(np.abs(final))) * pct,
        max_abs_error_pct=float(np.max(np.abs(final))) * pct,
        settle_1pct_s=_settling_s(time_s - begin_s, error_m, 0.01 * span_m),
        settle_2pct_s=_settling_s(time_s - begin_s, error_m, 0.02 * span_m),
        overshoot_pct=max(0.0, float(np.max(towards * error_m))) * pct,
        reversals=count_reversals(trace.position_m[path]),
        limit_cycle=bool(cycles) and not moves,
        travel_mm=float(np.sum(np.abs(np.diff(trace.position_m[path])))) * 1e3,
        ideal_travel_mm=_shortest_m(start_m, course_m) * 1e3 if moves else abs(setpoint_m - start_m) * 1e3,
        iae_mm_s=float(np.sum(np.abs(error_m) * np.diff(time_s, append=end_s))) * 1e3,
        # a positioner that was not armed has commanded nothing
        command_variation_ma=float(np.nansum(np.abs(np.diff(trace.current_ma[path])))),
    )


def _shortest_m(start_m: float, course_m: NDArray[np.float64]) -> float:
    """Return the length of the way of a moving setpoint, from `start_m` on."""
    return abs(float(course_m[0]) - start_m) + float(np.sum(np.abs(np.diff(course_m))))


def _last(time_s: NDArray[np.float64], end_s: float, window_s: float) -> slice:
    """Return the samples of the last `window_s` before `end_s`, at least one."""
    first = int(np.searchsorted(time_s, end_s - window_s - 1e-9))
    return slice(min(first, len(time_s) - 1), None)


def _settling_s(elapsed_s: NDArray[np.float64], error_m: NDArray[np.float64], band_m: float) -> float | None:
    """Return the time in s from which the error stays within `band_m`, or None where it ends outside."""
    outside = np.flatnonzero(np.abs(error_m) > band_m)
    if outside.size == 0:
        return 0.0
    back = int(outside[-1]) + 1
    return float(elapsed_s[back]) if back < len(error_m) else None
