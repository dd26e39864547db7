"""Whether the signals of a user's DBC are wide enough: for the span of the valve, for the counters they echo. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.errors import Problem
from positioner.wire.messages import CurrentCommand, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from positioner.wire.fields import FieldFormat
    from positioner.wire.formats import FrameFormat
    from positioner.wire.messages import Message


def span_problems(form: FieldFormat, travel_m: tuple[float, float], span_m: float) -> tuple[Problem, ...]:
    """Return a problem where no reading can tell a place that is within the travel and within 0 to 100 % of the span.

    `form` is that of the stem position. Beyond the span it may end: a sensor then reports the end of its range.
    """
    low_m, high_m = max(travel_m[0], 0.0), min(travel_m[1], span_m)
    if form.lowest <= low_m and high_m <= form.highest:
        return ()
    where = f"wire.stem_position.signals.position_m = '{form.signal}'"
    carries = f"carries {form.lowest * 1e3:.6g} to {form.highest * 1e3:.6g} mm"
    text = f"{carries}, too little for the stem, which goes from {low_m * 1e3:g} to {high_m * 1e3:g} mm"
    return (Problem(where, None, f"{text}: widen its range in the DBC, or correct span and travel in [valve]"),)


def echo_problems(formats: Mapping[type[Message], FrameFormat]) -> Iterator[Problem]:
    """Yield a problem where a user's position frame cannot echo every counter of the command frame."""
    position, command = formats[StemPosition], formats[CurrentCommand]
    largest = command.counter_modulus - 1
    for echo in position.fields:
        if position.data_id is None and echo.name == "command_counter" and command.counter and echo.highest < largest:
            where = f"wire.stem_position.signals.command_counter = '{echo.signal}'"
            text = f"ends at {int(echo.highest)}, and the counter of {command.dbc.name} goes to {largest}"
            yield Problem(where, None, f"{text}: an echo needs as many values")
