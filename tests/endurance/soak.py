"""Runs the daemon on an emulated valve in real time, with restarts and an outage, and looks for leaks and losses.

    SOAK_SECONDS=3600 python -m endurance.soak

Exit status 0: memory grew by less than the limit, no descriptor leaked, nothing learned was lost; 1 otherwise.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from endurance import sample_log
from endurance.pulse import Pulse
from endurance.soak_host import SoakHost
from endurance.soak_report import report
from endurance.table_check import difference, taught
from positioner.bench.processes import BenchProcess
from positioner.bus.address import embedded_address
from positioner.errors import BenchError
from positioner.runtime.shared_bus import WAITING
from positioner.store import access
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from collections.abc import Callable

_VALVE, _WIDTH_M, _PERIOD_S = "FV-401", 0.005, 0.01
_QUIET = (0.3, 0.2, 0.2, 0.3)
"""Shares of the time before a restart, an outage, another restart and the end, without the time of these events."""
_OUTAGE_SHARE, _LONGEST_OUTAGE_S = 0.05, 20.0
_LOOK_EVERY_S = 0.5
_TIMEOUT_S = 120.0


class Soak:
    """One daemon, one emulator, one host, and their measurements."""

    def __init__(self, folder: Path, seconds: float, seed: int) -> None:
        self._folder = folder
        self._seconds = seconds
        self._seed = seed
        self._address = embedded_address(os.getpid())
        self._started_s = self._looked_s = time.monotonic()
        self._bar = tqdm(total=round(seconds), desc="soak", unit=" s", disable=None)
        self.host = SoakHost(self._address, seed)
        self.pulses: list[Pulse] = []
        self._alive: list[Pulse] = []
        self._watching = False
        self.violations: list[str] = []
        self._write_configuration()
        self._emulator = self._start_emulator()
        self._daemon = self._start_daemon()

    def run(self) -> None:
        """Run the whole soak: two restarts, an outage between them, and quiet control before and after each."""
        self._until_controlled("the start")
        self._stay(_QUIET[0])
        self._restart()
        self._stay(_QUIET[1])
        self._emulator.stop()
        if not self._play(lambda: self.host.has_failed_safe, _TIMEOUT_S):
            self.violations.append("the positioner did not fail safe without feedback")
        self._play(lambda: False, min(_OUTAGE_SHARE * self._seconds, _LONGEST_OUTAGE_S))
        self._emulator = self._start_emulator()
        self.host.forget()
        self._until_controlled("the outage")
        self._stay(_QUIET[2])
        self._restart()
        self._stay(_QUIET[3])
        self._until_controlled("everything")
        self._stop_daemon()
        self._check_table()

    def close(self) -> None:
        """End the processes and close the bus."""
        self._daemon.stop()
        self._emulator.stop()
        self.host.close()
        self._bar.close()

    @property
    def learned(self) -> int:
        """The number of samples in the sample log."""
        return len(sample_log.read(self._folder / "sample_log"))

    def _restart(self) -> None:
        self._stop_daemon()
        self._daemon = self._start_daemon()
        self.host.forget()
        self._until_controlled("a restart")

    def _stop_daemon(self) -> None:
        self._watching = False
        process = self._daemon.process
        process.terminate()
        if not self._play(lambda: process.poll() is not None, _TIMEOUT_S):
            self.violations.append("the daemon did not stop")
        code = self._daemon.stop()
        if code:
            self.violations.append(f"the daemon ended with status {code}")

    def _check_table(self) -> None:
        entries = sample_log.read(self._folder / "sample_log")
        found = access.dump(self._folder / "state").table
        if not entries:
            self.violations.append("nothing was learned")
        elif differs := difference(found, taught(StictionTable(cell_width_m=_WIDTH_M), entries)):
            self.violations.append(f"the table is not that of the sample log: {differs}")

    def _stay(self, share: float) -> None:
        self._play(lambda: False, share * self._seconds)

    def _until_controlled(self, what: str) -> None:
        if not self._play(lambda: self.host.is_controlled, _TIMEOUT_S):
            self.violations.append(f"not under control within {_TIMEOUT_S:g} s after {what}")
        if not self._watching:
            self._watching = True
            self._alive = [Pulse("daemon", self._daemon.process.pid), *map(_writer, self._children())]
            self.pulses += self._alive

    def _play(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Play the host until `done` holds or the time is up, and measure the processes meanwhile."""
        end_s = time.monotonic() + timeout_s
        while not done():
            now_s = time.monotonic()
            if now_s >= end_s:
                return False
            self.host.step(min(_PERIOD_S, end_s - now_s))
            if now_s >= self._looked_s + _LOOK_EVERY_S:
                self._looked_s = now_s
                self._look(now_s)
        return True

    def _look(self, now_s: float) -> None:
        self._bar.update(round(now_s - self._started_s) - self._bar.n)
        self._daemon.drain()
        for pulse in self._alive if self._watching else ():
            pulse.measure(now_s)

    def _children(self) -> list[int]:
        process = self._daemon.process.pid
        return [int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text("ascii").split()]

    def _start_daemon(self) -> BenchProcess:
        arguments = [str(self._folder / "sample_log"), "run", "--config", str(self._folder / "valve.toml")]
        child = BenchProcess("endurance.watched_daemon", arguments, self._folder / "daemon.log")
        return _ready(child, WAITING)

    def _start_emulator(self) -> BenchProcess:
        arguments = ["--bus", str(self._address), "--period", str(_PERIOD_S), "--seed", str(self._seed)]
        child = BenchProcess("plant_emulator.cli.main", ["run", *arguments], self._folder / "emulator.log")
        return _ready(child, "READY=1")

    def _write_configuration(self) -> None:
        bus = self._address
        (self._folder / "valve.toml").write_text(
            f'[valve]\nid = "{_VALVE}"\npreset = "paper"\n'
            f'[bus]\ninterface = "{bus.interface}"\nchannel = "{bus.channel}"\nport = {bus.port}\n'
            f'[state]\ndirectory = "{self._folder / "state"}"\n'
            f"[control]\nsample_period_s = {_PERIOD_S}\ntable_cell_m = {_WIDTH_M}\n",
            encoding="utf-8",
        )


def _ready(child: BenchProcess, field: str) -> BenchProcess:
    """Return the child once it has reported that it is ready; it gets more time than in a bench."""
    deadline_s = time.monotonic() + _TIMEOUT_S
    while True:
        try:
            child.wait_for(field)
        except BenchError:
            if child.process.poll() is not None or time.monotonic() > deadline_s:
                raise
        else:
            return child


def _writer(process: int) -> Pulse:
    return Pulse("writer", process)


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(prog="python -m endurance.soak", description=(__doc__ or "").splitlines()[0])
    seconds = float(os.environ.get("SOAK_SECONDS", "3600"))
    parser.add_argument("--seconds", type=float, default=seconds, help="how long (%(default)s, from $SOAK_SECONDS)")
    parser.add_argument("--growth", type=float, default=0.01, help="share by which memory may grow (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="(%(default)s)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="soak-") as name:
        soak = Soak(Path(name), options.seconds, options.seed)
        try:
            soak.run()
        finally:
            soak.close()
        lines, failed = report(soak.host, soak.pulses, soak.violations, soak.learned, options.growth)
        log = (Path(name) / "daemon.log").read_text(encoding="utf-8") if failed else ""
    sys.stdout.write(f"soak of {options.seconds:g} s at {1 / _PERIOD_S:g} Hz, seed {options.seed}\n")
    sys.stdout.write("\n".join(lines) + "\n" + log[-4000:])
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
