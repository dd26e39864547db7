"""The health of a running daemon, and the same computed again from its record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from several_loop import SeveralLoop

from positioner.config.reader import load_config
from positioner.health.monitor import begin_health, observe
from positioner.replay.prepare import prepare
from positioner.replay.run import replay_cycles

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.health.counters import Counters


def recounted(log: Path, configuration: Path) -> Counters:
    settings = load_config(configuration)
    prepared = prepare(log, settings, None)
    health = begin_health(settings.health_settings, {})
    for cycle in replay_cycles(settings, prepared.cycles(), prepared.table):
        if cycle.observed is not None:
            observe(settings.health_settings, health, cycle.observed)
    return health.counting.so_far


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_counters_of_a_daemon_are_those_of_its_record_exactly(tmp_path: Path, *, lockstep: bool) -> None:
    log = tmp_path / "bus.log"
    with SeveralLoop(tmp_path, ["FV-1"], lockstep=lockstep, record=log) as loop:
        loop.run_to(2500)
        loop.plants["FV-1"].is_silent = not lockstep
        for _ in range(0 if lockstep else 300):
            loop.daemon._cycle()
        state = loop.sessions["FV-1"].health.state
        assert state is not None
        live = state.counting.so_far
    counters = recounted(log, tmp_path / "plant.toml")
    assert live == counters
    assert counters.slips > 10
    assert counters.moves > 10
    assert counters.travel_m > 0.05
    assert counters.cycles > 3
    assert sum(counters.travel) == 2
    assert (counters.total_us > 2_600_000) is not lockstep, "the time without readings counts, too"
