"""Both clocks of an instant are read together, although other processes interrupt."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from positioner.machine.time import Instant, MachineTime

if TYPE_CHECKING:
    import pytest


def test_an_instant_is_read_again_where_the_process_was_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    monotonic_ns = iter([1_000, 5_001_000, 6_000_000, 6_001_000])
    wall_ns = iter([105_000_000, 106_000_000])
    monkeypatch.setattr(time, "monotonic_ns", lambda: next(monotonic_ns))
    monkeypatch.setattr(time, "time_ns", lambda: next(wall_ns))
    assert MachineTime().instant() == Instant(6_000_000, 106_000_000)


def test_a_machine_that_always_interrupts_still_gets_an_instant(monkeypatch: pytest.MonkeyPatch) -> None:
    clock_ns = iter(range(0, 10**12, 10**6))
    monkeypatch.setattr(time, "monotonic_ns", lambda: next(clock_ns))
    monkeypatch.setattr(time, "time_ns", lambda: next(clock_ns))
    instant = MachineTime().instant()
    assert instant.wall_ns - instant.monotonic_ns == 10**6
