"""What a replay says in the end. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.replay.compare import Comparison, in_words

if TYPE_CHECKING:
    from positioner.replay.session import Session


def headline(session: Session) -> str:
    """Return what was read, and what is to be known of it, a line each."""
    log = session.log
    lines = [f"{log.path}: {session.kind.value}, {log.count} frames, {session.readings} position frames"]
    lines += [f"{log.path}: {warning}" for warning in session.warnings]
    if log.cut:
        lines.append(f"{log.path}: cut at {log.end_s:.6f} s: {log.cut}; what was read counts")
    return "\n".join(lines)


def verdict(session: Session, comparison: Comparison) -> str:
    """Return the counts, and the first difference where there is one."""
    log, lines = session.log, []
    for name, tally in comparison.tallies.items():
        told = f"{tally.recorded} recorded, {tally.computed} computed, {tally.equal} equal to the bit"
        lines.append(f"{name}: {told}{f', {tally.differing} differ' if tally.differing else ''}")
    if not session.kind.knows_instants:
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
