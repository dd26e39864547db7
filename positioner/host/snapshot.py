"""The status of a valve at one instant, in lines for a person and as values for a program. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from positioner.host.words import (
    ALARMS,
    alarms_in_words,
    counters_in_words,
    in_mm,
    named_counters,
    state_in_words,
    status_counts,
)
from positioner.wire.messages import Mode, Quality

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.wire.messages import Counted, PositionerAlarms, PositionerStatus


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What is known at an instant; None for what does not come, or has no meaning now."""

    valve: str
    span_m: float
    status: PositionerStatus | None
    position_m: float | None
    quality: Quality
    setpoint_m: float | None
    current_ma: float | None
    alarms: PositionerAlarms | None
    counts: Mapping[Counted, int]

    @property
    def error_m(self) -> float | None:
        """Position less setpoint, in m; None in manual mode, which pursues no setpoint."""
        by_hand = self.status is not None and self.status.mode is Mode.MANUAL
        return (
            None if self.position_m is None or self.setpoint_m is None or by_hand else self.position_m - self.setpoint_m
        )

    def lines(self, status: PositionerStatus) -> list[str]:
        """Return a line for each quantity, of a positioner that sends its `status`."""
        here_m, asked_m, error_m = self.position_m, self.setpoint_m, self.error_m
        doubt = f", quality {self.quality.name}" if self.quality is not Quality.VALID else ""
        rows = (
            ("mode", state_in_words(status)),
            ("armed", "yes" if status.armed else "no"),
            ("table", "saved" if status.table_saved else "not saved: see the positioner's log"),
            ("position", "no position frames come" if here_m is None else in_mm(here_m, self.span_m) + doubt),
            ("setpoint", "no host sends one" if asked_m is None else in_mm(asked_m, self.span_m)),
            ("error", "-" if error_m is None else in_mm(error_m, self.span_m)),
            ("current", "no commands come" if self.current_ma is None else f"{self.current_ma:.3f} mA"),
            ("alarms", alarms_in_words(self.alarms)),
            ("counters", counters_in_words(named_counters(status_counts(status), self.counts))),
        )
        return [f"{name:<9} {value}" for name, value in rows]

    def as_json(self, status: PositionerStatus) -> dict[str, Any]:
        """Return the same for a program, in SI units; the counters of the status count modulo 256."""
        alarms = self.alarms
        return {
            "valve": self.valve,
            "mode": status.mode.name,
            "cause": status.cause.name,
            "health": status.health.name,
            "armed": status.armed,
            "table_saved": status.table_saved,
            "position_m": self.position_m,
            "position_quality": self.quality.name,
            "setpoint_m": self.setpoint_m,
            "error_m": self.error_m,
            "current_ma": self.current_ma,
            "alarms": [] if alarms is None else [name for bit, name in enumerate(ALARMS) if alarms.active >> bit & 1],
            "learned": status.learned_count,
            "refused": status.rejected_count,
            "fallbacks": status.fallback_count,
            "counts": {kind.name.lower(): count for kind, count in sorted(self.counts.items())},
        }
