"""The verbs of the host with their numbers and units, checked before anything is sent. Pure."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from positioner.errors import UsageError, shortened
from positioner.inputs.nearest import nearest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.guard.settings import GuardSettings
    from positioner.host.profile import Profile
    from positioner.valve.parameters import ValveParameters

HELP = """\
arm            let the positioner control the valve; without `set` the stem stays where it is
disarm         no more commands are sent: the actuator goes to its own fail position
set 80         move the stem to 80 mm (`set 80mm` is the same)
set 62%        move the stem to 62 % of the span (valve.span_m), from position 0
profile F.csv  play the setpoints of a file over time; `profile F.csv repeat 3` (or forever) plays it again
manual 9.5mA   command this current (manual mode), within the guard's limits; `manual` alone keeps the present one
auto           back to automatic mode: the stem stays where it is until the next `set`
status         show mode, health, position, setpoint, current and counters
"""
HELP_INTERACTIVE = HELP + "quit           end; the positioner then holds, and later fails safe\n"


class Word(StrEnum):
    """The verbs."""

    ARM = "arm"
    DISARM = "disarm"
    SET = "set"
    PROFILE = "profile"
    MANUAL = "manual"
    AUTO = "auto"
    STATUS = "status"
    HELP = "help"
    QUIT = "quit"


@dataclass(frozen=True, slots=True)
class Verb:
    """One verb; SET has a setpoint in m, MANUAL a current in mA or None, PROFILE a file that is played `repeats` times.

    A verb with `step_percent` changes the setpoint, in manual mode the current, by so many percent.
    """

    word: Word
    setpoint_m: float = 0.0
    current_ma: float | None = None
    file: str = ""
    repeats: int = 1
    profile: Profile | None = None
    step_percent: float = 0.0


_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(.*)", re.IGNORECASE)
_LOOKS_LIKE_A_NUMBER = re.compile(r"[+-]?[.,]?\d.*")
_UNITS = frozenset({"mm", "%", "ma"})
_REPEAT, _FOREVER = "repeat", "forever"
_MOST_REPEATS = 1_000_000
"""With a profile of 30 s they last a year."""


def read_verbs(words: Sequence[str], valve: ValveParameters, guard: GuardSettings) -> tuple[Verb, ...]:
    """Return the verbs in `words`, in their order; a unit may stand apart from its number.

    Raises:
        UsageError: a word is no verb, or a number is missing, has a wrong unit or is out of reach.
    """
    left = _tokens(words)
    verbs: list[Verb] = []
    while left:
        word = _word(left.pop(0).lower())
        number = _take_number(left) if word in {Word.SET, Word.MANUAL} else ""
        if word is Word.SET:
            verbs.append(Verb(word, setpoint_m=_setpoint_m(number, valve, guard)))
        elif word is Word.PROFILE:
            verbs.append(_take_profile(left))
        elif word is Word.MANUAL and number:
            verbs.append(Verb(word, current_ma=_current_ma(number, guard)))
        else:
            verbs.append(Verb(word))
    return tuple(verbs)


def _tokens(words: Sequence[str]) -> list[str]:
    """Return the single words; quotation marks may hold a file name together, and an argument after `profile` is one.

    Raises:
        UsageError: a quotation mark stands alone.
    """
    found: list[str] = []
    for text in words:
        if found and found[-1].lower() == Word.PROFILE:
            found.append(text)
            continue
        try:
            found += shlex.split(text)
        except ValueError:
            raise UsageError(f"{text}: a quotation mark stands alone") from None
    return found


def _word(text: str) -> Word:
    try:
        return Word(text)
    except ValueError:
        raise UsageError(f"'{text}' is no verb of the host; {nearest(text, Word)}") from None


def _take_number(left: list[str]) -> str:
    """Remove a number and its unit from the front of `left` and return them; empty where there is none."""
    if not left or not _LOOKS_LIKE_A_NUMBER.fullmatch(left[0]):
        return ""
    number = left.pop(0).lower()
    return number + left.pop(0).lower() if left and left[0].lower() in _UNITS else number


def _take_profile(left: list[str]) -> Verb:
    """Remove a file and how often it is played from the front of `left`; return the verb, its file not read yet.

    Raises:
        UsageError: there is no file, or the number is none.
    """
    if not left:
        raise UsageError("profile needs a file: `profile steps.csv`, with the columns time_s and setpoint_mm")
    file = left.pop(0)
    if not left or left[0].lower() != _REPEAT:
        return Verb(Word.PROFILE, file=file)
    del left[0]
    times = left.pop(0).lower() if left else ""
    is_number = times.isdecimal() and len(times) <= len(str(_MOST_REPEATS)) and 0 < int(times) <= _MOST_REPEATS
    if times != _FOREVER and not is_number:
        wanted = f"give a whole number from 1 to {_MOST_REPEATS}, or `{_FOREVER}`"
        raise UsageError(f"profile {file} repeat {shortened(times)}: {wanted}")
    return Verb(Word.PROFILE, file=file, repeats=0 if times == _FOREVER else int(times))


def _value(text: str, verb: str, units: Sequence[str]) -> tuple[float, str]:
    """Return the number in `text` and its unit, the first of `units` without one."""
    found = _NUMBER.fullmatch(text)
    unit = (found[2] or units[0]).lower() if found else ""
    if not found or unit not in {each.lower() for each in units}:
        raise UsageError(f"{verb} {text}: is no number in {' or '.join(units)}; write it like `{verb} 9.5{units[-1]}`")
    return float(found[1]), unit


def _setpoint_m(text: str, valve: ValveParameters, guard: GuardSettings) -> float:
    if not text:
        raise UsageError("set needs a position: `set 80` (mm) or `set 62%` (of the span)")
    value, unit = _value(text, "set", ("mm", "%"))
    setpoint_m = value / 100.0 * valve.span_m if unit == "%" else value / 1000.0
    if why := refusal(setpoint_m, valve, guard):
        raise UsageError(f"set {text}: {why}")
    return setpoint_m


def refusal(setpoint_m: float, valve: ValveParameters, guard: GuardSettings) -> str:
    """Return why the stem cannot get to a setpoint in m, nothing where it can."""
    if not valve.travel_min_m <= setpoint_m <= valve.travel_max_m:
        travel = f"{valve.travel_min_m * 1e3:g} to {valve.travel_max_m * 1e3:g} mm"
        return f"{setpoint_m * 1e3:g} mm is outside the travel of {travel}"
    low_m, high_m = valve.reach_m(guard.current_low_ma, guard.current_high_ma)
    if not low_m <= setpoint_m <= high_m:
        loop = f"{guard.current_low_ma:g} to {guard.current_high_ma:g} mA"
        reach = f"{low_m * 1e3:.1f} to {high_m * 1e3:.1f} mm" if low_m < high_m else "nothing"
        return f"{setpoint_m * 1e3:g} mm is out of reach: with {loop} the stem gets to {reach}"
    return ""


def _current_ma(text: str, guard: GuardSettings) -> float:
    current_ma, _ = _value(text, "manual", ("mA",))
    if not guard.current_low_ma <= current_ma <= guard.current_high_ma:
        limits = f"{guard.current_low_ma:g} to {guard.current_high_ma:g} mA"
        raise UsageError(f"manual {text}: {current_ma:g} mA is beyond the limits of {limits} (guard.current_*)")
    return current_ma
