"""The file of a profile, read and checked before anything moves. Shell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from positioner.errors import UsageError, in_one_line
from positioner.host.profile import Profile
from positioner.host.verbs import Verb, refusal
from positioner.inputs.csv_table import text_of
from positioner.inputs.setpoint_file import setpoint_rows

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.valve.parameters import ValveParameters


def read_profile(verb: Verb, valve: ValveParameters, guard: GuardSettings) -> Profile:
    """Return the profile of a verb.

    Raises:
        UsageError: the file cannot be read.
        RecordError: it is no text.
        ConfigurationError: it has mistakes, or setpoints to which the stem cannot get; it names each with its line.
    """
    path = Path(verb.file).expanduser()
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"profile {verb.file}: cannot be read: {error.strerror}") from error
    text = text_of(verb.file, data)
    rows = setpoint_rows(verb.file, text, valve.span_m, lambda place_m: refusal(place_m, valve, guard))
    return Profile(in_one_line(path.name), rows, verb.repeats)
