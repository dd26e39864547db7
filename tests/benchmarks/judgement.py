"""Whether counts of instructions are those that were accepted. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

HELD = ("at rest", "in a move")
MOST = 0.05
"""The part by which an accepted count may change: ten times the difference between two runs."""


def judge(key: str, counted: Mapping[str, Any], reference: Mapping[str, Any] | None) -> tuple[list[str], bool]:
    """Return a line for each mode, and whether one of them has changed.

    A count that has changed is not judged where the libraries or the interpreter are others, because they may be why.
    """
    if reference is None:
        unknown = "NOT JUDGED: instructions.json has no counts of it (make accept-instructions)"
        return [f"instructions ({key}): {mode}: {counted['held'][mode]:,}: {unknown}" for mode in HELD], False
    others = [
        f"{name} {counted['with'].get(name)} instead of {version}"
        for name, version in reference["with"].items()
        if counted["with"].get(name) != version
    ]
    lines, failed = [], False
    for mode in HELD:
        now, accepted = counted["held"][mode], reference["held"][mode]
        change = now / accepted - 1.0
        line = f"instructions ({key}): {mode}: {now:,} ({change:+.1%} of {accepted:,})"
        if abs(change) <= MOST:
            lines.append(line)
        elif others:
            lines.append(f"{line}: NOT JUDGED: counted with {', '.join(others)}")
        else:
            failed = True
            lines.append(f"{line}: CHANGED by more than {MOST:.0%}; if that is right: make accept-instructions")
    return lines, failed
