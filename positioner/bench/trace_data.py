"""The data of the picture, from a recording and the daemon's trace. Shell."""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING

import numpy as np

from positioner.bench.reasons import reasons
from positioner.bench.trend import TrendData
from positioner.laws.move_reason import source_in
from positioner.valve.stiction import Quantity

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from positioner.bench.recording import Recording
    from positioner.bench.result import Result

_TOLERANCE = 1e-9
_BOUNDS = ("current_low_ma", "current_high_ma", "speed_low_m_per_s", "speed_high_m_per_s", "velocity_m_per_s")


def trend_data(result: Result, recording: Recording, trace: Path) -> TrendData:
    """Return the data of the picture: signals from the bus, estimates and bounds of the law from the trace."""
    scenario = result.scenario
    time_s = recording.time_s
    with trace.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    cycle_s = np.array([float(row["time_s"]) - recording.period_s for row in rows])
    traced = {name: [float(row[name]) for row in rows] for name in _BOUNDS}
    columns = {name: _at(time_s, cycle_s, values) for name, values in traced.items()}
    learned = {
        quantity: np.array([t for t, row in zip(cycle_s, rows, strict=True) if quantity in row["learned"].split("+")])
        for quantity in Quantity
    }
    loop_low = min(traced["current_low_ma"], default=math.nan)
    loop_high = max(traced["current_high_ma"], default=math.nan)
    widest = max(traced["speed_high_m_per_s"], default=math.nan)
    return TrendData(
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
        why=reasons(cycle_s, [source_in(row["reason"]) for row in rows], [row["fallback"] for row in rows]),
    )


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
