"""Memory that is kept in RAM: all of it where there is no limit, and none where a later allocation would fail."""

from __future__ import annotations

import resource
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import write_configuration

from positioner.bus.address import BusAddress
from positioner.cli import run
from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.machine.memory_lock import lock_memory

if TYPE_CHECKING:
    from pathlib import Path

CURRENT_FUTURE_ON_FAULT = 7
"""MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT of <sys/mman.h>."""


def limit(monkeypatch: pytest.MonkeyPatch, most_bytes: int) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (most_bytes, most_bytes))


@pytest.mark.parametrize(("answer", "locked"), [(0, True), (-1, False)])
def test_without_a_limit_what_is_there_and_what_is_touched_later_is_locked(
    answer: int, locked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def mlockall(flags: int) -> int:
        asked.append(flags)
        return answer

    limit(monkeypatch, resource.RLIM_INFINITY)
    assert lock_memory(mlockall) is locked
    assert asked == [CURRENT_FUTURE_ON_FAULT]


def test_with_a_limit_nothing_is_locked_for_an_allocation_beyond_it_would_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, 8 << 20)
    assert not lock_memory(lambda _: pytest.fail("locked"))


def test_the_daemon_locks_its_memory_once_it_is_made_and_before_it_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []

    class NotedDaemon:
        sessions = ()

        def __init__(self, *_: object) -> None:
            order.append("is made")

        def run(self) -> ExitCode:
            order.append("runs")
            return ExitCode.OK

    monkeypatch.setattr(run, "Daemon", NotedDaemon)
    monkeypatch.setattr(run, "lock_memory", lambda: order.append("locks"))
    path = write_configuration(tmp_path, BusAddress(channel="vcan0"))
    assert main(["run", "--config", str(path)]) == 0
    assert order == ["is made", "locks", "runs"]
