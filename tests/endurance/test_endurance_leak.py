"""The short form of `make leak-test`, and proof that it would find a leak."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from endurance import leak
from positioner.bus import opening as bus_open

TESTS = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.bus


@pytest.mark.slow(short="test_a_try_that_leaves_a_cycle_or_a_block_is_seen")
def test_cycles_and_tries_to_open_an_absent_bus_leave_no_memory_descriptors_or_garbage_behind() -> None:
    command = [sys.executable, "-m", "endurance.leak", "--short"]  # in a process that nothing else has filled
    paths = os.pathsep.join((str(TESTS), str(TESTS.parent)))
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "armed 20 times" in done.stdout


def test_a_try_that_leaves_a_cycle_or_a_block_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, real = [], bus_open.open_bus

    def leaking(*arguments: Any) -> object:
        cycle: list[object] = []
        cycle.append(cycle)
        kept.append(object())
        return real(*arguments)

    monkeypatch.setattr(bus_open, "open_bus", leaking)
    record = leak.play(tmp_path, rounds=10, retries=200, cycles=2_000)
    assert record.garbage == len(kept) == 200
    assert record.increase > 100
    assert record.blocks > leak.MOST_GROWTH
    assert not record.is_good
