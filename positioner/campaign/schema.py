"""The file of a campaign: its tables, with the limits of their values. Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, Any, TypeAlias

from annotated_types import Interval, Len

from positioner.inputs.table import SettingsTable

Value: TypeAlias = float | int | bool | str
"""A value of a parameter, as TOML and Parquet know it."""


class Kind(StrEnum):
    """How the points of a campaign are chosen."""

    GRID = "grid"
    """Every combination of the levels."""
    LATIN_HYPERCUBE = "latin-hypercube"
    """One point in each of as many equal parts of every range (McKay, Beckman and Conover, 1979)."""
    SOBOL = "sobol"
    """A scrambled Sobol sequence (Owen, 1998): even in every projection; a longer one begins with a shorter one."""


class Scale(StrEnum):
    """How a range is divided."""

    LINEAR = "linear"
    LOGARITHMIC = "logarithmic"


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignSettings(SettingsTable):
    """The `[design]` table: how the points are chosen.

    kind: every combination of the levels, or points that fill the ranges evenly.
    points: how many; a power of two for "sobol"; left out for a grid, which has as many as its levels make.
    seed: of the choice of the points; the seeds of the noise stand beside the laws.
    """

    kind: Kind
    points: Annotated[int, Interval(ge=1, le=1 << 20)] | None = None
    seed: Annotated[int, Interval(ge=0, le=2**32 - 1)] = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeSettings(SettingsTable):
    """One parameter, as a range from `low` to `high` or a list of `values`; NAME is the key to set, or of your choice.

    low, high: the ends of the range; both belong to it.
    scale: how the range is divided.
    levels: how many values of the range a grid takes, both ends among them.
    values: the values in place of a range, of the kind of the key.
    scales: keys of the scenario whose own values are multiplied by the value; without it, NAME is the key to set.
    """

    low: float | None = None
    high: float | None = None
    scale: Scale = Scale.LINEAR
    levels: Annotated[int, Interval(ge=2, le=1000)] | None = None
    values: Annotated[tuple[Value, ...], Len(2, 1000)] | None = None
    scales: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the relations between keys.

        Raises:
            ValueError: neither a range nor a list, or a range that cannot be divided.
        """
        if self.values is not None:
            if self.low is not None or self.high is not None or self.levels is not None:
                raise ValueError("has values, so low, high and levels have no meaning")
            if len(set(map(repr, self.values))) < len(self.values):
                raise ValueError("has a value twice")
            return
        if self.low is None or self.high is None:
            raise ValueError("needs low and high, or values")
        if self.low >= self.high:
            raise ValueError("low must be below high")
        if self.scale is Scale.LOGARITHMIC and self.low <= 0.0:
            raise ValueError("low must be above 0 on a logarithmic scale")


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignFile(SettingsTable):
    """A campaign: every point of the design with every law and every seed.

    name: of the campaign and of its folder: letters, digits, dots, dashes, underscores.
    title: its heading.
    laws: the names of the laws, or FILE.py:NAME.
    scenario: the `[scenario]` table: `base`, a scenario by name or path, "paper-valve" if left out, and the keys of a
        scenario that replace its own. Law and seed stand in `laws` and `seeds`.
    seeds: of the noise; every law is played with the same ones at every point.
    worst: how many of the worst runs of each law are shown, with the command that replays each.
    """

    name: Annotated[str, Len(1, 24)]
    title: Annotated[str, Len(1, 80)]
    laws: Annotated[tuple[str, ...], Len(1)]
    seeds: Annotated[tuple[Annotated[int, Interval(ge=0, le=2**32 - 1)], ...], Len(1)]
    design: DesignSettings
    parameters: Annotated[dict[str, RangeSettings], Len(1, 100)]
    scenario: dict[str, Any] = field(default_factory=dict)
    worst: Annotated[int, Interval(ge=0, le=20)] = 3

    def __post_init__(self) -> None:
        """Check what no limit can say.

        Raises:
            ValueError: a name that cannot be that of a directory.
        """
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", self.name):
            raise ValueError(f"name '{self.name}' must be letters, digits, dots, dashes or underscores")
