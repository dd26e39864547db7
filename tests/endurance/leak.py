"""A daemon whose bus goes away and comes back, again and again, on a virtual clock: does anything accumulate?

    PYTHONPATH=tests python -m endurance.leak [--short]

Rounds of cycles and of tries to open the bus alternate; each try goes through python-can to an interface that this
machine lacks. After each round the memory is read. The result is its slope (Theil and Sen's, which one jump of the
allocator does not change), extrapolated to 30 days of the daemon's own time. The short form is too short for a slope:
its result is the number of blocks that Python has allocated. The garbage collector is off, as in service, and
finds nothing at the end. Exit status: 0 below the limits, 1 above one of them.
"""

from __future__ import annotations

import argparse
import gc
import os
import statistics
import sys
import tempfile
from array import array
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import can
from tqdm import tqdm
from virtual_shell import VirtualShell, World

from positioner.bus import opening as bus_open
from positioner.bus.address import BusAddress
from positioner.machine.journal import logger
from positioner.wire.messages import HostRequest, Mode

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

RETRIES, CYCLES, ROUNDS = 100_000, 1_000_000, 100
MOST_GROWTH = 0.01
"""Of the memory, in 30 days."""
_MONTH_S = 30 * 86400.0
_ABSENT = BusAddress(channel="vcan77")
_WARM_UP = 0.2
"""Of the rounds: caches fill, the allocator finds its size."""
_FREE_LISTS = 100
"""Blocks in which caches of the libraries fill slowly, and stay."""
_MEMORY = Path("/proc/self/statm")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass
class Outage(World):
    """A world whose bus can be taken away; `tries` counts the attempts to open it meanwhile."""

    away: bool = False
    tries: int = 0

    def recv(self, timeout: float | None) -> can.Message | None:
        """Return the next frame, as python-can does."""
        if self.away:
            raise can.CanOperationError("Network is down", 100)
        return super().recv(timeout)

    def open(self, _address: BusAddress, wanted: Iterable[tuple[int, bool]]) -> Any:
        """Open the bus, or fail as python-can does where there is none."""
        if self.away:
            self.tries += 1
            return bus_open.open_bus(_ABSENT, wanted)
        return self


class Record:
    """The measurements of a run, one after each round; its own memory does not grow. `garbage` was found at the end."""

    def __init__(self, rounds: int) -> None:
        self._times_s, self._resident, self._blocks, self._descriptors = (array("d", [0.0] * rounds) for _ in range(4))
        self._base = 0
        self.garbage = self.increase = 0
        self.failed_safe = 0

    def read(self, number: int, time_s: float) -> None:
        """Measure the memory after round `number`, at `time_s` of the daemon's clock."""
        self._times_s[number] = time_s
        self._resident[number] = int(_MEMORY.read_text(encoding="ascii").split()[1]) * _PAGE_BYTES
        self._blocks[number] = sys.getallocatedblocks()
        self._descriptors[number] = len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - as cheap as it can be

    def growth(self, of: Sequence[float]) -> float:
        """Return the growth in 30 days as a fraction of what there is, by the median of the slopes of all pairs."""
        steady = list(zip(self._times_s, of, strict=True))[int(len(of) * _WARM_UP) :]
        slopes = [(after - before) / (end_s - start_s) for (start_s, before), (end_s, after) in combinations(steady, 2)]
        return statistics.median(slopes) * _MONTH_S / steady[0][1]

    @property
    def resident(self) -> float:
        """The growth of the resident memory."""
        return self.growth(self._resident)

    @property
    def blocks(self) -> float:
        """The growth of the number of blocks that Python has allocated."""
        return self.growth(self._blocks)

    def collect(self) -> None:
        """Let the collector look for garbage; it empties the free lists, too, so that what is left is in use."""
        self.garbage += gc.collect()
        blocks = sys.getallocatedblocks()
        self._base = self._base or blocks
        self.increase = blocks - self._base

    @property
    def descriptors(self) -> int:
        """The number of descriptors at the end less that at the beginning."""
        return round(self._descriptors[-1] - self._descriptors[0])

    def lines(self) -> list[str]:
        """Return the report."""
        hours = (self._times_s[-1] - self._times_s[0]) / 3600.0
        return [
            f"{hours:.1f} hours of the daemon's time, in which it failed safe and was armed {self.failed_safe} times",
            f"resident {self._resident[-1] / 2**20:.1f} MiB: {100 * self.resident:+.3f} % in 30 days",
            f"{self._blocks[-1]:.0f} blocks of Python's allocator: {100 * self.blocks:+.3f} % in 30 days",
            f"blocks {self.increase:+d} after a while, descriptors {self.descriptors:+d}, garbage {self.garbage}",
        ]

    @property
    def is_good(self) -> bool:
        """Whether nothing accumulates."""
        return max(self.resident, self.blocks) < MOST_GROWTH and self.descriptors == self.garbage == 0


def play(folder: Path, rounds: int, retries: int, cycles: int, law: str = "nmpc") -> Record:
    """Return the record of `rounds` rounds, over which the retries and the cycles are spread evenly."""
    record = Record(rounds)
    with VirtualShell(folder, control={"law": law}, world=Outage) as shell:
        world = shell.world
        assert isinstance(world, Outage)
        propagate, logger.propagate = logger.propagate, False  # to a test's own log, which keeps everything
        gc.collect()
        gc.freeze()
        gc.disable()
        try:
            for number in tqdm(range(rounds), unit="round", disable=None):
                _round(shell, world, retries // rounds, cycles // rounds)
                record.failed_safe += shell.mode() is Mode.FAILSAFE
                record.read(number, world.now_ns / 1e9)
                if number == int(rounds * _WARM_UP):
                    record.collect()
            record.collect()
        finally:
            gc.enable()
            gc.unfreeze()
            logger.propagate = propagate
    return record


def _round(shell: VirtualShell, world: Outage, retries: int, cycles: int) -> None:
    """Let the daemon control for some cycles, and then take the bus away for some tries."""
    shell.cycle_for(1.0)  # until it has tried again
    shell.arm()
    if shell.mode() is not Mode.ACTIVE:
        raise RuntimeError(f"not armed: {shell.mode_and_cause()}, {shell.lines[-5:]}")
    shell.cycle(cycles)
    world.request = HostRequest.NONE
    world.away, end = True, world.tries + retries
    while world.tries < end:
        shell.cycle()
    world.away = False
    world.sent.clear()
    world.queue.clear()
    shell.lines.clear()


def main(arguments: list[str] | None = None) -> int:
    """Run; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="20 rounds of 20 tries and 500 cycles")
    options = parser.parse_args(arguments)
    rounds, retries, cycles = (20, 400, 10_000) if options.short else (ROUNDS, RETRIES, CYCLES)
    with tempfile.TemporaryDirectory(prefix="leak-") as folder:
        record = play(Path(folder), rounds, retries, cycles)
    sys.stdout.write(f"{retries} tries to open an absent bus and {cycles} cycles in {rounds} rounds\n")
    sys.stdout.writelines(f"{line}\n" for line in record.lines())
    if options.short:
        return int(record.increase > _FREE_LISTS or record.descriptors != 0 or record.garbage != 0)
    return int(not record.is_good)


if __name__ == "__main__":
    sys.exit(main())
