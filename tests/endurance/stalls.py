"""Stops the positioner at random instants, for 1 ms to a minute, and checks what it sends when it continues.

    python -m endurance.stalls        10,000 stalls of 1 ms to 60 s on a virtual clock, as many again before the arming,
                                      200 of 1 ms to 4 s by SIGSTOP
    python -m endurance.stalls --virtual 100 --real 4 --seed 3

On the virtual clock the daemon is driven through its ports, and a stall may begin at any instant but between the last
look at the clock and the system call that sends. By SIGSTOP and SIGCONT it is a process, on an embedded bus; there each
frame's instant is the kernel's stamp at a third socket. Exit status 0: no command answered a reading older than the
limit of HOLD, each stall beyond the limit of FAILSAFE was latched and logged, and before the arming no request to arm
that had waited beyond that limit was obeyed; 1 otherwise.
"""

from __future__ import annotations

import argparse
import logging
import math
import random
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm
from virtual_shell import VirtualShell

from endurance.stopped_daemon import StoppedDaemon
from positioner.machine.journal import logger
from positioner.wire.messages import CurrentCommand, HostRequest, Mode

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

PERIOD_S, HOLD_S, FAILSAFE_S = 0.01, 0.03, 0.1
_SHORTEST_S, _LONGEST_S, _LONGEST_REAL_S = 0.001, 60.0, 4.0
_NS = 1_000_000_000
_MOST_SHOWN = 20


@dataclass
class Stalls:
    """The outcomes of the stalls of one kind."""

    name: str
    hold_s: float
    stalls: int = 0
    long: int = 0
    latched: int = 0
    commands: int = 0
    oldest_s: float = 0.0
    violations: list[str] = field(default_factory=list)

    def add(self, stall_s: float, ages_s: Sequence[float], *, too_long: bool, latched: bool, logged: bool) -> None:
        """Add a stall, with the ages of the readings that commands answered during and after it."""
        self.stalls += 1
        self.commands += len(ages_s)
        self.oldest_s = max(self.oldest_s, *ages_s, 0.0)
        self.violations += [
            f"stall {self.stalls} of {stall_s:.4f} s: a command from a reading {age_s:.4f} s old"
            for age_s in ages_s
            if age_s > self.hold_s
        ]
        if too_long:
            self.long += 1
            self.latched += latched and logged
            if not (latched and logged):
                what = "not latched" if not latched else "not logged"
                self.violations.append(f"stall {self.stalls} of {stall_s:.4f} s: {what}")

    def lines(self) -> Iterable[str]:
        """Yield the report."""
        yield f"{self.name}: {self.stalls} stalls, {self.commands} commands during and after them"
        yield f"  beyond the limit of FAILSAFE: {self.long}, latched and logged: {self.latched}"
        oldest = f"{self.oldest_s * 1e3:.2f} ms, where {self.hold_s * 1e3:g} ms are allowed"
        yield f"  oldest reading that a command answered: {oldest}"


def log_uniform(chance: random.Random, longest_s: float) -> float:
    """Return a random duration in s, from 1 ms to `longest_s`, with an even distribution of its logarithm."""
    return math.exp(chance.uniform(math.log(_SHORTEST_S), math.log(longest_s)))


def on_a_virtual_clock(folder: Path, count: int, chance: random.Random) -> Stalls:
    """Stop a daemon `count` times at any instant, computing and waiting alike."""
    stalls = Stalls("virtual clock", HOLD_S)
    with VirtualShell(folder, PERIOD_S) as shell:
        world = shell.world
        world.compute_ns = lambda: chance.randrange(1_000, 4_000_000)
        for _ in tqdm(range(count), desc="virtual", unit=" stalls", leave=False, disable=None):
            if shell.mode() is not Mode.ACTIVE:
                shell.arm()
            shell.cycle_for(1.0)  # the log writes a line of each kind once a second
            shell.lines.clear()
            world.sent.clear()
            stall_s = log_uniform(chance, _LONGEST_S)
            world.strike = (world.now_ns + chance.randrange(round(0.1 * _NS)), round(stall_s * _NS))
            shell.cycle_for(0.1 + stall_s + 0.3)
            ages_s = [
                (sent.at_ns - sent.answered_ns) / _NS
                for sent in world.sent
                if isinstance(sent.message, CurrentCommand)
                and sent.message.mode is Mode.ACTIVE
                and sent.answered_ns is not None
            ]
            latched = shell.mode() is Mode.FAILSAFE
            logged = bool(shell.logged("-> FAILSAFE")) and bool(shell.logged("stood still for"))
            stalls.add(stall_s, ages_s, too_long=stall_s > FAILSAFE_S, latched=latched, logged=logged)
    return stalls


def before_the_arming(folder: Path, count: int, chance: random.Random) -> Stalls:
    """Stop a daemon that is not armed; meanwhile the host asks to arm, at random, and perhaps falls silent."""
    stalls = Stalls("virtual clock, before the arming", HOLD_S)
    with VirtualShell(folder, PERIOD_S) as shell:
        world = shell.world
        for _ in tqdm(range(count), desc="unarmed", unit=" stalls", leave=False, disable=None):
            world.request = HostRequest.DISARM
            shell.cycle_for(0.3)
            assert shell.mode() is Mode.READY
            world.sent.clear()
            stall_s = log_uniform(chance, _LONGEST_S)
            began_ns, world.request = world.now_ns, HostRequest.NONE
            armed_ns = began_ns + round((chance.random() * 1.2 * stall_s + 0.1) * _NS)
            silent_ns = armed_ns + round(log_uniform(chance, _LONGEST_S) * _NS)
            world.asks.extend([(armed_ns, HostRequest.ARM), (silent_ns, None)])
            world.strike = (began_ns + 1, round(stall_s * _NS))
            shell.cycle_for(stall_s + 0.3)
            commands = [sent for sent in world.sent if isinstance(sent.message, CurrentCommand)]
            # what a full queue did not take was never asked: an ARM that is repeated afterwards is new
            queued_ns = world.arm_queued_ns
            waited_s = 0.0 if queued_ns is None else (began_ns + stall_s * _NS - queued_ns) / _NS
            stalls.add(stall_s, (), too_long=False, latched=False, logged=False)
            stalls.commands += len(commands)
            if commands and waited_s > FAILSAFE_S:
                stalls.violations.append(f"stall {stalls.stalls} of {stall_s:.4f} s: an ARM {waited_s:.4f} s old armed")
            world.asks.clear()
    return stalls


def by_signals(folder: Path, count: int, chance: random.Random) -> Stalls:
    """Stop a daemon in a process of its own `count` times."""
    with StoppedDaemon(folder) as stopped:
        stalls = Stalls("SIGSTOP and SIGCONT", stopped.hold_s)
        for _ in tqdm(range(count), desc="signals", unit=" stalls", leave=False, disable=None):
            stopped.make_ready()
            stop = stopped.stop_for(log_uniform(chance, _LONGEST_REAL_S), chance)
            too_long = stop.stall_s > stopped.failsafe_s
            stalls.add(stop.stall_s, stop.ages_s, too_long=too_long, latched=stop.latched, logged=stop.logged)
    return stalls


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--virtual", type=int, default=10_000, metavar="N", help="stalls on a virtual clock")
    parser.add_argument("--real", type=int, default=200, metavar="N", help="stalls by SIGSTOP")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    started_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="stall-test-") as name:
        found = []
        for number, kind, word in (
            (options.virtual, on_a_virtual_clock, "virtual"),
            (options.virtual, before_the_arming, "unarmed"),
            (options.real, by_signals, "real"),
        ):
            folder = Path(name) / word
            folder.mkdir()
            if number:
                chance = random.Random(options.seed)  # noqa: S311 - to be repeated, no secret
                found.append(kind(folder, number, chance))
    violations = [violation for stalls in found for violation in stalls.violations]
    for line in (line for stalls in found for line in stalls.lines()):
        sys.stdout.write(f"{line}\n")
    for violation in violations[:_MOST_SHOWN]:
        sys.stdout.write(f"violation: {violation}\n")
    sys.stdout.write(f"seed {options.seed}, {time.monotonic() - started_s:.0f} s; violations: {len(violations)}\n")
    return int(bool(violations))


if __name__ == "__main__":
    sys.exit(main())
