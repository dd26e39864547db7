"""Setpoints on a command line: a list, steps over a range, a ramp, a sine, or the rows of a CSV file.

    73,87,80                                     in mm; with % in percent of span; each is held for a dwell
    reach                                        eight over the whole range of the plant
    steps:SIZE[,from=A][,to=B]                   from A to B in steps of SIZE, and back; each is held for a dwell
    ramp:TIME[,from=A][,to=B]                    from A to B in this time, and back in the same
    sine:PERIOD,amplitude=A[,middle=M][,cycles=N]
    FILE.csv                                     columns time_s and setpoint_mm, setpoint_pct or setpoint_m

A is a number of mm, or of percent with %; a time is a number of s. Without from, to and middle they are the ends and
the middle of the range from which the plant can be restarted both ways. Shell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from plant_emulator.presets import plant_settings
from positioner.bench.playable import within_reach
from positioner.bench.setpoint_file import read_setpoints
from positioner.errors import UsageError
from positioner.inputs.nearest import nearest

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from positioner.bench.scenario import Scenario

REACH = "reach"
PLACES = (0.41, 0.95, 0.05, 0.6, 0.3, 0.9, 0.1, 0.75)
"""Setpoints over the whole range from which a plant can be restarted, as parts of it."""
_ENDS = (0.05, 0.95)
_KEYS = {
    "steps": ("from", "to"),
    "ramp": ("from", "to"),
    "sine": ("amplitude", "middle", "cycles"),
}
_FIRST = {"steps": "the size of a step", "ramp": "a time", "sine": "a period"}
_EXAMPLE = {"steps": "steps:5%", "ramp": "ramp:30,from=50%,to=70%", "sine": "sine:20,amplitude=5%,cycles=3"}
_MOST = 100_000
_TINY = 1e-9


@dataclass(frozen=True, slots=True)
class Setpoints:
    """Setpoints in mm, one after the other.

    each_s: how long each one lasts; None for a dwell.
    edges_s: the instants between which figures are computed, where that is not each setpoint.
    """

    mm: tuple[float, ...]
    each_s: float | None = None
    edges_s: tuple[float, ...] = ()


def with_setpoints(scenario: Scenario, given: str) -> Scenario:
    """Return the scenario with these setpoints, visited once.

    Raises:
        UsageError: they are written in another way than those above.
        ConfigurationError: the file cannot be read, or holds no setpoints.
    """
    found = setpoints_in(given, plant_settings(overrides=scenario.plant), scenario.setpoint_period_s)
    return laid_into(scenario, found)


def laid_into(scenario: Scenario, found: Setpoints) -> Scenario:
    """Return the scenario with these setpoints, visited once."""
    dwell_s = scenario.dwell_s if found.each_s is None else found.each_s
    return replace(scenario, setpoints_mm=found.mm, visits=1, dwell_s=dwell_s, edges_s=found.edges_s)


def setpoints_in(given: str, plant: PlantSettings, period_s: float) -> Setpoints:
    """Return the setpoints that `given` stands for on `plant`; a moving one has a new value each `period_s`.

    Raises:
        UsageError, ConfigurationError: as `with_setpoints`.
    """
    span_mm = plant.valve.span_m * 1e3
    if given == REACH:
        return Setpoints(within_reach(plant, PLACES))
    if given.endswith(".csv"):
        mm, edges_s = read_setpoints(Path(given), span_mm, period_s)
        return Setpoints(mm, period_s, edges_s)
    shape, colon, rest = given.partition(":")
    if not colon:
        return Setpoints(tuple(_millimetres(each, span_mm, given) for each in given.split(",")))
    if shape not in _KEYS:
        raise UsageError(f"--setpoints {given}: {shape!r} is unknown; {nearest(shape, (*_KEYS, 'FILE.csv'))}")
    return _shaped(shape, rest, given, plant, period_s)


def _shaped(shape: str, rest: str, given: str, plant: PlantSettings, period_s: float) -> Setpoints:
    first, keys = _parts(shape, rest, given)
    span_mm = plant.valve.span_m * 1e3
    low_mm, high_mm = within_reach(plant, _ENDS)

    def place(key: str, otherwise_mm: float) -> float:
        return _millimetres(keys[key], span_mm, given) if key in keys else otherwise_mm

    if shape == "sine":
        if "amplitude" not in keys:
            raise UsageError(f"--setpoints {given}: needs amplitude=…; write it like {_EXAMPLE[shape]}")
        cycles = _number(keys.get("cycles", "1"), given)
        if not (cycles >= 1.0 and cycles.is_integer()):
            raise UsageError(f"--setpoints {given}: cycles must be a whole number of 1 or more")
        middle_mm = place("middle", (low_mm + high_mm) / 2.0)
        return _sine(_seconds(first, given), middle_mm, place("amplitude", 0.0), int(cycles), period_s, given)
    begin_mm, end_mm = place("from", low_mm), place("to", high_mm)
    if begin_mm == end_mm:
        raise UsageError(f"--setpoints {given}: from and to are the same place")
    if shape == "ramp":
        return _ramp(_seconds(first, given), begin_mm, end_mm, period_s, given)
    return Setpoints(_steps(_millimetres(first, span_mm, given), begin_mm, end_mm, given))


def _parts(shape: str, rest: str, given: str) -> tuple[str, dict[str, str]]:
    """Return what stands first, and the keys with their values.

    Raises:
        UsageError: a key is unknown, stands twice, or has no value.
    """
    first, *pairs = (part.strip() for part in rest.split(","))
    if not first or "=" in first:
        raise UsageError(f"--setpoints {given}: begins with {_FIRST[shape]}; write it like {_EXAMPLE[shape]}")
    keys: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = (part.strip() for part in pair.partition("="))
        if not equals or not value:
            raise UsageError(f"--setpoints {given}: {pair!r} is no KEY=VALUE; write it like {_EXAMPLE[shape]}")
        if key not in _KEYS[shape]:
            raise UsageError(f"--setpoints {given}: {key!r} is unknown; {nearest(key, _KEYS[shape])}")
        if key in keys:
            raise UsageError(f"--setpoints {given}: {key} stands twice")
        keys[key] = value
    return first, keys


def _number(text: str, given: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(
            f"--setpoints {given}: setpoint {text!r} is no number; 80 is in mm, 60% of span, FILE.csv a file"
        )
    return value


def _millimetres(text: str, span_mm: float, given: str) -> float:
    text = text.strip()
    if text.endswith("%"):
        return round(_number(text[:-1], given) / 100.0 * span_mm, 6)
    return _number(text.removesuffix("mm"), given)


def _seconds(text: str, given: str) -> float:
    value = _number(text.removesuffix("s"), given)
    if not value > 0.0:
        raise UsageError(f"--setpoints {given}: a time of {text} is not above 0 s")
    return value


def _count(duration_s: float, period_s: float, given: str) -> int:
    """Return how many setpoints last for this time, at least two."""
    count = round(duration_s / period_s)
    if count < 2:  # noqa: PLR2004 - it moves
        raise UsageError(f"--setpoints {given}: {duration_s:g} s is too short: a setpoint comes every {period_s:g} s")
    if count > _MOST:
        raise UsageError(f"--setpoints {given}: makes {count} setpoints; at most {_MOST} are played")
    return count


def _steps(size_mm: float, begin_mm: float, end_mm: float, given: str) -> tuple[float, ...]:
    if not size_mm > 0.0:
        raise UsageError(f"--setpoints {given}: a step must be larger than 0")
    count = math.floor(abs(end_mm - begin_mm) / size_mm + _TINY)
    if not 1 <= count <= _MOST:
        raise UsageError(f"--setpoints {given}: a step of {size_mm:g} mm does not fit {begin_mm:g} to {end_mm:g} mm")
    sign = math.copysign(size_mm, end_mm - begin_mm)
    up = [round(begin_mm + sign * number, 6) for number in range(count + 1)]
    return (*up, *up[-2::-1])


def _ramp(duration_s: float, begin_mm: float, end_mm: float, period_s: float, given: str) -> Setpoints:
    count = _count(duration_s, period_s, given)
    there = [round(begin_mm + (end_mm - begin_mm) * number / count, 6) for number in range(count)]
    back = [round(end_mm + (begin_mm - end_mm) * number / count, 6) for number in range(count)]
    edges_s = (0.0, count * period_s, 2 * count * period_s)
    return Setpoints((*there, *back), period_s, edges_s)


def _sine(
    period_of_sine_s: float, middle_mm: float, amplitude_mm: float, cycles: int, period_s: float, given: str
) -> Setpoints:
    count = _count(period_of_sine_s, period_s, given)
    _count(period_of_sine_s * cycles, period_s, given)
    turn = 2.0 * math.pi / count
    one = [round(middle_mm + amplitude_mm * math.sin(turn * number), 6) for number in range(count)]
    edges_s = tuple(number * count * period_s for number in range(cycles + 1))
    return Setpoints(tuple(one * cycles), period_s, edges_s)
