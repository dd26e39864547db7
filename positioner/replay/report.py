"""What a replay says in the end. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.replay.compare import Comparison, in_words

if TYPE_CHECKING:
    from positioner.replay.prepare import PreparedLog


def headline(prepared: PreparedLog) -> str:
    """Return what was read, and what is to be known of it, a line each."""
    log = prepared.log
    lines = [f"{log.path}: {prepared.kind.value}, {log.count} frames, {prepared.readings} position frames"]
    lines += [f"{log.path}: {warning}" for warning in prepared.warnings]
    if log.cut:
        lines.append(f"{log.path}: cut at {log.end_s:.6f} s: {log.cut}; what was read counts")
    return "\n".join(lines)


def summary(prepared: PreparedLog, comparison: Comparison) -> str:
    """Return the counts, and the first difference where there is one."""
    log, lines = prepared.log, []
    for name, counts in comparison.counters.items():
        told = f"{counts.recorded} recorded, {counts.computed} computed, {counts.equal} equal to the bit"
        lines.append(f"{name}: {told}{f', {counts.differing} differ' if counts.differing else ''}")
    if not prepared.kind.knows_instants:
        lines.append(
            "this log does not tell at which instants the positioner looked: frames that are due by time, such as "
            "its status, are not compared"
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
    return "\n".join([*lines, *in_words(comparison.codec, first)])
