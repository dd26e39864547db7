"""How much faster two workers play a campaign than one, as processes and on a Dask cluster: `make campaign-speed`.

One and two workers take turns; the best of the repeats counts. A machine that others use cannot show the ratio. So each
run is timed, too, and the ratio that follows for free cores is printed beside it: the processor time of a run, and the
part of the time in which a worker has a run. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dask_cluster import dask_cluster

from positioner.campaign.reader import load_campaign
from positioner.campaign.run import Outcome, Run, play
from positioner.campaign.study import play_campaign
from positioner.studies.pool import Workers

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.campaign.plan import Campaign

_TEXT = """
name = "speed"
title = "Equal runs"
laws = ["nmpc"]
seeds = [1, 2]
[design]
kind = "sobol"
points = 32
[scenario]
visits = 1
dwell_s = 1.0
[parameters]
"plant.sensor.noise_of_reading" = { low = 0.01, high = 0.02 }
"""
_TIMES = "CAMPAIGN_SPEED_TIMES"


@dataclass(frozen=True)
class Timing:
    """A campaign on `count` workers: its duration, its runs each second of a processor, and how busy workers were."""

    count: int
    wall_s: float
    runs_per_s: float
    busy: float


def timed_run(run: Run) -> Outcome:
    """Play a run, and note when it began and ended and how long the processor worked for it."""
    begun_s, used_s = time.monotonic(), time.thread_time()
    outcome = play(run)
    with Path(os.environ[_TIMES]).open("a", encoding="ascii") as file:
        file.write(f"{begun_s} {time.monotonic()} {time.thread_time() - used_s}\n")
    return outcome


@contextmanager
def workers_of(kind: str, count: int, folder: Path) -> Iterator[Workers]:
    """Hold `count` workers of a kind inside a `with` block."""
    if kind == "processes":
        yield Workers(count)
        return
    with dask_cluster(folder, count) as cluster:
        yield Workers(dask=cluster.address)


def timing(campaign: Campaign, kind: str, count: int, folder: Path) -> Timing:
    """Return how a campaign went; its duration has the start of processes in it, but not that of a cluster."""
    times = Path(os.environ[_TIMES])
    times.unlink(missing_ok=True)
    with workers_of(kind, count, folder / "dask") as workers:
        start_s = time.monotonic()
        play_campaign(campaign, folder / "out", workers, timed_run)
        wall_s = time.monotonic() - start_s
    shutil.rmtree(folder / "out")
    runs = [tuple(map(float, line.split())) for line in times.read_text(encoding="ascii").splitlines()]
    span_s = max(end_s for _, end_s, _ in runs) - min(begun_s for begun_s, _, _ in runs)
    busy = sum(end_s - begun_s for begun_s, end_s, _ in runs) / (span_s * count)
    return Timing(count, wall_s, len(runs) / sum(used_s for *_, used_s in runs), busy)


def main() -> None:
    """Print the times, and the ratio of the best ones."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=3, help="turns of each (default: %(default)s)")
    repeats = parser.parse_args().repeats
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ[_TIMES] = str(folder / "times")
        (folder / "speed.toml").write_text(_TEXT, encoding="utf-8")
        campaign = load_campaign(folder / "speed.toml")
        for kind in ("processes", "Dask cluster"):
            found: list[Timing] = []
            for count in (1, 2) * repeats:
                found.append(timing(campaign, kind, count, folder))
                _say(f"{kind}: {found[-1]}")
            one, two = (min((each for each in found if each.count == count), key=_wall) for count in (1, 2))
            free = (2 * two.busy * two.runs_per_s) / (one.busy * one.runs_per_s)
            ratio = one.wall_s / two.wall_s
            _say(f"{kind}: {one.wall_s:.1f} s / {two.wall_s:.1f} s = {ratio:.2f} ×; on free cores {free:.2f} ×")


def _wall(each: Timing) -> float:
    return each.wall_s


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
