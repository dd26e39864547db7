"""The daemon's log, with at most one line of each kind in a second or longer. Shell."""

from __future__ import annotations

import logging
import math
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from positioner.errors import in_one_line
from positioner.machine.line_sink import LineSink
from positioner.machine.time import MachineTime, TimePort

if TYPE_CHECKING:
    from collections.abc import Iterator, MutableMapping

logger = logging.getLogger("positioner")
_warnings = logging.getLogger("py.warnings")


class Bar(Protocol):
    """A progress bar in the line below the log, such as tqdm's."""

    def clear(self) -> object:
        """Take the bar away."""

    def refresh(self) -> object:
        """Show the bar again."""


class SinkHandler(logging.Handler):
    """Writes to a sink, which never waits; `sink` counts what it dropped. `bar` is shown below the lines."""

    def __init__(self, sink: LineSink) -> None:
        """Write each record as its level and its message."""
        super().__init__()
        self.sink = sink
        self.bar: Bar | None = None
        self.setFormatter(logging.Formatter("%(levelname)s %(message)s"))

    def close(self) -> None:
        """Close the sink."""
        self.sink.close()
        super().close()

    def emit(self, record: logging.LogRecord) -> None:
        """Write the record, as a line of its own also while a bar is shown."""
        if self.bar is not None:
            self.bar.clear()
        self.sink.write(in_one_line(self.format(record)))
        if self.bar is not None:
            self.bar.refresh()


def set_up(*, verbose: bool) -> None:
    """Log to the standard error stream: journald adds time and unit, a terminal needs neither.

    Warnings of libraries go the same way.
    """
    handler = SinkHandler(LineSink.of(sys.stderr))
    for old in logger.handlers:
        old.close()
    for each, level in ((logger, logging.DEBUG if verbose else logging.INFO), (_warnings, logging.WARNING)):
        each.handlers[:] = [handler]
        each.setLevel(level)
        each.propagate = False
    logging.captureWarnings(capture=True)


@contextmanager
def above(bar: Bar) -> Iterator[None]:
    """Have every line of the log appear above `bar` inside a `with` block."""
    handlers = [handler for handler in logger.handlers if isinstance(handler, SinkHandler)]
    for handler in handlers:
        handler.bar = bar
    try:
        yield
    finally:
        for handler in handlers:
            handler.bar = None


class _NamedLog(logging.LoggerAdapter[logging.Logger]):
    """The log, with the name of one valve before each line."""

    def process(self, msg: object, kwargs: MutableMapping[str, Any]) -> tuple[str, MutableMapping[str, Any]]:
        """Return the line with the name."""
        return f"{(self.extra or {})['valve']}: {msg}", kwargs


Log: TypeAlias = logging.Logger | _NamedLog


def log_of(valve: str) -> Log:
    """Return the log of a valve, with its name before each line; without a name the plain log."""
    return _NamedLog(logger, {"valve": valve}) if valve else logger


def dropped_lines() -> int:
    """Return how many lines of the log were dropped since it was set up, because nobody read them."""
    return sum(handler.sink.dropped for handler in logger.handlers if isinstance(handler, SinkHandler))


@dataclass(slots=True)
class _Kind:
    next_s: float = -math.inf
    held_back: int = 0
    level: int = logging.INFO
    line: str = ""
    size: float = 0.0
    period_s: float = 0.0


class Throttle:
    """Logs one line of each kind in a period; one of the others follows when the period is over."""

    def __init__(self, period_s: float = 1.0, time: TimePort | None = None, log: Log = logger) -> None:
        """Log one line of a kind every `period_s`, unless the kind has a longer period of its own."""
        self._log = log
        self._time = time or MachineTime()
        self._period_s = period_s
        self._kinds: dict[str, _Kind] = {}

    def log(self, level: int, kind: str, line: str, *, size: float = 0.0, period_s: float = 0.0) -> None:
        """Log `line`, unless a line of its `kind` was logged within its period, which is `period_s` at least.

        Of the lines that were held back the largest by `size` follows, among equals the last one.
        """
        entry = self._kinds.setdefault(kind, _Kind())
        if not entry.held_back or size >= entry.size:
            entry.level, entry.line, entry.size = level, line, size
        entry.period_s, entry.held_back = max(period_s, self._period_s), entry.held_back + 1
        self._log_when_due(entry, self._time.monotonic_s())

    def flush(self, *, all_of_them: bool = False) -> None:
        """Log the line of each kind that was held back for its period, or `all_of_them` at the end."""
        now_s = self._time.monotonic_s()
        for entry in self._kinds.values():
            if entry.held_back:
                self._log_when_due(entry, math.inf if all_of_them else now_s)

    def _log_when_due(self, entry: _Kind, now_s: float) -> None:
        if now_s < entry.next_s:
            return
        others = entry.held_back - 1
        more = f" ({'the worst; ' if entry.size else ''}{others} more like it since the last line)" if others else ""
        self._log.log(entry.level, "%s%s", entry.line, more)
        entry.next_s, entry.held_back = now_s + entry.period_s, 0
