"""The limits of a step response test, and whether a result keeps them. Pure.

By size of the valve there are the figures of EnTech's dynamic specification for control valves (version 2.1), as they
are generally quoted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.commissioning.step.result import StepResult
    from positioner.commissioning.step.sizes import SizeRow

_ENTECH = (
    (0.0508, 0.1, 0.3, 0.7),
    (0.1524, 0.2, 0.6, 1.4),
    (0.3048, 0.4, 1.2, 2.8),
    (0.508, 0.6, 1.8, 4.2),
    (1e9, 0.8, 2.4, 5.6),
)
"""Up to this size in m (2, 6, 12, 20 inches): dead time, T63, T98 in s."""
_ENTECH_DEAD_BAND = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class StepTestSettings(SettingsTable):
    """The `[step_test]` table: limits of `positioner step-test`; 0 is no limit.

    dead_band, resolution: parts of the range of the input.
    overshoot: a part of the step, judged as the next two by the medians of the sizes in region C and D.
    t86_s: time from a step until 86 % of the travel that follows.
    gain_error: |travel gain - 1|.
    nominal_size_m: the size of the valve (DN 50: 0.05), for the limits of EnTech; 0 leaves them out.
    """

    dead_band: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0
    resolution: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0
    overshoot: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.0
    t86_s: Annotated[float, Interval(ge=0.0, le=3600.0)] = 0.0
    gain_error: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.0
    nominal_size_m: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.0

    def given(self) -> dict[str, float]:
        """Return the limits that there are, by key."""
        return {each.name: getattr(self, each.name) for each in fields(self) if getattr(self, each.name)}


def broken(result: StepResult, limits: StepTestSettings) -> tuple[str, ...]:
    """Return a line for each limit that the result breaks."""
    lines = list(_bands_broken(result, limits))
    for row in result.rows:
        if result.regions[row.size] in {"C", "D"}:
            lines += _row_broken(row, limits)
    return tuple(lines)


def _bands_broken(result: StepResult, limits: StepTestSettings) -> Iterator[str]:
    largest = {"dead_band": limits.dead_band, "resolution": limits.resolution}
    if limits.nominal_size_m:
        largest["dead_band"] = min(limits.dead_band or _ENTECH_DEAD_BAND, _ENTECH_DEAD_BAND)
    for name, limit in largest.items():
        for direction, side in _SIDES.items():
            value = result.band(name, direction)
            if limit and value is not None and value.median > limit:
                found = f"{100.0 * value.median:.3g} %" if value.median < math.inf else "no motion"
                yield f"{name.replace('_', ' ')} {side}: {found}, limit {100.0 * limit:g} %"


def _row_broken(row: SizeRow, limits: StepTestSettings) -> Iterator[str]:
    checks = [("t86_s", limits.t86_s, "T86"), ("overshoot", limits.overshoot, "overshoot")]
    if limits.nominal_size_m:
        _, dead_s, t63_s, t98_s = next(each for each in _ENTECH if limits.nominal_size_m <= each[0])
        checks += [("dead_time_s", dead_s, "Td"), ("t63_s", t63_s, "T63"), ("t98_s", t98_s, "T98")]
    where = f"at {100.0 * row.size:g} % {_SIDES[row.direction]}"
    for name, limit, words in checks:
        value = row.spread(name).median
        if limit and value > limit:
            factor, unit = (1.0, "s") if name.endswith("_s") else (100.0, "%")
            yield f"{words} {where}: {factor * value:.3g} {unit}, limit {factor * limit:g} {unit}"
    gain = row.spread("gain").median
    if limits.gain_error and abs(gain - 1.0) > limits.gain_error:
        yield f"travel gain {where}: {gain:.3f}, limit 1 ± {limits.gain_error:g}"


_SIDES = {1.0: "up", -1.0: "down"}
