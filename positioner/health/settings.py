"""The `[health]` table of a configuration. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval

from positioner.health.causes import LIMITS, AlarmCause, Limits
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

    limit, serious_limit: as parts, 0.2 is 20 %; a serious limit of 0 is none. delay_s: the on-delay.
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

    averaging: λ of the trends, the weight of the newest move. cycle_limit: cycles after which the packing is due;
    travel_limit: the same in spans of travel. stroke_test_days: the longest time between two stroke tests; 0 is none.
    """

    averaging: Annotated[float, Interval(ge=0.001, le=0.2)] = 0.01
    cycle_limit: Annotated[float, Interval(ge=1.0, le=1e12)] = 1e6
    travel_limit: Annotated[float, Interval(ge=1.0, le=1e12)] = 1e6
    stroke_test_days: Annotated[float, Interval(ge=0.0, le=1e5)] = 0.0
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

    def __post_init__(self) -> None:
        """Refuse limits that contradict each other."""
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
    def stroke_test_s(self) -> float:
        """The longest time between two stroke tests in s; 0 is none."""
        return self.stroke_test_days * _DAY_S
