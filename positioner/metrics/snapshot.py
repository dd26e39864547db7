"""What a daemon tells of one valve, as plain values that `json` takes. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.cycle.alarms import message_of
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.cycle.state import CycleState
    from positioner.health.monitor import HealthState
    from positioner.shadow.differences import Differences
    from positioner.valve.parameters import ValveParameters

MOST_BYTES = 1 << 20
"""Of all snapshots of one hand-over, as JSON: a valve takes one or two kilobytes."""
_S_PER_US = 1e-6
_KEPT = (
    *("observed", "starts", "slips", "sticks", "moves", "failed_pushes", "reversals", "cycles"),
    *("travel_m",),
)
"""Counters of the valve's health that are told as they are."""


def snapshot_of(
    valve: ValveParameters,
    state: CycleState,
    health: HealthState | None,
    unix_s: float,
    shadow: Differences | None = None,
) -> dict[str, Any]:
    """Return the state after a cycle at the wall-clock instant `unix_s`; None for what is not known.

    shadow: all that a law in the shadow was compared in, None without one.
    """
    guard, link, counters, alarms = state.guard, state.link, state.counters, message_of(state.alarms)
    return {
        "valve": valve.id,
        "updated_s": unix_s,
        "span_m": valve.span_m,
        "position_m": link.feedback.readings.position_m,
        "setpoint_m": link.setpoint.position_m,
        "current_ma": state.output.last_ma,
        "pressure_pa": link.pressure_pa,
        "period_s": link.feedback.frame_period.measured_s,
        "mode": int(guard.mode),
        "cause": int(guard.cause),
        "health": max(int(guard.health(table_saved=state.table_saved)), int(alarms.worst)),
        "armed": guard.arming.armed,
        "table_saved": state.table_saved,
        "alarms": alarms.active,
        "refused": counters.refused_frames,
        "fallbacks": counters.fallbacks,
        "learned": counters.learned,
        "events": {int(cause): count for cause, count in counters.by_cause.items()},
        "table_cells": len(state.table),
        "kept": None if health is None else _kept(health),
        "shadow": None if shadow is None else _compared(shadow),
    }


def _compared(shadow: Differences) -> dict[str, Any]:
    """Return where a law in the shadow has differed from the acting one, since the start."""
    return {
        "cycles": shadow.cycles,
        "apart": shadow.apart,
        "mean_ma": shadow.mean_ma,
        "largest_ma": shadow.largest_ma,
        "moves": {"acting": shadow.moves, "shadow": shadow.shadow_moves},
    }


def _kept(health: HealthState) -> dict[str, Any]:
    """Return the counters that outlive the daemon."""
    counters = health.counting.so_far
    kept: dict[str, Any] = {name: getattr(counters, name) for name in _KEPT}
    kept["mode_s"] = {int(mode): counters.mode_us[mode] * _S_PER_US for mode in Mode}
    kept["stuck_s"] = counters.stuck_us * _S_PER_US
    return kept
