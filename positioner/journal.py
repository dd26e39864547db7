"""The daemon's log: one line a fact, and at most one line a second of each kind. Shell."""

from __future__ import annotations

import logging
import sys
import time
from dataclasses import dataclass

logger = logging.getLogger("positioner")


def set_up(*, verbose: bool) -> None:
    """Log to the standard error stream: journald adds time and unit, a terminal needs neither."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    logger.handlers[:] = [handler]
    logger.setLevel(logging.DEBUG if verbose else logging.INFO)
    logger.propagate = False


@dataclass(slots=True)
class _Kind:
    next_s: float = 0.0
    held_back: int = 0


class Throttle:
    """Lets one line of each kind through in a second, and counts the rest into the next one."""

    def __init__(self, period_s: float = 1.0) -> None:
        """Let one line of a kind through every `period_s`."""
        self._period_s = period_s
        self._kinds: dict[str, _Kind] = {}

    def log(self, level: int, kind: str, line: str) -> None:
        """Log `line`, unless a line of its `kind` was logged within the last second."""
        entry = self._kinds.setdefault(kind, _Kind())
        now_s = time.monotonic()
        if now_s < entry.next_s:
            entry.held_back += 1
            return
        more = f" ({entry.held_back} more like it since the last line)" if entry.held_back else ""
        logger.log(level, "%s%s", line, more)
        entry.next_s, entry.held_back = now_s + self._period_s, 0
