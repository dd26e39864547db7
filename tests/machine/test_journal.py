"""The log's throttle: a flood is one line a second, and the last one of each kind is logged, too."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import TYPE_CHECKING

from positioner.machine.journal import Throttle

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
