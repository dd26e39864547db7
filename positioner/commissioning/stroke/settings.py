"""The `[stroke_test]` table of a configuration: the stroke, and what ends or fails a partial stroke test. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable


class Direction(StrEnum):
    """Which way the test strokes the valve."""

    CLOSING = "closing"
    OPENING = "opening"


@dataclass(frozen=True, slots=True, kw_only=True)
class StrokeSettings(SettingsTable):
    """The partial stroke test.

    direction: which way the stem goes from where it is: "closing" or "opening".
    stroke_of_span: how far it goes.
    approach: where the current cannot do the stroke from where the stem stands, first move it to a place from which it
        can; false refuses such a test.
    tolerance_of_span: how far the stem may be from its course, and beyond the stroke.
    rate_ma_per_s: rate of the ramp that frees the stem.
    pause_s: for how long the stem stays at the end of the stroke.
    stuck_of_reference: the stem is stuck where this part of the configured static friction does not free it.
    breakaway_high, breakaway_low: the valve fails where its static friction is beyond these parts of the configured
        one.
    breakaway_s, total_s: the longest time without motion, and of the test until the stem is back.
    slow_s: the valve fails where it follows the current later than its configured lags explain by more than this.
    demand_of_span: a setpoint that differs by more than this from the one at the start ends the test.
    """

    direction: Direction = Direction.CLOSING
    stroke_of_span: Annotated[float, Interval(ge=0.01, le=0.5)] = 0.1
    approach: bool = True
    tolerance_of_span: Annotated[float, Interval(ge=0.005, le=0.5)] = 0.05
    rate_ma_per_s: Annotated[float, Interval(ge=0.05, le=20.0)] = 1.0
    pause_s: Annotated[float, Interval(ge=0.5, le=600.0)] = 2.0
    stuck_of_reference: Annotated[float, Interval(ge=1.05, le=5.0)] = 1.3
    breakaway_high: Annotated[float, Interval(ge=1.01, le=5.0)] = 1.2
    breakaway_low: Annotated[float, Interval(ge=0.0, le=0.99)] = 0.7
    breakaway_s: Annotated[float, Interval(ge=1.0, le=600.0)] = 30.0
    total_s: Annotated[float, Interval(ge=5.0, le=3600.0)] = 120.0
    slow_s: Annotated[float, Interval(ge=0.01, le=60.0)] = 0.25
    demand_of_span: Annotated[float, Interval(ge=0.001, le=0.2)] = 0.005

    def __post_init__(self) -> None:
        """Refuse limits in the wrong order."""
        if self.breakaway_high > self.stuck_of_reference:
            raise ValueError("breakaway_high must not exceed stuck_of_reference: the test ends there")
        if self.total_s <= self.breakaway_s:
            raise ValueError("total_s must exceed breakaway_s")

    def as_json(self) -> dict[str, str | float | bool]:
        """Return the settings for a program."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}
