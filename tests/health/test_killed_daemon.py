"""A daemon of its own process, killed -9 twice: what is kept is what its records give up to the same cycle."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import TIMEOUT_S, own_address, write_configuration

from positioner.bus.port import BusPort
from positioner.config.reader import load_config
from positioner.health.monitor import begin_health, observe, sections_of
from positioner.replay.prepare import prepare
from positioner.replay.run import replay_cycles
from positioner.store import health_file, lock
from positioner.wire.codec import make_codec
from positioner.wire.messages import ActuatorState, CurrentCommand, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_READINGS = 1440
"""The sections are handed over every 500 of them; the record on the disk lacks less than 440 when its daemon dies."""
_ONE_BY_ONE = 300


class Scripted:
    """A valve and a host that play a script, whatever the command, as fast as the daemon answers."""

    def __init__(self, port: BusPort) -> None:
        self._port, self._codec = port, make_codec()
        self._number = 0
        self._acting: int | None = None

    def play(self, daemon: subprocess.Popen[bytes], readings: int) -> None:
        answered, end_s = 0, time.monotonic() + TIMEOUT_S
        while answered < readings:
            assert daemon.poll() is None
            assert time.monotonic() < end_s
            number, self._number = self._number, self._number + 1
            stem_m = 0.075 + 0.015 * math.sin(number / 60.0)
            self._send(Setpoint(0.075), number)
            self._send(ActuatorState(9e4), number)
            self._send(StemPosition(stem_m, self._acting), number)
            if self._is_answered(number):
                answered, end_s = answered + 1, time.monotonic() + TIMEOUT_S

    def _is_answered(self, number: int) -> bool:
        """Return whether the reading is answered, once it is, or when nobody has answered for long."""
        end_s = time.monotonic() + 0.5
        while time.monotonic() < end_s:
            for frame in self._port.receive(0.05):
                message, counter = self._codec.decode(frame)
                if isinstance(message, CurrentCommand):
                    self._acting = counter
                    if message.position_counter == number % 256:
                        return True
        return False

    def _send(self, message: Setpoint | ActuatorState | StemPosition, number: int) -> None:
        assert self._port.send(self._codec.encode(message, number))


def recounted(configuration: Path, log: Path, sections: dict[str, Any], observed: int) -> Iterator[dict[str, Any]]:
    """Yield the sections that the record of a run gives around a number of cycles; the run began with `sections`.

    Frames that come one by one, at one instant of the lockstep clock, are several cycles live and one in the record:
    so its count of cycles may be a little behind.
    """
    loaded = load_config(configuration)
    settings, prepared = loaded.health_settings, prepare(log, loaded, None)
    health = begin_health(settings, sections)
    for cycle in replay_cycles(loaded, prepared.cycles(), prepared.table):
        if health.counting.observed == observed + 1:
            break
        if cycle.observed is not None:
            observe(settings, health, cycle.observed)
        if health.counting.observed >= observed - _ONE_BY_ONE:
            yield json.loads(json.dumps(sections_of(health)))


def comparable(sections: dict[str, Any]) -> dict[str, Any]:
    """Return the sections without the count of cycles, and without the date of an alarm, which no log has."""
    counters, trends = sections["counters"], sections["trends"]
    return {
        "counters": {key: value for key, value in counters.items() if key != "observed"},
        "trends": {**trends, "alarms": [{**alarm, "since": ""} for alarm in trends["alarms"]]},
    }


@pytest.mark.bus
def test_what_a_killed_daemon_had_handed_over_is_kept_and_is_what_its_record_gives(tmp_path: Path) -> None:
    address = own_address()
    control = {"sample_period_s": 0.01, "law": "pi"}
    guard = {"auto_arm": True, "frozen_s": 0.0}
    configuration = write_configuration(tmp_path, address, control=control, guard=guard)
    port = BusPort(address)
    port.open()
    valve, sections = Scripted(port), dict[str, Any]()
    for life in (1, 2):
        log = tmp_path / f"bus-{life}.log"
        run = ("run", "--config", str(configuration), "--clock", "lockstep", "--record", str(log))
        path = os.pathsep.join(filter(None, sys.path))
        daemon = subprocess.Popen(
            [sys.executable, "-m", "positioner", *run],
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": path},
        )
        try:
            valve.play(daemon, _READINGS)
        finally:
            daemon.send_signal(signal.SIGKILL)
            daemon.wait()
        with lock.held(tmp_path / "state", TIMEOUT_S):  # its table writer saves, then releases the lock
            kept = health_file.read(tmp_path / "state").sections
        observed = kept["counters"]["observed"]
        assert observed >= 1000 * life
        assert kept["counters"]["starts"] == life
        assert comparable(kept) in map(comparable, recounted(configuration, log, sections, observed))
        sections = kept
    assert sections["counters"]["cycles"] > 5
    port.close()
