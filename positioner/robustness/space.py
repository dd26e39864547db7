"""The declared space of the robustness test: what is drawn, and between which limits. Shell: reads a file.

`space.toml` beside this file is the space; each value of it is a key of the classes here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Annotated

from annotated_types import Interval, Len

from positioner.campaign.schema import Scale
from positioner.inputs import toml_reader
from positioner.inputs.table import SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class Factor(SettingsTable):
    """One range.

    low, high: its ends. scale: how it is divided. present: the part of the valves that have it. unit: of its values.
    """

    low: float
    high: float
    scale: Scale = Scale.LINEAR
    present: Annotated[float, Interval(gt=0.0, le=1.0)] = 1.0
    unit: str = ""

    def __post_init__(self) -> None:
        """Check the ends.

        Raises:
            ValueError: they do not make a range.
        """
        if self.low >= self.high:
            raise ValueError("low must be below high")
        if self.scale is Scale.LOGARITHMIC and self.low <= 0.0:
            raise ValueError("low must be above 0 on a logarithmic scale")

    def at(self, place: float) -> float:
        """Return the value at a `place` from 0 (`low`) to 1 (`high`)."""
        if self.scale is Scale.LOGARITHMIC:
            return self.low * math.pow(self.high / self.low, place)
        return self.low + place * (self.high - self.low)


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellSettings(SettingsTable):
    """The `[dwell]` table: steps as parts of the span, durations in units of the time-optimal move.

    small, large: the sizes of steps. small_share: how many of them are small. optimal_moves: the duration of a dwell.
    least_s: the shortest one.
    """

    small: Factor
    large: Factor
    small_share: Annotated[float, Interval(ge=0.0, le=1.0)]
    optimal_moves: Factor
    least_s: Annotated[float, Interval(gt=0.0)]


Factors = Annotated[dict[str, Factor], Len(1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Space(SettingsTable):
    """The whole space; the tables are explained in its file.

    dwells: setpoints of one valve. valves: of each class. beyond: of the class of setpoints beyond reach.
    """

    dwells: Annotated[int, Interval(ge=1, le=10_000)]
    valves: Annotated[int, Interval(ge=1, le=1 << 16)]
    beyond: Annotated[int, Interval(ge=1, le=1 << 16)]
    dwell: DwellSettings
    valve: Factors
    configurable: Factors
    unmodelled: Factors
    mistakes: Factors

    def factor(self, name: str) -> Factor | None:
        """Return the factor of that name, None where it is a ratio of configured to true or no factor."""
        return next((table[name] for table in (self.valve, self.configurable, self.unmodelled) if name in table), None)


@cache
def packaged_space() -> Space:
    """Return the space that this package declares."""
    text = resources.files(__package__).joinpath("space.toml").read_text(encoding="utf-8")
    return toml_reader.parse(text, Space, "space.toml")
