"""Kills learners: alone, with their table writer, or only the table writer; then checks the table."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from endurance import learner, sample_log
from endurance.table_check import KillOutcome, TableCheck
from positioner.store import lock
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

ALONE, TOGETHER, WRITER = "learner alone", "learner and table writer", "table writer alone"
AGAIN = ", its table writer killed before"
"""Added to a learner's kind: until the next table writer has started, nothing is saved."""
_EARLY_SHARE, _EARLY_S = 0.1, 0.25
"""One kill in ten falls into the start, within this time of the fork."""
_LEARNING_S, _LONG_SHARE, _LONG_S = 0.5, 0.08, 3.0
"""Most learn for as long as a few commits take; some for so long that more than a second could be lost."""
_WRITER_SHARE = 0.2
_POLL_S = 0.005


class LearnerSlot:
    """One state directory with its learners, one after the other."""

    def __init__(self, folder: Path, seed: int) -> None:
        folder.mkdir()
        self._state, self._sample_log, self._complaints = folder / "state", folder / "sample_log", folder / "complaints"
        self._chance = random.Random(seed)  # noqa: S311 - no secret
        self._check = TableCheck(self._state, learner.VALVE, StictionTable(cell_width_m=learner.WIDTH_M))
        self._learner = 0
        self._start_s = 0.0
        self._has_lost_writer = False

    def kill_one(self) -> Iterator[KillOutcome]:
        """Let one learner live for a random time and kill it; yield the outcome of each kill, the learner's last."""
        self._sample_log.unlink(missing_ok=True)
        self._state.mkdir(exist_ok=True)
        self._start_s, self._has_lost_writer = 0.0, False
        self._learner = learner.start(self._state, self._sample_log, self._complaints, self._chance.getrandbits(32))
        try:
            yield from self._live()
            alone = self._chance.choice((True, False))
            (os.kill if alone else os.killpg)(self._learner, signal.SIGKILL)
            killed_ns = time.monotonic_ns()
        finally:
            self._end()
        with lock.held(self._state, learner.LONG_S):  # a table writer that survives saves, then releases the lock
            kind = (ALONE if alone else TOGETHER) + (AGAIN if self._has_lost_writer else "")
            outcome = self._check.after_kill(kind, sample_log.read(self._sample_log), killed_ns)
            yield replace(outcome, start_s=self._start_s)
        if self._complaints.exists():
            raise AssertionError(self._complaints.read_text(encoding="utf-8"))

    def close(self) -> None:
        """Do nothing: nothing is open between two learners."""

    def _live(self) -> Iterator[KillOutcome]:
        if self._chance.random() < _EARLY_SHARE:
            time.sleep(self._chance.uniform(0.0, _EARLY_S))
            return
        self._wait_for_samples()
        if self._chance.random() < _WRITER_SHARE:
            time.sleep(self._chance.uniform(0.0, _LEARNING_S))
            yield from self._kill_writer()
        longest_s = _LONG_S if self._chance.random() < _LONG_SHARE else _LEARNING_S
        time.sleep(self._chance.uniform(0.0, longest_s))

    def _wait_for_samples(self) -> None:
        started_s = time.monotonic()
        while not self._sample_log.exists() and not self._complaints.exists():
            self._start_s = time.monotonic() - started_s
            if self._start_s > learner.LONG_S:
                return
            time.sleep(_POLL_S)

    def _kill_writer(self) -> Iterator[KillOutcome]:
        """Kill the table writer of a learner that is stopped meanwhile, so that it starts no other one."""
        os.kill(self._learner, signal.SIGSTOP)
        try:
            os.waitid(os.P_PID, self._learner, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
            writers = [one for one in learner.children_of(self._learner) if learner.is_running(one)]
            for one in writers:
                os.kill(one, signal.SIGKILL)
            self._has_lost_writer = bool(writers)
            killed_ns = time.monotonic_ns()
            while any(map(learner.is_running, writers)):
                time.sleep(_POLL_S)
            if writers:
                yield self._check.after_kill(WRITER, sample_log.read(self._sample_log), killed_ns)
        finally:
            os.kill(self._learner, signal.SIGCONT)

    def _end(self) -> None:
        """Kill what is left of the learner."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._learner, signal.SIGKILL)
        os.waitpid(self._learner, 0)
