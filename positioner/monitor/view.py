"""What a view shows of one valve, as numbers and words. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace

MESSAGES = {
    "StemPosition": "positions",
    "CurrentCommand": "commands",
    "Setpoint": "setpoints",
    "PositionerStatus": "status",
}
"""The messages whose rates are shown, by their classes, and how they are called."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What the listener itself has counted on the bus.

    lost: frames missing by their counters; late: readings after more than two sample periods; damaged: frames with a
    wrong CRC, length or value, readings that cannot be true; disordered: repeated or out of order.
    """

    lost: int = 0
    late: int = 0
    damaged: int = 0
    disordered: int = 0

    def plus(self, *, lost: int = 0, late: int = 0, damaged: int = 0, disordered: int = 0) -> Seen:
        """Return the counts after so many more."""
        return replace(
            self,
            lost=self.lost + lost,
            late=self.late + late,
            damaged=self.damaged + damaged,
            disordered=self.disordered + disordered,
        )


@dataclass(frozen=True, slots=True)
class View:
    """One valve at one instant; None for what does not come.

    late_s: readings that are farther apart leave a gap in the trend. state: mode, cause and NE 107 signal in words, or
    why there is none. counters: those of the status and of the causes that the positioner counts, with their names.
    rates: messages in a second.
    """

    valve_id: str
    span_m: float
    time_s: float
    late_s: float
    position_m: float | None
    quality: str | None
    setpoint_m: float | None
    current_ma: float | None
    pressure_pa: float | None
    motion: str | None
    mode: str | None
    cause: str | None
    state: str
    health: str | None
    armed: bool | None
    table_saved: bool | None
    alarms: str
    counters: tuple[tuple[str, int], ...] | None
    rates: tuple[tuple[str, float], ...]
    seen: Seen

    @property
    def error_m(self) -> float | None:
        """Position less setpoint in m; None where one of them does not come, and in manual mode."""
        if self.position_m is None or self.setpoint_m is None or self.mode == "MANUAL":
            return None
        return self.position_m - self.setpoint_m
