"""The parameters of each law that are tuned, with the limits between which a value is searched. Shell: loads laws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from positioner.errors import UsageError
from positioner.inputs.plug_in import Kind, loaded
from positioner.laws.registry import is_outside
from positioner.laws.tuned import table_name

if TYPE_CHECKING:
    from collections.abc import Mapping

_PARAMETERS = "parameters"
"""The table under `[control]` with the numbers of a law from outside."""


@dataclass(frozen=True, slots=True)
class Range:
    """One parameter: its dotted key under the law's table, and its limits; `or_none`: half of the candidates have 0."""

    key: str
    low: float
    high: float
    or_none: bool = False


@dataclass(frozen=True, slots=True)
class Search:
    """The parameters of a law that are tuned, and those that are fixed."""

    ranges: tuple[Range, ...]
    fixed: tuple[tuple[str, float], ...] = ()


def _pid(prefix: str) -> tuple[Range, ...]:
    return (
        Range(f"{prefix}proportional_gain_ma_per_m", 5.0, 2000.0),
        Range(f"{prefix}integral_gain_ma_per_m_s", 50.0, 50000.0),
        Range(f"{prefix}derivative_gain_ma_s_per_m", 1e-3, 3.0, or_none=True),
        Range(f"{prefix}filter_time_constant_s", 5e-4, 0.1),
    )


_OFF_BAND = Range("off_band_m", 1e-4, 5e-3, or_none=True)

SEARCHES: Mapping[str, Search] = MappingProxyType(
    {
        "pi": Search(_pid("")),
        "pi-deadband": Search((*_pid("pid."), Range("deadband_m", 2e-4, 6e-3))),
        "knocker": Search(
            (
                *_pid("pid."),
                Range("pulse_amplitude_ma", 0.3, 8.0),
                Range("pulse_width_s", 0.002, 0.1),
                Range("pulse_period_s", 0.005, 0.3),
                _OFF_BAND,
            )
        ),
        "constant-reinforcement": Search((*_pid("pid."), Range("reinforcement_ma", 0.3, 8.0), _OFF_BAND)),
        "two-move": Search((Range("move_s", 0.02, 0.12), Range("back_off_m", 0.007, 0.016))),
        # on the nominal valve a move is never repeated, so the parameters of retries cannot be tuned there
        "two-move-retry": Search(
            (Range("moves.move_s", 0.02, 0.12),),
            (
                ("moves.back_off_m", 0.012),
                ("averaging_s", 0.15),
                ("tolerance_m", 0.0005),
                ("most_retries", 8),
                ("learning_gain", 1.0),
            ),
        ),
    }
)
"""Every law that can be tuned."""


def search_of(law: str) -> Search:
    """Return what is tuned of `law`; a law from outside has an attribute `tuned`: the limits of parameters by name.

    Raises:
        UsageError: nothing of it can be tuned.
        ConfigurationError: it cannot be loaded.
    """
    if law in SEARCHES:
        return SEARCHES[law]
    if not is_outside(law):
        raise UsageError(f"law {law!r} has nothing to tune; known: {', '.join(SEARCHES)}")
    limits = getattr(loaded(Kind.LAW, law), "tuned", None)
    example = 'write it in the class as tuned = {"gain_ma_per_m": (10.0, 2000.0)}'
    if not isinstance(limits, dict) or not limits:
        raise UsageError(f"law {law!r} has nothing to tune; {example}")
    ranges = []
    for name, ends in limits.items():
        try:
            low, high = map(float, ends)
        except (TypeError, ValueError):
            low = high = math.nan
        if not 0.0 < low < high < math.inf:
            raise UsageError(f"law {law!r}: tuned[{name!r}] = {ends!r}: needs two limits above 0; {example}")
        ranges.append(Range(f"{_PARAMETERS}.{name}", low, high))
    return Search(tuple(ranges))


def control_table(law: str, values: tuple[float, ...]) -> dict[str, Any]:
    """Return the `[control]` table of a configuration in which `law` has the parameters `values`."""
    search = search_of(law)
    table: dict[str, Any] = {}
    named = [(each.key, value) for each, value in zip(search.ranges, values, strict=True)]
    for key, value in (*search.fixed, *named):
        group, _, name = key.rpartition(".")
        (table.setdefault(group, {}) if group else table)[name] = value
    return {table_name(law): table} if law in SEARCHES else table
