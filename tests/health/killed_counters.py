"""Processes that count the cycles of a real run through the daemon's own store, until somebody kills them.

Each one writes down the number of a cycle before it counts it. So what is kept after a kill can be counted again from
the cycles of all lives before, exactly.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import random
import signal
import socket
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from several_loop import SeveralLoop

from positioner.config.reader import load_config
from positioner.health.monitor import HealthSettings, HealthState, begin_health, observe, sections_of
from positioner.replay.prepare import prepare
from positioner.replay.run import replay_cycles
from positioner.store import child, health_file, health_keeper, lock
from positioner.store import writer as table_writer
from positioner.store.channel import Channel
from positioner.store.client import TableWriterClient

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Sequence
    from pathlib import Path
    from typing import Any, NoReturn

    from positioner.config.schema import Configuration
    from positioner.health.counters import Counters
    from positioner.health.observed import ObservedCycle
    from positioner.store.messages import Open

VALVE, _WIDTH_M = "FV-1", 0.005
_HAND_OVER = 50
"""Cycles between two times that the sections are handed over."""
_LONG_S = 600.0
_LIVES_S = 0.25


@dataclass
class Real:
    """The cycles of a real run, with the settings and the counters of its daemon."""

    configuration: Configuration
    cycles: Sequence[ObservedCycle]
    counters: Counters

    @property
    def settings(self) -> HealthSettings:
        return self.configuration.health_settings


def real_run(folder: Path, samples: int, *, lockstep: bool) -> Real:
    """Return a run of the daemon with an emulated valve in memory, its cycles computed again from its record."""
    with SeveralLoop(folder, [VALVE], lockstep=lockstep, record=folder / "bus.log") as loop:
        loop.run_to(samples)
        state = loop.sessions[VALVE].health.state
    assert state is not None
    configuration = load_config(folder / "plant.toml")
    prepared = prepare(folder / "bus.log", configuration, None)
    cycles = [
        cycle.observed
        for cycle in replay_cycles(configuration, prepared.cycles(), prepared.table)
        if cycle.observed is not None
    ]
    return Real(configuration, cycles, state.counting.so_far)


def counted(settings: HealthSettings, sections: dict[str, Any], cycles: Sequence[ObservedCycle]) -> HealthState:
    health = begin_health(settings, sections)
    for cycle in cycles:
        observe(settings, health, cycle)
    return health


class Forked:
    """A forked process, in the place of one that `subprocess` started."""

    def __init__(self, pid: int) -> None:
        self.pid = pid

    def kill(self) -> None:
        os.kill(self.pid, signal.SIGKILL)

    def poll(self) -> int | None:
        return None

    def wait(self, timeout: float | None = None) -> int:
        del timeout
        return os.waitpid(self.pid, 0)[1]


def forked_writer(lock_descriptor: int, opening: Open) -> child.Child:
    """Start the table writer as a copy of this process, which has loaded everything; it saves every few ms."""
    ours, theirs = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        try:
            ours.close()
            health_keeper.SAVE_AFTER_S = 0.003
            table_writer.run(Channel(theirs), lock_descriptor)
        finally:
            os._exit(0)
    theirs.close()
    started = child.Child(cast("subprocess.Popen[bytes]", Forked(pid)), Channel(ours))
    started.channel.send(opening)
    started.channel.flush()
    return started


class Lives:
    """One state directory, and the processes that count in it, one after the other."""

    def __init__(self, folder: Path, real: Real, seed: int) -> None:
        folder.mkdir()
        self._state = folder / "state"
        self._state.mkdir()
        self._complaints = folder / "complaints"
        self._real = real
        self._chance = random.Random(seed)  # noqa: S311 - no secret
        self._done = mmap.mmap(-1, 8)
        self._sections: dict[str, Any] = {}

    def kill_one(self) -> tuple[int, int]:
        """Let one process count for a random time and kill it; return how many cycles it counted, and lost ones.

        Raises:
            AssertionError: what is kept is not what the cycles give.
        """
        self._done[:] = bytes(8)
        process = os.fork()
        if process == 0:
            self._live()
        with contextlib.suppress(PermissionError, ProcessLookupError):
            os.setpgid(process, process)
        end_s = time.monotonic() + _LONG_S
        while self._counted == 0 and not self._complaints.exists() and time.monotonic() < end_s:
            time.sleep(0.002)
        time.sleep(self._chance.uniform(0.0, _LIVES_S))
        with_writer = self._chance.random() < 0.5
        (os.killpg if with_writer else os.kill)(process, signal.SIGKILL)
        os.waitpid(process, 0)
        assert not self._complaints.exists(), self._complaints.read_text(encoding="utf-8")
        with lock.held(self._state, _LONG_S):  # a table writer that survives saves, then releases the lock
            kept = health_file.read(self._state).sections
        lost = self._check(kept)
        assert with_writer or lost <= 2 * _HAND_OVER, f"{lost} cycles lost although the table writer lived"
        self._sections = kept
        return self._counted, lost

    @property
    def _counted(self) -> int:
        return int.from_bytes(self._done[:8], "little")

    def _check(self, kept: dict[str, Any]) -> int:
        """Return how many cycles of this life are not kept."""
        before: int = self._sections.get("counters", {}).get("observed", 0)
        new: int = kept["counters"]["observed"] - before
        if kept == self._sections:
            return self._counted
        assert 0 <= new <= self._counted, f"{new} cycles kept of {self._counted}"
        again = sections_of(counted(self._real.settings, self._sections, self._cycles(before)[:new]))
        assert again == kept, f"kept {kept}, counted again {again}"
        return self._counted - new

    def _cycles(self, before: int) -> Sequence[ObservedCycle]:
        """Return the cycles that a process counts after `before` kept ones: the run from some place on."""
        start = before % (len(self._real.cycles) // 2)
        return self._real.cycles[start:]

    def _live(self) -> NoReturn:
        try:
            os.setpgid(0, 0)
            child.start = forked_writer
            writer, _, notices = TableWriterClient.open(self._state, VALVE, _WIDTH_M, timeout_s=_LONG_S)
            sections = writer.health.found.sections
            assert not notices, notices
            assert sections == self._sections, f"found {sections}"
            health = begin_health(self._real.settings, sections)
            kept = sections.get("counters", {}).get("observed", 0)
            for number, cycle in enumerate(self._cycles(kept)):
                self._done[:] = (number + 1).to_bytes(8, "little")
                observe(self._real.settings, health, cycle)
                if number % _HAND_OVER == 0:
                    writer.keep_health(sections_of(health))
                    writer.poll()
                    time.sleep(0.0005)
            time.sleep(_LONG_S)
        except BaseException as error:  # noqa: BLE001 - any error belongs in the report
            self._complaints.write_text(f"{type(error).__name__}: {error}", encoding="utf-8")
        finally:
            os._exit(1)
