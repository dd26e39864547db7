"""Every fault with every kind of restart: no start arms without a request, and no unit stays down.

    PYTHONPATH=tests python -m endurance.restarts [--short]

One daemon after another on one bus and one state directory, under a clock of their own: each meets a fault, ends in one
of four ways while the host asks for something, and its last commands wait in the transmit queue of the interface. The
next one must be silent until a request to arm follows another request, and must then control; if it ends before,
its unit must restart it after that exit status. Exit status: 0 nothing else happened, 1 something did.
"""

from __future__ import annotations

import argparse
import itertools
import os
import random
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm
from virtual_shell import VirtualShell

from endurance.leak import Outage
from positioner.errors import ExitCode, PositionerError
from positioner.machine.journal import logger
from positioner.wire.messages import CurrentCommand, HostRequest, Message, Mode, Setpoint

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterable, Iterator

    from positioner.bus.address import BusAddress

FAULTS = ("none", "feedback lost", "setpoint lost", "bus away", "another controller", "stall", "disarmed")
ENDS = ("kill", "watchdog", "crash", "stop")
REQUESTS = (HostRequest.ARM, HostRequest.NONE, HostRequest.DISARM)
QUEUES = ((0, 0.0), (128, 0.0), (1000, 0.0), (128, 3.0))
"""Commands in the transmit queue, and after how many s they are sent: a controller may have been off the bus."""
ROUNDS = 3
WATCHED_S = 5.0
"""The time for which the next daemon is watched before a request to arm."""
ARMED_S = 3.0
"""Within this time after a request it must control; it refuses for one second after another controller's command."""
KEPT_DOWN = frozenset({ExitCode.UNAVAILABLE, ExitCode.CONFIG})
"""The exit statuses after which `positioner@.service` is not restarted."""
_FRAME_NS = 1_000_000
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Case:
    """One cell of the matrix."""

    fault: str
    end: str
    request: HostRequest
    queue: tuple[int, float]

    def __str__(self) -> str:
        frames, after_s = self.queue
        return f"{self.fault}, {self.end}, {self.request.name}, {frames} frames in the queue after {after_s:g} s"


@dataclass
class SharedBus(Outage):
    """A world whose host may fall silent, and on whose bus commands of a daemon that has ended still come."""

    host_silent: bool = False
    left_ns: list[int] = field(default_factory=list)

    def pass_time(self, duration_ns: int) -> None:
        """Let the remaining commands arrive between the frames of plant and host."""
        end_ns = self.now_ns + duration_ns
        while self.left_ns and self.left_ns[0] <= end_ns:
            super().pass_time(max(self.left_ns.pop(0) - self.now_ns, 0))
            self._deliver(CurrentCommand(9.5), len(self.left_ns))
        super().pass_time(max(end_ns - self.now_ns, 0))

    def open(self, address: BusAddress, wanted: Iterable[tuple[int, bool]]) -> Any:
        """Open the bus: a new socket has received nothing yet."""
        self.queue.clear()
        return super().open(address, wanted)

    def _deliver(self, message: Message, counter: int) -> None:
        if not (self.host_silent and isinstance(message, Setpoint)):
            super()._deliver(message, counter)


class Matrix:
    """The daemons that follow one another; `tried_again` counts repeated starts, by reason."""

    def __init__(self, shell: VirtualShell, chance: random.Random) -> None:
        self._shell = shell
        assert isinstance(shell.world, SharedBus)
        self._world = shell.world
        self._chance = chance
        self._orphans: list[subprocess.Popen[bytes]] = []
        self.tried_again: Counter[str] = Counter()

    def play(self, case: Case) -> str:
        """Return what went wrong in this cell, in a few words; empty where nothing did."""
        world, shell = self._world, self._shell
        if not self._is_armed():
            return f"cannot be armed: {shell.mode_and_cause()}"
        shell.cycle_for(self._chance.uniform(0.05, 0.5))
        world.request = case.request if case.request is not HostRequest.DISARM else HostRequest.ARM
        self._begin_fault(case.fault)
        world.request = case.request
        shell.cycle_for(self._chance.uniform(0.0, 0.3))
        self._end(case.end)
        frames, after_s = case.queue
        first_ns = world.now_ns + round(after_s * _NS)
        world.left_ns = [first_ns + number * _FRAME_NS for number in range(frames)]
        if problem := self._start_again():
            return problem
        before = len(world.sent)
        if problem := self._cycle_for(WATCHED_S / 2.0):
            return problem
        self._end_fault()
        if problem := self._cycle_for(WATCHED_S / 2.0):
            return problem
        commands = [sent for sent in world.sent[before:] if isinstance(sent.message, CurrentCommand)]
        world.sent.clear()
        shell.lines.clear()
        return f"{len(commands)} commands that nobody has asked for" if commands else ""

    def close(self) -> None:
        """Wait for the table writers of the killed daemons."""
        for orphan in self._orphans:
            orphan.wait()

    def _is_armed(self) -> bool:
        self._world.request = HostRequest.NONE
        self._shell.cycle_for(0.3)
        self._world.request = HostRequest.ARM
        end_ns = self._world.now_ns + round(ARMED_S * _NS)
        while self._world.now_ns < end_ns and self._shell.mode() is not Mode.ACTIVE:
            self._shell.cycle()
            self._world.request = HostRequest.ARM if self._world.sample // 30 % 2 else HostRequest.NONE
        return self._shell.mode() is Mode.ACTIVE

    def _begin_fault(self, fault: str) -> None:
        world, shell = self._world, self._shell
        match fault:
            case "feedback lost":
                world.plant_silent = True
            case "setpoint lost":
                world.host_silent = True
            case "bus away":
                world.away = True
            case "another controller":
                world.left_ns = [world.now_ns + number * 10 * _FRAME_NS for number in range(50)]
            case "stall":
                pending = [round(self._chance.uniform(0.05, 5.0) * _NS)]
                world.struck = lambda: pending.pop() if pending else 0
            case "disarmed":
                world.request = HostRequest.DISARM
        shell.cycle_for(self._chance.uniform(0.05, 1.0))
        world.struck = lambda: 0

    def _end_fault(self) -> None:
        self._world.plant_silent = self._world.host_silent = self._world.away = False

    def _end(self, how: str) -> None:
        """End the daemon; all but a stop leave its table writer behind, which then saves by itself."""
        if how == "stop":
            self._shell.daemon._close()
            return
        writer = self._shell.session.table.writer
        if how == "watchdog":  # it hung until the service manager's watchdog ended it
            self._world.pass_time(2 * _NS)
        writer._child.channel.close()
        os.close(writer._lock)
        self._orphans.append(writer._child.process)

    def _start_again(self) -> str:
        """Start the next daemon as its unit would; return why the unit stays down."""
        while True:
            try:
                self._shell.start_again()
            except PositionerError as error:
                if error.exit_code in KEPT_DOWN:
                    return f"a person is needed: status {error.exit_code:d}: {error}"
                self.tried_again[type(error).__name__] += 1
            else:
                return ""

    def _cycle_for(self, duration_s: float) -> str:
        try:
            self._shell.cycle_for(duration_s)
        except PositionerError as error:
            self._shell.daemon._close()
            problem = f"a person is needed: status {error.exit_code:d}: {error}"
            self._world.left_ns.clear()
            return self._start_again() or (problem if error.exit_code in KEPT_DOWN else "")
        return ""


def cases() -> Iterator[Case]:
    """Yield every cell of the matrix."""
    yield from itertools.starmap(Case, itertools.product(FAULTS, ENDS, REQUESTS, QUEUES))


def play(folder: Path, chosen: list[Case], seed: int) -> tuple[dict[Case, str], Counter[str]]:
    """Return what went wrong, and how often a start had to be repeated, by reason."""
    wrong: dict[Case, str] = {}
    propagate, logger.propagate = logger.propagate, False
    try:
        with VirtualShell(folder, world=SharedBus) as shell:
            matrix = Matrix(shell, random.Random(seed))  # noqa: S311 - no secret
            for case in tqdm(chosen, unit="restart", disable=None):
                if problem := matrix.play(case):
                    wrong[case] = problem
                    matrix._end_fault()
        matrix.close()
    finally:
        logger.propagate = propagate
    return wrong, matrix.tried_again


def main(arguments: list[str] | None = None) -> int:
    """Run; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="a cell in sixteen, once")
    parser.add_argument("--seed", type=int, default=1, help="of the durations (%(default)s)")
    options = parser.parse_args(arguments)
    every = list(cases())
    chosen = every[:: len(every) // 21] if options.short else every * ROUNDS
    with tempfile.TemporaryDirectory(prefix="restarts-") as folder:
        wrong, tried_again = play(Path(folder), chosen, options.seed)
    repeated = ", ".join(f"{count} × {name}" for name, count in tried_again.items()) or "none"
    sys.stdout.write(f"{len(chosen)} restarts, {len(wrong)} wrong; starts that were tried again: {repeated}\n")
    for case, problem in wrong.items():
        sys.stdout.write(f"wrong: {case}: {problem}\n")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
