"""Kill -9 at random instants: what is kept is what the cycles of all lives give (the short form of the acceptance)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from killed_counters import Lives, real_run

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.slow(
    short="health/test_killed_daemon.py::test_what_a_killed_daemon_had_handed_over_is_kept_and_is_what_its_record_gives"
)
def test_kept_counters_are_exactly_those_of_the_cycles_over_kills(tmp_path: Path) -> None:
    real = real_run(tmp_path / "run", 1200, lockstep=True)
    lives = Lives(tmp_path / "lives", real, seed=5)
    outcomes = [lives.kill_one() for _ in range(5)]
    assert sum(counted for counted, _ in outcomes) > 500
    assert sum(counted - lost for counted, lost in outcomes) > 100
