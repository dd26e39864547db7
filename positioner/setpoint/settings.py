"""The `[setpoint]` table of a configuration: the setpoint functions, all off by default. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable

LEAST_RANGE = 0.25
"""The smallest part of the signal that may stroke a valve."""
_MOST_POINTS = 21


class Action(StrEnum):
    """Which way the travel follows the signal."""

    DIRECT = "direct"
    """A rising signal opens."""
    REVERSE = "reverse"
    """A rising signal closes."""


class Characteristic(StrEnum):
    """The shape of travel over signal."""

    LINEAR = "linear"
    EQUAL_PERCENTAGE = "equal percentage"
    INVERSE_EQUAL_PERCENTAGE = "inverse equal percentage"
    QUICK_OPENING = "quick opening"
    POINTS = "points"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetpointSettings(SettingsTable):
    """The setpoint functions. Signal and travel are parts of the span: 0 at `valve.travel_min_m`, 1 one span above it.

    signal_low, signal_high: split range, the part of the signal that strokes this valve.
    action: the direction of action; "reverse": a rising signal closes.
    characteristic: travel over signal: "linear", "equal percentage", "inverse equal percentage", "quick opening" or
        "points".
    rangeability: R of the equal percentages.
    points: (signal, travel) of a characteristic of the user's own, from (0, 0) to (1, 1), both rising.
    filter_s: time constant of the travel.
    opening_per_s, closing_per_s: the largest rates of the travel, in spans a second; 0 is none.
    travel_low, travel_high: limits of the travel.
    closed_below, open_above: tight shut-off; at or beyond this travel the full current closes or opens the valve. 0 and
        1 are none.
    hysteresis: how far the travel must come back until the shut-off ends.
    """

    signal_low: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0
    signal_high: Annotated[float, Interval(ge=0.0, le=1.0)] = 1.0
    action: Action = Action.DIRECT
    characteristic: Characteristic = Characteristic.LINEAR
    rangeability: Annotated[float, Interval(ge=2.0, le=200.0)] = 50.0
    points: tuple[tuple[float, float], ...] = ()
    filter_s: Annotated[float, Interval(ge=0.0, le=3600.0)] = 0.0
    opening_per_s: Annotated[float, Interval(ge=0.0, le=1e3)] = 0.0
    closing_per_s: Annotated[float, Interval(ge=0.0, le=1e3)] = 0.0
    travel_low: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0
    travel_high: Annotated[float, Interval(ge=0.0, le=1.0)] = 1.0
    closed_below: Annotated[float, Interval(ge=0.0, le=0.5)] = 0.0
    open_above: Annotated[float, Interval(ge=0.5, le=1.0)] = 1.0
    hysteresis: Annotated[float, Interval(ge=0.001, le=0.1)] = 0.005

    def __post_init__(self) -> None:
        """Refuse combinations that the limits of the single keys allow."""
        if self.signal_high - self.signal_low < LEAST_RANGE:
            raise ValueError(f"signal_high must exceed signal_low by {LEAST_RANGE:g} at least")
        if self.travel_low >= self.travel_high:
            raise ValueError("travel_low must be below travel_high")
        if (self.characteristic is Characteristic.POINTS) != bool(self.points):
            raise ValueError('points belong to characteristic = "points", and to no other')
        if self.points and not _is_rising(self.points):
            raise ValueError(f"points must be 2 to {_MOST_POINTS}, from [0, 0] to [1, 1], and both numbers must rise")

    @property
    def shapes(self) -> bool:
        """Whether any function is on."""
        return self != SetpointSettings(rangeability=self.rangeability, hysteresis=self.hysteresis)

    def in_words(self) -> str:
        """Return the functions that are on, in the order in which they act, in one line."""
        return ", ".join(self._words()) or "as the host sends it"

    def _words(self) -> list[str]:
        words = []
        if (self.signal_low, self.signal_high) != (0.0, 1.0):
            words.append(f"split range {self.signal_low:.4g} to {self.signal_high:.4g} of the signal")
        if self.action is Action.REVERSE:
            words.append("reverse action")
        if self.characteristic is not Characteristic.LINEAR:
            own = {Characteristic.POINTS: f" ({len(self.points)})", Characteristic.QUICK_OPENING: ""}
            words.append(f"{self.characteristic}{own.get(self.characteristic, f' (R = {self.rangeability:g})')}")
        rates = (
            ("filter", self.filter_s, "s"),
            ("opening at most", 100.0 * self.opening_per_s, "%/s"),
            ("closing at most", 100.0 * self.closing_per_s, "%/s"),
        )
        words += [f"{name} {value:.4g} {unit}" for name, value, unit in rates if value]
        if (self.travel_low, self.travel_high) != (0.0, 1.0):
            words.append(f"travel {100.0 * self.travel_low:.4g} to {100.0 * self.travel_high:.4g} %")
        if self.closed_below > 0.0:
            words.append(f"tight shut-off at {100.0 * self.closed_below:.4g} %")
        if self.open_above < 1.0:
            words.append(f"fully open from {100.0 * self.open_above:.4g} %")
        return words


def _is_rising(points: tuple[tuple[float, float], ...]) -> bool:
    if len(points) > _MOST_POINTS or points[0] != (0.0, 0.0) or points[-1] != (1.0, 1.0):
        return False
    return all(after[0] > before[0] and after[1] > before[1] for before, after in pairwise(points))
