"""Kills learners and daemons thousands of times, damages their table in every byte, and reports the losses.

    python -m endurance.crash                 10,000 kills of a learner, 200 of the whole daemon, every byte of a table
    python -m endurance.crash --kills 20 --daemon-kills 2 --damage-share 0.01

Exit status 0: no load failed, nothing older than the limit was lost, and no damage went undetected; 1 otherwise.
"""

from __future__ import annotations

import argparse
import multiprocessing
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from tqdm import tqdm

from endurance import damage
from endurance.crash_daemons import DaemonSlot
from endurance.crash_learners import AGAIN, LearnerSlot
from endurance.probe import DiskProbe
from endurance.table_check import KillCounters, KillOutcome

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from multiprocessing.queues import SimpleQueue
    from types import FrameType
    from typing import NoReturn

_Slot: TypeAlias = LearnerSlot | DaemonSlot
_Report: TypeAlias = tuple[KillOutcome, ...] | str
_FORK = multiprocessing.get_context("fork")
_MOST_PRINTED = 20
_PRINTED_EVERY = 100


def main() -> int:
    """Run the command line and return its exit status."""
    options = _options()
    tqdm.monitor_interval = 0  # learners are forked: no other thread may run
    started_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="crash-test-", dir=options.folder) as name:
        folder = Path(name)
        with DiskProbe(folder) as probe:
            learners = _kill(LearnerSlot, folder / "learners", options.kills, options.slots, options.seed)
            daemons = _kill(DaemonSlot, folder / "daemons", options.daemon_kills, options.daemon_slots, options.seed)
            stall_s, late_s, rounds = probe.longest_s, probe.latest_s, probe.rounds
    killed_s = time.monotonic() - started_s
    damaged = damage.everywhere(options.damage_share, options.seed, options.slots)
    limit_s = options.limit_s + stall_s
    _print(f"seed {options.seed}; kills took {killed_s:.0f} s, with up to {options.slots} learners at once")
    for counters in (learners, daemons):
        _show(counters)
    _print(f"disk meanwhile: {rounds} rounds of create, sync, rename, sync; the longest took {stall_s:.3f} s")
    _print(f"processor meanwhile: a sleeper woke up to {late_s:.3f} s too late")
    violations = [*learners.violations, *daemons.violations]
    _print(f"the limit of {options.limit_s:g} s + the disk's longest round = {limit_s:.3f} s; where a table writer")
    _print(f"was killed before, + the longest start of one, {learners.start_s:.3f} s")
    violations += lost_too_much({**learners.oldest, **daemons.oldest}, limit_s, learners.start_s)
    _print(damaged.summary)
    violations += damaged.violations
    for violation in violations[:_MOST_PRINTED]:
        _print(f"violation: {violation}")
    _print(f"violations: {len(violations)}")
    return int(bool(violations))


def lost_too_much(oldest_s: Mapping[str, float], limit_s: float, start_s: float) -> list[str]:
    """Return a line for each kind of kill that lost a sample beyond the limit.

    A table writer that was killed is replaced by another one, and until that has started, in up to `start_s`, nothing
    is saved: the limit of a learner that is killed after its table writer allows for it.
    """
    limits_s = {kind: limit_s + start_s * kind.endswith(AGAIN) for kind in oldest_s}
    return [
        f"{kind}: a sample of {oldest_s[kind]:.3f} s was lost, beyond the limit of {limit_s:.3f} s"
        for kind, limit_s in limits_s.items()
        if oldest_s[kind] > limit_s
    ]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m endurance.crash", description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=10_000, help="of a learner (%(default)s)")
    parser.add_argument("--daemon-kills", type=int, default=200, help="of a whole daemon (%(default)s)")
    parser.add_argument("--slots", type=int, default=8, help="learners at once (%(default)s)")
    parser.add_argument("--daemon-slots", type=int, default=2, help="daemons at once (%(default)s)")
    parser.add_argument("--damage-share", type=float, default=1.0, help="of all damaged files (%(default)s)")
    parser.add_argument("--limit-s", type=float, default=1.0, help="age that a lost sample may have (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="(%(default)s)")
    parser.add_argument("--folder", type=Path, help="where the tables are kept: on the disk to be tested")
    return parser.parse_args()


def _kill(make: Callable[[Path, int], _Slot], folder: Path, kills: int, slots: int, seed: int) -> KillCounters:
    """Return the sums of `kills` kills, spread over slots that work at the same time."""
    folder.mkdir()
    counters = KillCounters()
    queue: SimpleQueue[_Report] = _FORK.SimpleQueue()
    shares = [kills // slots + (slot < kills % slots) for slot in range(slots)]
    workers = [
        _FORK.Process(target=_work, args=(make, folder / str(slot), share, 1000 * seed + slot, queue))
        for slot, share in enumerate(shares)
        if share
    ]
    for worker in workers:
        worker.start()
    with tqdm(total=kills, desc=f"kills of {folder.name}", unit=" kills", disable=None) as bar:
        done = 0
        while done < kills:
            report = queue.get()
            if isinstance(report, str):
                counters.violations.append(report)
                break
            for outcome in report:
                counters.add(outcome)
            done += 1
            bar.update()
            if done % _PRINTED_EVERY == 0 and bar.disable:  # no terminal: the log shows how far it is
                _print(
                    f"{done} of {kills} kills of {folder.name}: oldest lost sample {counters.oldest_s:.3f} s,"
                    f" {len(counters.violations)} violations"
                )
    for worker in workers:
        if done < kills:
            worker.terminate()
        worker.join()
    return counters


def _work(make: Callable[[Path, int], _Slot], folder: Path, kills: int, seed: int, queue: SimpleQueue[_Report]) -> None:
    signal.signal(signal.SIGTERM, _end)
    try:
        slot = make(folder, seed)
        try:
            for _ in range(kills):
                queue.put(tuple(slot.kill_one()))
        finally:
            slot.close()
    except Exception as error:  # noqa: BLE001 - a worker that fails is a result
        queue.put(f"{folder}: {type(error).__name__}: {error}")


def _end(number: int, frame: FrameType | None) -> NoReturn:
    """End a worker as an error does: its learner or daemon ends with it."""
    del number, frame
    sys.exit(1)


def _show(counters: KillCounters) -> None:
    loads = sum(counters.kills.values())
    _print(f"{loads} loads after {loads} kills, {counters.torn} of them inside a transaction")
    _print(f"  {counters.saved} samples saved, {counters.lost} lost")
    for kind, count in sorted(counters.kills.items()):
        _print(f"  {count:6d} × {kind + ':':54} oldest lost sample {counters.oldest[kind]:.3f} s")


def _print(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
