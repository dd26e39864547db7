"""Limits of the user's DBC: mistakes in [wire], and currents that the command frame cannot carry. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.errors import ConfigurationError
from positioner.guard.settings import FailsafeAction
from positioner.inputs import toml_reader
from positioner.inputs.toml_lines import problem_at
from positioner.wire.codec import make_codec
from positioner.wire.formats import EncodingError
from positioner.wire.loop_current import same_signal
from positioner.wire.messages import CurrentCommand, Setpoint, StemPosition
from positioner.wire.ranges import span_problems
from positioner.wire.rounding import fits
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from positioner.errors import Problem
    from positioner.guard.settings import GuardSettings
    from positioner.valve.parameters import ValveParameters
    from positioner.wire.codec import Codec
    from positioner.wire.fields import FieldFormat
    from positioner.wire.formats import FrameFormat


def wire_problems(tables: dict[str, Any], text: str) -> list[Problem]:
    """Return the mistakes in the DBC, where the [wire] table itself can be read."""
    try:
        make_codec(toml_reader.build(tables.get("wire", {}), WireSettings, "[wire]"))
    except ConfigurationError as error:
        if error.source == "[wire]" and any(problem.where.startswith("wire.") for problem in error.problems):
            return [problem_at(text, problem.where, problem.message) for problem in error.problems]
    return []


def range_problems(codec: Codec, valve: ValveParameters, guard: GuardSettings, text: str) -> list[Problem]:
    """Return the currents in [guard] that the command frame of the DBC cannot carry, and a position signal too narrow.

    The command frame must carry every counter that it echoes, too.
    """
    position, setpoint = (_largest_count(codec.by_kind[kind]) for kind in (StemPosition, Setpoint))
    failsafe = "failsafe_current_ma" if guard.failsafe_action is FailsafeAction.CURRENT else "failsafe_action"
    currents_ma = {
        "current_low_ma": guard.current_low_ma,
        "current_high_ma": guard.current_high_ma,
        failsafe: guard.failsafe_ma(guard.current_low_ma),
    }
    travel_m = (valve.travel_min_m, valve.travel_max_m)
    spans = span_problems(codec.field(StemPosition, "position_m"), travel_m, valve.span_m)
    problems = [problem_at(text, each.where, each.message) for each in spans]
    for key, current_ma in currents_ma.items():
        try:
            codec.encode(CurrentCommand(current_ma, position, setpoint), 0)
        except EncodingError as error:
            where = f"guard.{key} = {getattr(guard, key)}"
            problems.append(problem_at(text, where, f"does not fit the command frame of the DBC: {error}"))
    if not problems:
        problems += _step_problems(codec.field(CurrentCommand, "current_ma"), guard, failsafe, text)
    return problems


def _largest_count(form: FrameFormat) -> int:
    return form.counter_modulus - 1 if form.counter else 0


def _step_problems(form: FieldFormat, guard: GuardSettings, failsafe: str, text: str) -> list[Problem]:
    """Return the limits that lie between two steps of the user's command signal."""
    kept = {
        "current_high_ma": (guard.current_low_ma, guard.current_high_ma),
        failsafe: same_signal(guard.failsafe_ma(guard.current_low_ma)),
    }
    message = "the command signal of the DBC has steps of {:g} mA, and none from {:g} to {:g} mA"
    return [
        problem_at(text, f"guard.{key} = {getattr(guard, key)}", message.format(abs(form.si_per_bit), *limits_ma))
        for key, limits_ma in kept.items()
        if not fits(form, *limits_ma)
    ]
