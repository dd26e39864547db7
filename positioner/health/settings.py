"""The `[health]` table of a configuration. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Annotated

from annotated_types import Interval

from positioner.health.causes import LIMITS, AlarmCause, Limits
from positioner.health.stress import wear_of
from positioner.inputs.table import SettingsTable
from positioner.wire.messages import Health

_DAY_S = 86_400.0


class Category(StrEnum):
    """The status signals of NAMUR NE 107, by their names in a configuration."""

    MAINTENANCE_REQUIRED = "maintenance required"
    OUT_OF_SPECIFICATION = "out of specification"
    FUNCTION_CHECK = "function check"
    FAILURE = "failure"
    OFF = "off"
    """The cause is watched and shown, and no alarm."""

    @property
    def health(self) -> Health:
        """The status signal."""
        return Health.GOOD if self is Category.OFF else Health[self.name]


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmSettings(SettingsTable):
    """One cause, such as `[health.friction_high]`; what is not given is as usual for this cause.

    limit, serious_limit: as parts, 0.2 is 20 %; a serious limit of 0 is none.
    category, serious_category: what NAMUR NE 107 calls it beyond the limit, and beyond the serious one; "off" is no
        alarm.
    delay_s: the on-delay.
    clears_at: the part of the limit below which the alarm ends.
    """

    limit: Annotated[float, Interval(gt=0.0, le=100.0)] | None = None
    category: Category | None = None
    serious_limit: Annotated[float, Interval(ge=0.0, le=100.0)] | None = None
    serious_category: Category | None = None
    delay_s: Annotated[float, Interval(ge=0.0, le=1e6)] | None = None
    clears_at: Annotated[float, Interval(ge=0.1, le=1.0)] | None = None

    def over(self, usual: Limits) -> Limits:
        """Return the limits of a cause with these in place of the usual ones.

        Raises:
            ValueError: the serious limit is below the other.
        """
        first = usual.category if self.category is None else self.category.health
        second = usual.serious_category if self.serious_category is None else self.serious_category.health
        limit = usual.limit if self.limit is None else self.limit
        serious = usual.serious_limit if self.serious_limit is None else self.serious_limit
        if 0.0 < serious < limit:
            raise ValueError(f"serious_limit must not be below limit ({serious:g} < {limit:g}); 0 is none")
        delay_s = usual.delay_s if self.delay_s is None else self.delay_s
        clears_at = usual.clears_at if self.clears_at is None else self.clears_at
        return Limits(limit, first, serious, second, delay_s, clears_at)


_USUAL = AlarmSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthTable(SettingsTable):
    """The `[health]` table, with a table for each cause of an alarm.

    averaging: λ of the trends, the weight of the newest move.
    cycle_limit: cycles after which the packing is due.
    travel_limit: the same in spans of travel.
    stroke_test_days: the longest time between two stroke tests; 0 is none.
    cycle_dead_band: a reversal beyond this part of the span is a cycle; at least 4 sigma of a reading.
    travel_dead_band: the same of travel and of changes of direction.
    allowed_cycles: cycles that the packing bears, by their spans as parts of the travel: [[0.1, 1e6], [1.0, 1e5]];
        then the spent part of its life counts for the alarm `cycles`.
    friction_high, friction_low: friction against the reference; 0.2 is 20 % above it, and below it.
    slip_jump: growth of the slip jump, as a part of the span.
    spring_rate: change of the spring rate, either way.
    spring_force: shift of the spring force, as a part of its change over the span.
    one_sided: one direction alone needs another force: air supply, I/P converter, leak.
    end_position: position against the stops, as a part of the span.
    travel_deviation: position against setpoint, as a part of the span.
    response_time: T86 of the newest step test, times that of the reference.
    cycles: part of cycle_limit.
    travel: part of travel_limit.
    stroke_test: 1 is failed or overdue, 2 is stuck.
    stuck: force on a stem that rests, times its static friction.
    hunting: how far a stem that hunts swings from turn to turn, as a part of the span.
    """

    averaging: Annotated[float, Interval(ge=0.001, le=0.2)] = 0.01
    cycle_limit: Annotated[float, Interval(ge=1.0, le=1e12)] = 1e6
    travel_limit: Annotated[float, Interval(ge=1.0, le=1e12)] = 1e6
    stroke_test_days: Annotated[float, Interval(ge=0.0, le=1e5)] = 0.0
    cycle_dead_band: Annotated[float, Interval(gt=0.0, le=0.2)] = 0.01
    travel_dead_band: Annotated[float, Interval(gt=0.0, le=0.2)] = 0.0025
    allowed_cycles: tuple[tuple[float, float], ...] = ()
    friction_high: AlarmSettings = _USUAL
    friction_low: AlarmSettings = _USUAL
    slip_jump: AlarmSettings = _USUAL
    spring_rate: AlarmSettings = _USUAL
    spring_force: AlarmSettings = _USUAL
    one_sided: AlarmSettings = _USUAL
    end_position: AlarmSettings = _USUAL
    travel_deviation: AlarmSettings = _USUAL
    response_time: AlarmSettings = _USUAL
    cycles: AlarmSettings = _USUAL
    travel: AlarmSettings = _USUAL
    stroke_test: AlarmSettings = _USUAL
    stuck: AlarmSettings = _USUAL
    hunting: AlarmSettings = _USUAL

    def __post_init__(self) -> None:
        """Refuse limits that contradict each other."""
        if self.allowed_cycles and not _is_falling(self.allowed_cycles):
            raise ValueError(
                "allowed_cycles must be pairs [span, cycles]: spans that rise, above 0 to 1, and cycles that fall"
            )
        for cause in AlarmCause:
            try:
                self.limits_of(cause)
            except ValueError as error:
                raise ValueError(f"{cause.key}: {error}") from None

    def limits_of(self, cause: AlarmCause) -> Limits:
        """Return when a cause is an alarm."""
        own: AlarmSettings = getattr(self, cause.key)
        return own.over(LIMITS[cause])

    @property
    def wear(self) -> tuple[float, ...]:
        """The part of the packing's life that a cycle takes, by its class of spans; empty where nobody knows."""
        return wear_of(self.allowed_cycles)

    @property
    def stroke_test_s(self) -> float:
        """The longest time between two stroke tests in s; 0 is none."""
        return self.stroke_test_days * _DAY_S


def _is_falling(allowed: tuple[tuple[float, float], ...]) -> bool:
    """Return whether larger spans are allowed less often, and all numbers are possible."""
    possible = all(0.0 < span <= 1.0 and 1.0 <= cycles < math.inf for span, cycles in allowed)
    return possible and all(a[0] < b[0] and a[1] > b[1] for a, b in pairwise(allowed))
