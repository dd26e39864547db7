"""The log: a flood is one line a second or a minute, and its lines stay whole beside a progress bar."""

from __future__ import annotations

import io
import logging
from types import SimpleNamespace
from typing import TYPE_CHECKING

from positioner.cli.procedure import bar
from positioner.cycle.timing_events import LawLate
from positioner.machine.journal import SinkHandler, Throttle
from positioner.machine.line_sink import LineSink
from positioner.runtime.announce import Announcer

if TYPE_CHECKING:
    import pytest


def test_what_changed_last_within_a_second_is_reported_when_the_second_is_over(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = [0.25]
    now = SimpleNamespace(monotonic_s=lambda: clock[0])
    throttle = Throttle(time=now)
    with caplog.at_level(logging.INFO, "positioner"):
        for line in ("mode READY (waiting for arm)", "mode READY (disarmed)", "mode READY (foreign command)"):
            throttle.log(logging.INFO, "mode READY", line)
        throttle.log(logging.ERROR, "another kind", "has a second of its own")
        clock[0] = 1.0
        throttle.flush()
        assert caplog.messages == ["mode READY (waiting for arm)", "has a second of its own"]
        clock[0] = 1.25
        throttle.flush()
        throttle.flush()
        assert caplog.messages[2:] == ["mode READY (foreign command) (1 more like it since the last line)"]
        throttle.log(logging.INFO, "mode READY", "mode READY (law failed)")
        clock[0] = 2.25
        throttle.log(logging.WARNING, "mode READY", "mode READY (disarmed)")
        assert caplog.messages[3:] == ["mode READY (disarmed) (1 more like it since the last line)"]
        throttle.log(logging.WARNING, "mode READY", "mode READY (stopped)")
        throttle.flush(all_of_them=True)
    assert caplog.messages[4:] == ["mode READY (stopped)"]


def test_late_cycles_are_one_line_a_minute_with_their_count_and_the_worst(caplog: pytest.LogCaptureFixture) -> None:
    clock = [0.0]
    announcer = Announcer("", SimpleNamespace(monotonic_s=lambda: clock[0]))
    with caplog.at_level(logging.INFO, "positioner"):
        for second in range(130):
            clock[0] = float(second)
            announcer.cycle((LawLate(1_000_000 * (25 if second == 40 else 10), 0.005),))
            announcer.throttle.flush()
        announcer.throttle.flush(all_of_them=True)
    assert [(line.partition(",")[0], line.partition(" (")[2]) for line in caplog.messages] == [
        ("a cycle took 10 ms", ""),
        ("a cycle took 25 ms", "the worst; 59 more like it since the last line)"),
        ("a cycle took 10 ms", "the worst; 59 more like it since the last line)"),
        ("a cycle took 10 ms", "the worst; 8 more like it since the last line)"),
    ]


class Screen(io.StringIO):
    """A terminal: what its first lines show after all that was written to it."""

    def isatty(self) -> bool:
        return True

    def lines(self) -> list[str]:
        rows, column = [""], 0
        for character in self.getvalue():
            if character == "\n":
                rows.append("")
                column = 0
            elif character == "\r":
                column = 0
            else:
                rows[-1] = rows[-1].ljust(column)[:column] + character + rows[-1][column + 1 :]
                column += 1
        return [row.rstrip() for row in rows]


def test_a_line_of_the_log_never_shares_its_line_with_a_progress_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    screen, log = Screen(), logging.getLogger("positioner")
    handler = SinkHandler(LineSink.of(screen))
    monkeypatch.setattr(log, "handlers", [handler])
    monkeypatch.setattr(log, "propagate", False)
    monkeypatch.setattr("sys.stderr", screen)
    with bar("identify") as show:
        show(0.5, "strokes")
        log.error("feedback stale")
        assert screen.lines()[0] == "ERROR feedback stale"
        assert screen.lines()[1].startswith("identify:  50%|")
        assert screen.lines()[1].endswith("| strokes")
    assert handler.bar is None
