"""How well friction that drifts is told from friction that does not, and from faults of spring and I/P converter.

The plant is `stochastic` with noise A (0.05 % of span) under the law `nmpc`, which moves the stem to another setpoint
every 80 ms. Friction drifts by 10 % in 100 moves, up in half of the runs and down in the others; λ is 0.05. The
reference is the valve of the preset, as an identification measures it. Goals: every drift is told within 100 moves of
the instant at which it has passed 20 %; of all runs with an alarm of friction at least 0.975 drift; of the runs with a
spring that is 10 % softer, or an I/P converter that is off by 0.3 mA, at most one is called friction.
"""

from __future__ import annotations

import argparse
import multiprocessing
import statistics
import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from goal_table import show
from tqdm import tqdm

from plant_emulator.device import advance, initial_device, publish, take
from positioner.bench.inprocess import configure
from positioner.bench.playable import check_playable
from positioner.bench.scenario import load_scenario
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.health.causes import AlarmCause
from positioner.health.monitor import begin_health, observe
from positioner.health.observed import observed_cycle
from positioner.health.watch import changes_of
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Setpoint

PERIOD_S, NS = 0.001, 1_000_000_000
DWELL, SETPOINT_EVERY = 80, 10
LOWEST_MM, HIGHEST_MM = 62.0, 90.0
AVERAGING = 0.05
FAULT_AT_S = 5.0
FRICTION = (AlarmCause.FRICTION_HIGH, AlarmCause.FRICTION_LOW)
KINDS: dict[str, dict[str, Any]] = {
    "friction +10 % in 100 moves": {"packing": {"drift_per_move": 0.001}},
    "friction -10 % in 100 moves": {"packing": {"drift_per_move": -0.001}},
    "steady": {},
    "spring -10 %": {"schedule": [{"at_s": FAULT_AT_S, "key": "valve.spring_rate_n_per_m", "value": 0.9 * 52538.0}]},
    "I/P offset 0.3 mA": {"schedule": [{"at_s": FAULT_AT_S, "key": "actuator.offset_ma", "value": 0.3}]},
}


@dataclass(frozen=True)
class Outcome:
    """A run: its moves, the true move at which friction passed 20 %, the move of each alarm, and the last estimate."""

    kind: str
    moves: int
    crossed: int | None
    alarms: dict[AlarmCause, int]
    friction: float

    @property
    def friction_alarm(self) -> int | None:
        return min((self.alarms[cause] for cause in FRICTION if cause in self.alarms), default=None)


def play(job: tuple[str, int, int]) -> Outcome:
    """Play one run of at most so many moves; one that drifts ends at its alarm, or 150 moves too late."""
    kind, seed, most_moves = job
    noise = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
    scenario = load_scenario("paper-valve")
    plant = {**scenario.plant, "preset": "stochastic", "sensor": noise, **KINDS[kind]}
    estimator = {**scenario.estimator, **noise}
    scenario = replace(scenario, law="nmpc", seed=seed, plant=plant, estimator=estimator)
    configuration = configure(scenario)
    configuration = replace(configuration, health=replace(configuration.health, averaging=AVERAGING))
    plant_settings, setup = check_playable(scenario, configuration), configuration.make_setup()
    settings = configuration.health_settings
    reference = replace(settings.watch.reference, source="identify", recorded="2026-01-01")
    settings = replace(settings, watch=replace(settings.watch, reference=reference))
    health, codec, rng = begin_health(settings, {}), setup.codec, np.random.default_rng(seed)
    state = CycleState(table=StictionTable(cell_width_m=configuration.control.table_cell_m))
    device = initial_device(plant_settings, seed)
    sample, setpoint_m, crossed, alarms = 0, 0.075, None, dict[AlarmCause, int]()
    while (moves := device.plant.stem.stops) < most_moves and sample < 1000 * most_moves:
        device, inbox = publish(codec, plant_settings, device)
        if sample % SETPOINT_EVERY == 0:
            if sample % DWELL == 0:
                setpoint_m = 1e-3 * float(rng.uniform(LOWEST_MM, HIGHEST_MM))
            inbox = (codec.encode(Setpoint(setpoint_m), sample // SETPOINT_EVERY), *inbox)
        cycle_input = CycleInput((*inbox[:-2], inbox[-1]), round((sample + 1) * PERIOD_S * NS))
        before = state
        state, outbox, events = step(setup, before, cycle_input)
        observed = observed_cycle(cycle_input, before, state, outbox, events)
        if observed is not None:
            observe(settings, health, observed)
        for change in health.watch.changed:
            if change.came:
                alarms.setdefault(change.alarm.cause, moves)
        if crossed is None and abs(device.plant.packing.wear - 1.0) >= 0.2:
            crossed = moves
        if crossed is not None and (any(cause in alarms for cause in FRICTION) or moves > crossed + 150):
            break
        device = advance(plant_settings, take(codec, device, outbox), PERIOD_S)
        sample += 1
    friction = changes_of(settings.watch, health.watch.trends).friction.value
    return Outcome(kind, moves, crossed, alarms, friction)


def judged(outcomes: list[Outcome]) -> list[tuple[str, str, str, bool]]:
    """Return each goal with its figure: what, goal, figure, reached."""
    drifting = [each for each in outcomes if each.kind.startswith("friction")]
    others = [each for each in outcomes if not each.kind.startswith("friction")]
    steady = [each for each in others if each.kind == "steady"]
    faulty = [each for each in others if each.kind != "steady"]
    late = [
        each.friction_alarm - each.crossed
        for each in drifting
        if each.friction_alarm is not None and each.crossed is not None
    ]
    told = [each for each in drifting if each.friction_alarm is not None]
    falling = [each for each in drifting if each.kind.startswith("friction -")]
    right = [each for each in falling if AlarmCause.FRICTION_LOW in each.alarms]
    false = [each for each in steady if each.friction_alarm is not None]
    confused = [each for each in faulty if each.friction_alarm is not None]
    precision = len(told) / max(len(told) + len(false), 1)
    recall = len(told) / max(len(drifting), 1)
    spread = f"{min(late)} to {max(late)}, median {statistics.median(late):g}" if late else "none"
    near = bool(late) and len(late) == len(told) and all(abs(each) <= 100 for each in late)
    return [
        ("recall", "1.0", f"{recall:.3f} ({len(told)} of {len(drifting)} runs)", recall == 1.0),
        ("precision", "≥ 0.975", f"{precision:.3f} ({len(false)} of {len(steady)} steady runs)", precision >= 0.975),
        ("moves from 20 % to the alarm", "within 100", spread, near),
        ("falling friction told as falling", "all", f"{len(right)} of {len(falling)}", len(right) == len(falling)),
        ("spring or I/P called friction", "≤ 1 of 40", f"{len(confused)} of {len(faulty)}", len(confused) <= 1),
    ]


def table(outcomes: list[Outcome]) -> None:
    """Print what was seen in the runs of each kind."""
    tqdm.write("| runs | n | moves | friction at the end | alarms |\n|---|---|---|---|---|", file=sys.stdout)
    for kind in dict.fromkeys(each.kind for each in outcomes):
        chosen = [each for each in outcomes if each.kind == kind]
        counts: dict[str, int] = {}
        for each in chosen:
            for cause in each.alarms:
                counts[cause.key] = counts.get(cause.key, 0) + 1
        ends = [each.friction for each in chosen]
        friction = f"{100.0 * min(ends):+.1f} to {100.0 * max(ends):+.1f} %"
        names = ", ".join(f"{name} {count}" for name, count in counts.items()) or "none"
        most = max(each.moves for each in chosen)
        tqdm.write(f"| {kind} | {len(chosen)} | {most} | {friction} | {names} |", file=sys.stdout)


def jobs_of(runs: int, moves: int, seed: int) -> list[tuple[str, int, int]]:
    """Return the runs: half of the drifting ones rise, half of the faulty ones have a softer spring."""
    found = []
    for number, kind in enumerate(KINDS):
        count = runs if kind == "steady" else max(runs // 2, 1)
        found += [(kind, seed + 1000 * number + run, moves) for run in range(count)]
    return found


def main() -> int:
    """Print the table and the goals; return 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40, help="drifting, steady and faulty ones (default: %(default)s)")
    parser.add_argument("--moves", type=int, default=600, help="of each run (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=50_000, help="of the first run (default: %(default)s)")
    parser.add_argument("--short", action="store_true", help="two runs of each, of 300 moves")
    parser.add_argument("--workers", type=int, default=multiprocessing.cpu_count())
    arguments = parser.parse_args()
    runs, moves = (2, 300) if arguments.short else (arguments.runs, arguments.moves)
    jobs = jobs_of(runs, moves, arguments.seed)
    with multiprocessing.Pool(arguments.workers) as pool:
        outcomes = list(tqdm(pool.imap(play, jobs), total=len(jobs), unit=" runs", disable=None))
    table(outcomes)
    tqdm.write("", file=sys.stdout)
    return show(judged(outcomes))


if __name__ == "__main__":
    sys.exit(main())
