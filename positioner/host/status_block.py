"""The lines under a session: mode, position, setpoint and current as they are now, and the line that is typed. Pure."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from positioner.host.words import in_mm, state_in_words
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.host.snapshot import Snapshot

HINT = "up/down 1 %, left/right 10 %, +/- 0.1 %, m manual, a auto, q quit, : a verb"
PROMPT = "> "
_GAP = "   "
_REMEDIES = {Mode.READY: "`:arm` arms it", Mode.FAILSAFE: "no key moves the valve before `:arm` arms it again"}
_CUT = "…"


def status_block(found: Snapshot, silence: str, progress: str, typed: str | None, size: tuple[int, int]) -> list[str]:
    """Return the lines for a terminal of `size` (columns, rows), the typed one at the end.

    silence: why no status comes. progress: how far a profile is, if one is played. typed: None while keys act at once.
    """
    columns, rows = size
    width = max(columns - 1, 1)  # in the last column a terminal may go to the next line
    lines = textwrap.wrap(state_in_words(found.status) if found.status else silence, width)
    if found.status is not None and found.status.mode in _REMEDIES:
        lines += textwrap.wrap(_REMEDIES[found.status.mode], width)
    lines += _fields(found, width)
    lines += [f"profile {progress}"] if progress else []
    lines = [_cut(line, width) for line in lines]
    room = max(rows - 2, 0)  # one line of the session stays in sight
    prompt = _cut(HINT, width) if typed is None else PROMPT + typed[-max(width - len(PROMPT), 1) :]
    return [*lines[len(lines) - min(room, len(lines)) :], prompt]


def _fields(found: Snapshot, width: int) -> list[str]:
    """Return position, setpoint and current, in one line where it is wide enough."""
    span_m = found.span_m
    fields = [
        f"position {'–' if found.position_m is None else in_mm(found.position_m, span_m)}",
        f"setpoint {'–' if found.setpoint_m is None else in_mm(found.setpoint_m, span_m)}",
        f"current {'–' if found.current_ma is None else f'{found.current_ma:.3f} mA'}",
    ]
    line = _GAP.join(fields)
    return [line] if len(line) <= width else fields


def _cut(line: str, width: int) -> str:
    return line if len(line) <= width else line[: width - 1] + _CUT
