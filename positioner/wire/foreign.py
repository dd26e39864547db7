"""Frames of a user's DBC, as named in `[wire]`: found and checked; every mistake is reported. Pure but for the file.

A user's frame carries no protection of ours; its counter signal, if it has one, may be of any length.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.errors import Problem
from positioner.machine.can_libraries import cantools
from positioner.wire.fields import field_format, field_names
from positioner.wire.formats import FrameFormat
from positioner.wire.signals import UnfitSignalError, check_numbers, counter_modulus, is_plain_integer

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from cantools.database.can.message import Message as DbcMessage

    from positioner.wire.messages import Message
    from positioner.wire.settings import MessageSettings

_CLASSIC_LENGTH = 8
_FEWEST_COUNTS = 4
_LARGEST_BYTES = 1 << 20
"""A larger DBC would take hundreds of MiB of memory to read."""


def read_messages(path: Path, problems: list[Problem]) -> tuple[DbcMessage, ...]:
    """Return the messages of the DBC in `path`; where it cannot be used, none, and one more of `problems`."""
    where = f"wire.dbc = '{path}'"
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST_BYTES + 1)
        if len(data) > _LARGEST_BYTES:
            text = f"is larger than {_LARGEST_BYTES >> 20} MiB: keep only the messages of this valve's nodes in it"
            problems.append(Problem(where, None, text))
            return ()
        database = cantools.database.load_string(_text(data), "dbc")
    except OSError as error:
        problems.append(Problem(where, None, f"cannot be read: {error.strerror}"))
        return ()
    except (cantools.database.errors.Error, ValueError) as error:
        problems.append(Problem(where, None, f"is no DBC: {error}"))
        return ()
    # for the type checker: "dbc" gives no other kind
    assert isinstance(database, cantools.database.can.Database)  # noqa: S101
    if not database.messages:
        problems.append(Problem(where, None, "holds no message"))
    if twice := _twice(database.messages):
        problems.append(Problem(where, None, f"{twice}: a frame holds one message; keep the right one of them"))
        return ()
    return tuple(database.messages)


def _twice(found: Iterable[DbcMessage]) -> str:
    """Return the first identifier that the DBC gives to two messages, in words; empty where each has its own."""
    names: dict[tuple[int, bool], str] = {}
    for message in found:
        other = names.setdefault((message.frame_id, message.is_extended_frame), message.name)
        if other != message.name:  # one that stands there twice is told where it is chosen
            return f"gives the identifier {message.frame_id:X} to {other} and to {message.name}"
    return ""


def frame_format(
    kind: type[Message],
    where: str,
    chosen: MessageSettings,
    user_messages: tuple[DbcMessage, ...],
    span_m: float,
    problems: list[Problem],
) -> FrameFormat | None:
    """Return the format of `kind` that the user has `chosen` in the table `where`; None where it adds to `problems`."""
    before = len(problems)
    dbc = _chosen(where, chosen.message, user_messages, problems)
    if dbc is None:
        return None
    if dbc.length > _CLASSIC_LENGTH:
        problems.append(Problem(f"{where}.message", None, f"{dbc.name} is longer than the 8 bytes of classic CAN"))
    if dbc.is_multiplexed():
        problems.append(Problem(f"{where}.message", None, f"{dbc.name} is multiplexed, which is not supported"))
    required = field_names(kind)[0]
    if required not in chosen.signals:
        problems.append(Problem(f"{where}.signals", None, f"{required} is required and missing"))
    _check_counter(where, chosen, dbc, problems)
    signals = {signal.name: signal for signal in dbc.signals}
    made = []
    for name, signal_name in chosen.signals.items():
        key = f"{where}.signals.{name} = '{signal_name}'"
        if name not in field_names(kind):
            problems.append(Problem(key, None, f"no such field; known: {', '.join(field_names(kind))}"))
        elif signal_name not in signals:
            problems.append(Problem(key, None, f"is not in {dbc.name}, which has: {', '.join(signals)}"))
        else:
            try:
                made.append(field_format(kind, name, signals[signal_name], span_m))
            except UnfitSignalError as error:
                problems.append(Problem(key, None, str(error)))
    if len(problems) > before:
        return None
    return FrameFormat(kind, dbc, dbc.frame_id, tuple(made), None, chosen.counter)


def _chosen(where: str, name: str, user_messages: tuple[DbcMessage, ...], problems: list[Problem]) -> DbcMessage | None:
    """Return the one message of that name; None where there is not exactly one, which is added to `problems`."""
    found = [message for message in user_messages if message.name == name]
    if len(found) == 1:
        return found[0]
    names = ", ".join(dict.fromkeys(message.name for message in user_messages))
    text = f"occurs {len(found)} times in the DBC: keep one" if found else f"is not in the DBC, which has: {names}"
    problems.append(Problem(f"{where}.message = '{name}'", None, text))
    return None


def _check_counter(where: str, chosen: MessageSettings, dbc: DbcMessage, problems: list[Problem]) -> None:
    if chosen.counter is None:
        return
    key = f"{where}.counter = '{chosen.counter}'"
    signals = {signal.name: signal for signal in dbc.signals}
    signal = signals.get(chosen.counter)
    if signal is None:
        problems.append(Problem(key, None, f"is not in {dbc.name}, which has: {', '.join(signals)}"))
        return
    if signal.is_signed or not is_plain_integer(signal):
        problems.append(Problem(key, None, "is signed, scaled or fractional, and a counter needs whole numbers from 0"))
        return
    try:
        check_numbers(signal)
    except UnfitSignalError as error:
        problems.append(Problem(key, None, str(error)))
        return
    if signal.minimum or counter_modulus(signal) < _FEWEST_COUNTS:
        text = f"has the range {signal.minimum} to {signal.maximum}, and a counter needs one from 0 to 3 at least"
        problems.append(Problem(key, None, text))


def _text(content: bytes) -> str:
    """Return the text of a DBC: UTF-8 as modern editors write it, or else the format's own Windows-1252."""
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252")
