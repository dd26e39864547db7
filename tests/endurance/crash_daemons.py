"""Kills whole daemons at random instants, alone or with their table writer, while a scripted valve makes them learn."""

from __future__ import annotations

import contextlib
import math
import os
import random
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import tomli_w

from endurance import sample_log
from endurance.learner import LONG_S, TOO_BUSY
from endurance.table_check import KillOutcome, TableCheck
from positioner.bus.address import embedded_address
from positioner.bus.port import BusPort
from positioner.store import lock
from positioner.valve.stiction import StictionTable
from positioner.wire.codec import make_codec
from positioner.wire.messages import CurrentCommand, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

ALONE, TOGETHER = "daemon alone", "daemon and table writer"
_VALVE = "FV-201"
_WIDTH_M = 0.005
_PERIOD_S = 0.01
_SWEEP = 20
"""Samples from one end of the script to the other; half of them the stem moves, half of them it rests."""
_LOW_M, _HIGH_M, _TREMOR_M = 0.06, 0.09, 2e-5
_EARLY_SHARE, _EARLY_S = 0.1, 1.0
_LEARNING_S = 3.0
_MOST_SAMPLES = 1000
"""Samples until the first lesson; where the script contradicts what the table knows of the valve, there is none."""
_FIRST_PAUSE_S, _ANSWER_S, _POLL_S = 0.1, 10.0, 0.05
"""How long to wait for a first answer at first, for another one, and in one piece."""


class DaemonSlot:
    """One valve with its daemons, one after the other, on one embedded bus."""

    def __init__(self, folder: Path, seed: int) -> None:
        folder.mkdir()
        self._folder = folder
        self._sample_log, self._log = folder / "sample_log", folder / "daemon.log"
        self._chance = random.Random(seed)  # noqa: S311 - no secret
        self._bus = BusPort(embedded_address(os.getpid()))
        self._bus.open()
        self._codec = make_codec()
        self._sample = 0
        self._acting: int | None = None
        self._pause_s, self._again_s = _FIRST_PAUSE_S, 0.0
        self._check = TableCheck(folder / "state", _VALVE, StictionTable(cell_width_m=_WIDTH_M))
        self._configuration = folder / "valve.toml"
        self._configuration.write_text(tomli_w.dumps(self._tables()), encoding="utf-8")

    def kill_one(self) -> Iterator[KillOutcome]:
        """Let one daemon live for a random time and kill it; yield the outcome."""
        self._sample_log.unlink(missing_ok=True)
        self._check.state.mkdir(exist_ok=True)
        daemon = self._start()
        try:
            self._play_to_the_end(daemon)
            kind = self._chance.choice((ALONE, TOGETHER))
            with contextlib.suppress(ProcessLookupError):  # it has ended by itself, which its status shows below
                (os.kill if kind == ALONE else os.killpg)(daemon.pid, signal.SIGKILL)
            killed_ns = time.monotonic_ns()
        finally:
            daemon.kill()
            code = daemon.wait()
        if code != -signal.SIGKILL:
            yield from self._start_again()
            return
        with lock.held(self._check.state, LONG_S):  # a table writer that survives saves, then releases the lock
            yield self._check.after_kill(kind, sample_log.read(self._sample_log), killed_ns)

    def _start_again(self) -> Iterator[KillOutcome]:
        """Kill another daemon instead of one that ended by itself, which is allowed on a busy machine only."""
        text = self._log.read_text(encoding="utf-8")
        if TOO_BUSY not in text:
            raise AssertionError(f"the daemon ended by itself: {text[-2000:]}")
        yield from self.kill_one()

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()

    def _start(self) -> subprocess.Popen[bytes]:
        arguments = ["run", "--config", str(self._configuration), "--clock", "lockstep"]
        with self._log.open("wb") as output:
            return subprocess.Popen(
                [sys.executable, "-m", "endurance.watched_daemon", str(self._sample_log), *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                process_group=0,
            )

    def _play_to_the_end(self, daemon: subprocess.Popen[bytes]) -> None:
        self._pause_s, self._again_s = _FIRST_PAUSE_S, 0.0
        if self._chance.random() < _EARLY_SHARE:
            self._play(daemon, self._chance.uniform(0.0, _EARLY_S))
            return
        deadline_s, most = time.monotonic() + LONG_S, self._sample + _MOST_SAMPLES
        while not self._has_learned() and self._sample < most and daemon.poll() is None:
            self._play(daemon, _POLL_S)
            if time.monotonic() > deadline_s:
                raise AssertionError(f"the daemon does not answer: {self._log.read_text(encoding='utf-8')[-2000:]}")
        self._play(daemon, self._chance.uniform(0.0, _LEARNING_S))

    def _has_learned(self) -> bool:
        """Return whether this daemon has learned a sample: how long it takes to start says nothing about its table."""
        return self._sample_log.exists() and self._sample_log.stat().st_size > 0

    def _play(self, daemon: subprocess.Popen[bytes], duration_s: float) -> None:
        """Play the valve and the host: the next position frame follows the answer to the last one.

        One without an answer is followed by the next after a pause that doubles each time: a daemon in lockstep ends
        where several wait for it at its start.
        """
        end_s = time.monotonic() + duration_s
        while (now_s := time.monotonic()) < end_s and daemon.poll() is None:
            if now_s >= self._again_s:
                self._send_next()
                self._again_s, self._pause_s = now_s + self._pause_s, 2.0 * self._pause_s
            for frame in self._bus.receive(min(_POLL_S, end_s - now_s)):
                message, counter = self._codec.decode(frame)
                if isinstance(message, CurrentCommand):
                    self._acting, self._again_s, self._pause_s = counter, 0.0, _ANSWER_S

    def _send_next(self) -> None:
        """Send the next frames of the script: the stem moves, rests and trembles, whatever the command."""
        number, self._sample = self._sample, self._sample + 1
        opening = number // _SWEEP % 2 == 0
        done = min(number % _SWEEP / (_SWEEP / 2), 1.0)
        stem_m = _LOW_M + (_HIGH_M - _LOW_M) * (done if opening else 1.0 - done) + _TREMOR_M * math.sin(1.7 * number)
        self._bus.send(self._codec.encode(Setpoint(_HIGH_M if opening else _LOW_M), number))
        self._bus.send(self._codec.encode(StemPosition(stem_m, self._acting), number))

    def _tables(self) -> dict[str, object]:
        bus = self._bus.address
        return {
            "valve": {"id": _VALVE, "preset": "paper"},
            "bus": {"interface": bus.interface, "channel": bus.channel, "port": bus.port},
            "state": {"directory": str(self._check.state)},
            "control": {"sample_period_s": _PERIOD_S, "table_cell_m": _WIDTH_M},
            "guard": {"auto_arm": True, "feedback_hold_periods": 500, "feedback_failsafe_periods": 5000},
        }
