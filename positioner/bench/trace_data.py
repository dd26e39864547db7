"""The data of the pictures, from a recording and the daemon's trace. Shell."""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING

import numpy as np
from pydantic import TypeAdapter

from positioner.bench.moves import Breakaway, MovesData, telling, windows
from positioner.bench.moves_picture import MOST_MOVES
from positioner.bench.predicted import Begins, believed
from positioner.bench.reasons import reasons
from positioner.bench.trend import TrendData
from positioner.laws.move_reason import current_in
from positioner.valve.stiction import LearnedSample, Quantity, StictionTable

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from positioner.bench.recording import Recording
    from positioner.bench.result import Result
    from positioner.config.schema import Configuration

_TOLERANCE = 1e-9
_TRACED = (
    *("current_low_ma", "current_high_ma", "speed_low_m_per_s", "speed_high_m_per_s", "velocity_m_per_s"),
    *("position_m", "stuck"),
)
_SAMPLES = TypeAdapter(tuple[LearnedSample, ...])


def picture_data(
    result: Result, recording: Recording, trace: Path, configuration: Configuration, table: StictionTable
) -> tuple[TrendData, MovesData]:
    """Return the data of the pictures: signals from the bus, estimates and bounds of the law from the trace.

    table: with which the run began.
    """
    scenario = result.scenario
    time_s = recording.time_s
    with trace.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    cycle_s = np.array([float(row["time_s"]) - recording.period_s for row in rows])
    begun_ma = [current_in(row["reason"]) for row in rows]
    traced = {name: [float(row[name]) for row in rows] for name in _TRACED}
    columns = {name: _at(time_s, cycle_s, values) for name, values in traced.items()}
    samples = [
        (float(learned_s), _SAMPLES.validate_json(row["learned"]))
        for learned_s, row in zip(cycle_s, rows, strict=True)
        if row["learned"]
    ]
    learned = {
        quantity: np.array([t for t, some in samples if quantity in {sample.quantity for sample in some}])
        for quantity in Quantity
    }
    loop_low = min(traced["current_low_ma"], default=math.nan)
    loop_high = max(traced["current_high_ma"], default=math.nan)
    widest = max(traced["speed_high_m_per_s"], default=math.nan)
    trend = TrendData(
        scenario=scenario,
        span_m=result.span_mm * 1e-3,
        dwells=result.dwells,
        totals=result.totals,
        time_s=time_s,
        modes=result.modes,
        position_m=recording.true_position_m,
        measured_m=recording.measured_m,
        setpoint_m=recording.setpoint_m,
        current_ma=recording.current_ma,
        current_lower_ma=_active(columns["current_low_ma"], loop_low),
        current_upper_ma=_active(columns["current_high_ma"], loop_high),
        velocity_m_per_s=recording.true_velocity_m_per_s,
        velocity_estimate_m_per_s=columns["velocity_m_per_s"],
        velocity_lower_m_per_s=_active(columns["speed_low_m_per_s"], -widest),
        velocity_upper_m_per_s=_active(columns["speed_high_m_per_s"], widest),
        learned_s=learned,
        why=reasons(cycle_s, [each is not None for each in begun_ma], [row["fallback"] for row in rows]),
    )
    every = windows(trend.position_m, trend.span_m, recording.period_s)
    shown = telling(every, trend.span_m, MOST_MOVES)
    slides, estimate = columns["stuck"] == 0.0, (columns["position_m"], columns["velocity_m_per_s"])
    moves = np.zeros(len(time_s), dtype=bool)
    moves[np.searchsorted(time_s[:-1], trend.why.moved_s - _TOLERANCE)] = True
    begins, predicted = Begins.of(slides, moves), []
    for window in shown:
        known = believed(configuration, _table_at(table, samples, float(time_s[window.begin])))
        path_m = known.path_m(estimate, begins, trend.current_ma, window.first, window.last)
        predicted.append(path_m)
    breakaways = [
        Breakaway(float(begun_s), current_ma)
        for begun_s, current_ma in zip(cycle_s, begun_ma, strict=True)
        if current_ma is not None
    ]
    shown_moves = MovesData(
        trend=trend,
        shown=shown,
        count=len(every),
        predicted=tuple(predicted),
        breakaways=tuple(breakaways),
    )
    return trend, shown_moves


def _table_at(
    table: StictionTable, samples: Sequence[tuple[float, tuple[LearnedSample, ...]]], time_s: float
) -> StictionTable:
    """Return the table at an instant: that of the start with all samples until then."""
    for learned_s, some in samples:
        if learned_s > time_s + _TOLERANCE:
            break
        for sample in some:
            table = table.learned(sample)
    return table


def _at(time_s: NDArray[np.float64], known_s: NDArray[np.float64], values: list[float]) -> NDArray[np.float64]:
    """Return at each sample of `time_s` the last of `values`, which are known from the instants `known_s` on."""
    if not values:
        return np.full_like(time_s, np.nan)
    index = np.searchsorted(known_s, time_s + 1e-9, side="right") - 1
    return np.where(index >= 0, np.array(values)[np.maximum(index, 0)], np.nan)


def _active(bound: NDArray[np.float64], free: float) -> NDArray[np.float64] | None:
    """Return the bound where it is tighter than `free`, NaN elsewhere; None if it never is."""
    active = np.where(np.isclose(bound, free, rtol=0.0, atol=_TOLERANCE), np.nan, bound)
    return active if np.isfinite(active).any() else None
