"""Frozen, dithered and doubled sensors, actuators that fail, are reversed or stick: each is reported in time.

Start it as `python -m endurance.faults [--moves N]`; `make fault-test` does. Each law has a healthy run of many moves.
Before every move each fault begins in a copy of this run, at a random instant. The status must report it within 2 s
after the error exceeds 5 % of span. Then every law runs on every plant with sensors of five kinds, without any fault:
there every report of the status must be true.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections import Counter, defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from endurance.faulty_loop import FAULTS, HEALTHY, PERIOD_S, Loop
from positioner.bench.scenario import Scenario
from positioner.laws.registry import LAWS
from positioner.studies.conditions import PLANTS
from positioner.studies.pool import Workers, spread_out
from positioner.wire.messages import Cause

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from endurance.faulty_loop import Fault

REPORTED_WITHIN_S = 2.0
LIMIT_OF_SPAN, LOST_OF_SPAN = 0.05, 0.01
SENSORS: Mapping[str, dict[str, Any]] = {
    "noisy": {},
    "noise-free": {"noise_of_reading": 0.0},
    "quantised": {"noise_of_reading": 0.0, "resolution_m": 1e-4},
    "noisy and quantised": {"noise_of_reading": 0.001, "resolution_m": 1e-4},
    "held": {"noise_hold_s": 0.01},
}
LEAD = 200
"""Samples before a move in which a fault may begin."""
_SHARE = 10
"""Moves of one process at a time."""


@dataclass(frozen=True, slots=True)
class Series:
    """The work of one process: a law, a sensor, some moves of one seed."""

    law: str
    sensor: str
    moves: int
    seed: int


@dataclass(frozen=True, slots=True)
class Trial:
    """One fault before one move of one law: which cause reported it, and how long after the error became large."""

    law: str
    sensor: str
    fault: str
    seed: int
    setpoint_m: float
    cause: Cause | None
    after_s: float


@dataclass(frozen=True, slots=True)
class Calm:
    """A run without a fault: the true reports (the error was large for long) and the false ones."""

    name: str
    true: tuple[str, ...]
    false: tuple[str, ...]


def scenario(law: str, plant: str, sensor: str, seed: int) -> Scenario:
    """Return the scenario of a law on a plant with another sensor; the law has the constants of the unvaried plant."""
    return Scenario(
        name="fault-test",
        title="faults",
        law=law,
        seed=seed,
        sample_period_s=PERIOD_S,
        setpoints_mm=(80.0,),
        dwell_s=1.0,
        plant={"preset": plant, "sensor": SENSORS[sensor]},
    )


def next_setpoint_m(chance: random.Random, here_m: float) -> float:
    """Return a setpoint 10 to 14 mm away that every law can reach, and move away from, on every plant."""
    far_m = chance.uniform(0.010, 0.014)
    up = here_m + far_m < 0.088 and (here_m - far_m < 0.073 or chance.random() < 0.5)
    return here_m + far_m if up else here_m - far_m


def trials(series: Series) -> list[Trial]:
    """Return the trial of every fault before every move of the series."""
    chance = random.Random(f"{series.law} {series.sensor} {series.seed}")  # noqa: S311 - moves to repeat, no secret
    loop, here_m = Loop.of(scenario(series.law, "paper", series.sensor, series.seed)), 0.08
    found: list[Trial] = []
    for _ in range(1500):
        loop.cycle(here_m, HEALTHY)
    for _ in range(series.moves):
        there_m = next_setpoint_m(chance, here_m)
        found += [_trial(series, loop.fork(), fault, here_m, there_m) for fault in FAULTS]
        for _ in range(LEAD):
            loop.cycle(here_m, HEALTHY)
        here_m = there_m
        for _ in range(chance.randrange(200, 500)):
            loop.cycle(here_m, HEALTHY)
    return found


def _trial(series: Series, loop: Loop, fault: Fault, here_m: float, there_m: float) -> Trial:
    begins = loop.chance.randrange(LEAD)
    for sample in range(LEAD):
        loop.cycle(here_m, fault if sample >= begins else HEALTHY)
    limit_m = LIMIT_OF_SPAN * loop.plant.valve.span_m
    large: int | None = None
    cause, after_s = None, float("inf")
    for sample in range(round(2.0 * REPORTED_WITHIN_S / PERIOD_S)):
        if large is None and abs(there_m - loop.true_m) > limit_m:
            large = sample
        if loop.trouble is not None:
            cause = loop.trouble
            after_s = min(after_s, (sample - (sample if large is None else large)) * PERIOD_S)
            if cause is not Cause.VALVE_DIFFERS:  # it comes first, from the law, and another cause may follow it
                break
        loop.cycle(there_m, fault)
    return Trial(series.law, series.sensor, fault.name, series.seed, there_m, cause, after_s)


def calm(work: tuple[str, str, str]) -> Calm:
    """Return the status reports of a law on a plant with a sensor, without any fault, in three moves of 1.9 s."""
    law, plant, sensor = work
    chance = random.Random(f"{law} {plant} {sensor}")  # noqa: S311 - moves to repeat, no secret
    loop, here_m, large = Loop.of(scenario(law, plant, sensor, 1)), 0.08, 0
    true: list[str] = []
    false: list[str] = []
    limit_m = 0.8 * LIMIT_OF_SPAN * loop.plant.valve.span_m
    before: Cause | None = None
    for dwell in range(4):
        here_m = next_setpoint_m(chance, here_m) if dwell else here_m
        for _ in range(1900):
            loop.cycle(here_m, HEALTHY)
            error_m = abs(loop.true_m - here_m)
            large = large + 1 if error_m > limit_m else 0
            if loop.trouble is not None and loop.trouble is not before:
                line = f"{loop.trouble.name} at {loop.sample * PERIOD_S:.2f} s, {error_m * 1e3:.1f} mm off"
                is_true = loop.trouble is Cause.DEVIATION and large * PERIOD_S > loop.setup.guard.deviation_s - 0.3
                # on a valve that is not the configured one, of a stem that has not arrived
                is_lost = error_m > LOST_OF_SPAN * loop.plant.valve.span_m
                is_true |= loop.trouble is Cause.VALVE_DIFFERS and plant != "paper" and is_lost
                (true if is_true else false).append(line)
            before = loop.trouble
    return Calm(f"{law} on {plant}, {sensor}", tuple(true), tuple(false))


def late(found: list[Trial]) -> list[Trial]:
    """Return the trials whose fault was not reported in time."""
    return [trial for trial in found if trial.after_s > REPORTED_WITHIN_S]


def report(found: list[Trial], calms: list[Calm]) -> Iterator[str]:
    """Yield the findings: a line for each fault, for each late report, and for each report without a fault."""
    by_fault: defaultdict[str, list[Trial]] = defaultdict(list)
    for trial in found:
        by_fault[f"{trial.sensor}: {trial.fault}"].append(trial)
    for name, its in sorted(by_fault.items()):
        reported = [trial for trial in its if trial.cause is not None]
        causes = Counter(str(trial.cause and trial.cause.name) for trial in reported)
        last_s = max((trial.after_s for trial in reported), default=0.0)
        of = ", ".join(f"{cause} {count}" for cause, count in causes.most_common())
        yield f"{name}: {len(reported)} of {len(its)} reported, the last after {last_s:.2f} s ({of})"
    for trial in late(found):
        yield f"SILENT OR LATE: {trial}"
    for run in calms:
        yield from (f"true report: {run.name}: {line}" for line in run.true)
        yield from (f"FALSE ALARM: {run.name}: {line}" for line in run.false)


def main() -> int:
    """Run it from the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--moves", type=int, default=100, help="of each law, with each fault (default: %(default)s)")
    parser.add_argument("--laws", default=",".join(LAWS), help="which (default: all)")
    parser.add_argument(
        "--plants", default=",".join(PLANTS), help="of the runs without a fault (default: the league's)"
    )
    parser.add_argument("--workers", type=int, help="processes (default: one for each core)")
    options = parser.parse_args()
    began_s, laws = time.monotonic(), options.laws.split(",")
    sensors = (("noisy", options.moves), ("noise-free", -(-options.moves // 20)))
    work = [
        Series(law, sensor, min(_SHARE, moves - first), first)
        for law in laws
        for sensor, moves in sensors
        for first in range(0, moves, _SHARE)
    ]
    runs = [
        (law, plant, sensor) for law in laws for plant in filter(None, options.plants.split(",")) for sensor in SENSORS
    ]
    found: list[Trial] = []
    calms: list[Calm] = []
    with tqdm(total=len(work) + len(runs), unit=" runs", disable=None) as bar:
        for _, some in spread_out(trials, work, Workers(options.workers)):
            found += some
            bar.update()
        for _, run in spread_out(calm, runs, Workers(options.workers)):
            calms.append(run)
            bar.update()
    alarms = sum(len(run.false) for run in calms)
    lines = [
        *report(found, calms),
        f"{len(found)} faults, {len(late(found))} silent or reported after {REPORTED_WITHIN_S:g} s",
        f"{len(calms)} runs without a fault, {alarms} false alarms; {(time.monotonic() - began_s) / 60.0:.1f} min",
    ]
    sys.stdout.write("\n".join([*lines, ""]))
    return 1 if late(found) or alarms else 0


if __name__ == "__main__":
    raise SystemExit(main())
