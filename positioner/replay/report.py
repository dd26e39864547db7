"""The result of a replay in words. Pure."""

from __future__ import annotations

from dataclasses import asdict, fields
from enum import Enum
from typing import TYPE_CHECKING, Any

from positioner.wire.formats import FrameRejectedError

if TYPE_CHECKING:
    from positioner.replay.compare import Comparison, Difference
    from positioner.replay.prepare import PreparedLog
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_UNITS = {"_ma": ("mA", 1.0, 3), "_m": ("mm", 1e3, 5)}


def headline(prepared: PreparedLog) -> str:
    """Return lines about the log: its kind, its length, and warnings."""
    log = prepared.log
    lines = [f"{log.path}: {prepared.kind.value}, {log.count} frames, {prepared.readings} position frames"]
    lines += [f"{log.path}: {warning}" for warning in prepared.warnings]
    if log.cut:
        lines.append(f"{log.path}: cut at {log.end_s:.6f} s: {log.cut}; the frames before it are replayed")
    return "\n".join(lines)


def summary(prepared: PreparedLog, comparison: Comparison) -> str:
    """Return the counters, and the first difference if there is one."""
    log, lines = prepared.log, []
    for name, counts in comparison.counters.items():
        text = f"{counts.recorded} recorded, {counts.computed} computed, {counts.equal} equal to the bit"
        lines.append(f"{name}: {text}{f', {counts.differing} differ' if counts.differing else ''}")
    if not prepared.kind.has_instants:
        lines.append(
            "this log does not have the exact instants of the cycles: frames that are sent at fixed times, such as the "
            "status, are not compared"
        )
    first = comparison.first
    if first is None:
        return "\n".join([*lines, "identical"])
    logged = first.recorded
    where = ""
    if logged is not None:
        where = f"{log.instant_s(logged):.6f} s, frame {logged.number}, id {logged.frame.arbitration_id:03X}"
    elif first.computed is not None:
        stamp_s = log.instant_s(first.cause) if first.cause else log.begin_s + first.time_ns / 1e9
        where = f"{stamp_s:.6f} s, id {first.computed.arbitration_id:03X}"
    lines.append(f"first difference: {first.name} at {where}")
    return "\n".join([*lines, *describe(comparison.codec, first)])


def as_json(prepared: PreparedLog, comparison: Comparison) -> dict[str, Any]:
    """Return log, counters and the first difference for a program; frames as hexadecimal bytes."""
    log, first = prepared.log, comparison.first
    difference = None
    if first is not None:
        difference = {
            "frame": first.name,
            "time_s": None if first.recorded is None else log.instant_s(first.recorded),
            "recorded": None if first.recorded is None else first.recorded.frame.data.hex(),
            "computed": None if first.computed is None else first.computed.data.hex(),
            "text": [line.strip() for line in describe(comparison.codec, first)],
        }
    return {
        **log_as_json(prepared),
        "identical": comparison.identical,
        "has_instants": prepared.kind.has_instants,
        "frames_by_kind": {name: asdict(counts) for name, counts in comparison.counters.items()},
        "first_difference": difference,
    }


def log_as_json(prepared: PreparedLog) -> dict[str, Any]:
    """Return what was read."""
    log = prepared.log
    return {
        "log": str(log.path),
        "kind": prepared.kind.value,
        "frames": log.count,
        "position_frames": prepared.readings,
        "warnings": list(prepared.warnings),
        "cut": {"time_s": log.end_s, "why": log.cut} if log.cut else None,
    }


def describe(codec: Codec, difference: Difference) -> tuple[str, ...]:
    """Return the bytes that differ and their meaning, in lines."""
    recorded, computed = difference.recorded, difference.computed
    if recorded is None:
        return ("  recorded  nothing", f"  computed  {_text(codec, computed)}" if computed else "")
    if computed is None:
        return (f"  recorded  {_text(codec, recorded.frame)}", "  computed  nothing")
    lines = [f"  recorded  {recorded.frame.data.hex(' ')}", f"  computed  {computed.data.hex(' ')}"]
    try:
        old, old_counter = codec.decode(recorded.frame)
    except FrameRejectedError as error:
        return (*lines, f"  the recorded frame is not valid: {error}")
    new, new_counter = codec.decode(computed)
    for name in (field.name for field in fields(old)):
        one, other = getattr(old, name), getattr(new, name)
        if one != other:
            lines.append(f"  {_words(name)} {_value(name, one)} recorded, {_value(name, other)} computed")
    if old_counter != new_counter:
        lines.append(f"  counter {old_counter} recorded, {new_counter} computed")
    return tuple(lines)


def _text(codec: Codec, frame: CanFrame) -> str:
    try:
        message, _ = codec.decode(frame)
    except FrameRejectedError as error:
        meaning = str(error)
    else:
        names = (field.name for field in fields(message))
        meaning = ", ".join(f"{_words(name)} {_value(name, getattr(message, name))}" for name in names)
    return f"{frame.data.hex(' ')}  {meaning}"


def _words(name: str) -> str:
    for suffix in _UNITS:
        name = name.removesuffix(suffix)
    return name.replace("_", " ")


def _value(name: str, value: object) -> str:
    if isinstance(value, Enum):
        return value.name
    for suffix, (unit, scale, digits) in _UNITS.items():
        if name.endswith(suffix) and isinstance(value, float):
            return f"{value * scale:.{digits}f} {unit}"
    return str(value)
