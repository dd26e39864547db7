"""How exactly `positioner signature` measures emulated valves: a part of `make diagnostics-test`.

At 0.05 % of span of noise: spring rate ± 0.5 %, sliding friction ± 2 % (by place ± 4 %), static friction ± 2 %,
hysteresis ± 2 %, upper end of the bench set ± 1 %, dynamic error band ± 2 %, seat load ± 3 %. At 2 % of the reading:
friction ± 5 %. With stochastic friction the map by place correlates by 0.8 with the half that stays. The valve's own
parameters are the truth; for the error band, the true positions over the same currents.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from goal_table import show
from tqdm import tqdm

from plant_emulator import valve as plant_valve
from plant_emulator.draws import Stream, uniform
from plant_emulator.friction import CELL_WIDTH_M, _field
from plant_emulator.presets import plant_settings
from positioner.commissioning.procedure import ProcedureLimits
from positioner.commissioning.signature import signature
from positioner.commissioning.signature_report import remarks
from positioner.commissioning.signature_stages import signature_experiment
from positioner.commissioning.stages import Stroke
from positioner.guard.settings import GuardSettings
from positioner.laws.law import Observation
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.presets import PRESETS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from plant_emulator.parameters import PlantSettings
    from positioner.commissioning.experiment import Experiment, IdentifyMemory
    from positioner.commissioning.signature import Signature

    Array = NDArray[np.float64]

PERIOD_S = 0.004
LOW = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
HIGH = {"noise_of_reading": 0.02, "noise_of_span": 0.0}
BIN_M = 0.005
GOALS = {
    "spring rate": 0.5,
    "sliding friction": 2.0,
    "sliding friction by place": 4.0,
    "static friction": 2.0,
    "hysteresis": 2.0,
    "bench set, upper end": 1.0,
    "dynamic error band": 2.0,
    "seat load": 3.0,
    "2 % noise: sliding friction": 5.0,
    "2 % noise: static friction": 5.0,
}
LEAST_CORRELATION = 0.8


@dataclass(frozen=True)
class Case:
    preset: str
    seed: int
    is_low: bool = True
    changes: dict[str, Any] = field(default_factory=dict)


def cases(*, short: bool) -> list[Case]:
    if short:
        return [Case("seated", 210), Case("stochastic", 240)]
    elsewhere = [
        Case("paper", 220 + n, changes={"valve": {"initial_position_m": x}}) for n, x in enumerate((0.0, 0.13))
    ]
    low = [Case(preset, seed) for preset in ("paper", "graphite", "seated", "real-valve") for seed in (210, 211, 212)]
    high = [Case(preset, seed, is_low=False) for preset in ("paper", "graphite", "seated") for seed in (230, 231)]
    return [*low, *elsewhere, *high, *(Case("stochastic", 240 + n) for n in range(12))]


def believed(preset: str) -> ValveParameters:
    names = {"seated": "graphite", "stochastic": "paper"}
    keys: dict[str, Any] = dict(PRESETS[names.get(preset, preset)])
    return ValveParameters(id="believed", **{**keys, "actuator": ActuatorParameters(**keys.get("actuator", {}))})


def played(settings: PlantSettings, experiment: Experiment, seed: int) -> tuple[IdentifyMemory, dict[int, Array]]:
    """Return the memory at the end; and of each slow stroke, by its number, the currents in mA and the true places."""
    period_s = experiment.period_s
    plant, measured_m = plant_valve.measure(settings, plant_valve.initial_state(settings, seed))
    memory = experiment.begin(measured_m)
    applied_ma, time_s = memory.state.current_ma, 0.0
    true = defaultdict(list)
    while not memory.ended:
        pressure_pa = plant.actuator.pressure_pa if settings.sensor.reports_pressure else None
        observation = Observation(measured_m, applied_ma, period_s, measured_m, time_s, pressure_pa)
        stage = experiment.stages[memory.number]
        if isinstance(stage, Stroke) and stage.records:
            true[memory.number].append((applied_ma, plant.stem.position_m))
        memory, applied_ma = experiment.advance(memory, observation)
        plant, measured_m = plant_valve.measure(settings, plant_valve.step(settings, plant, applied_ma, period_s))
        time_s += period_s
    slowest = min(experiment.stages[number].rate_ma_per_s for number in true)  # type: ignore[attr-defined]
    strokes = {
        number: np.array(points)
        for number, points in true.items()
        if experiment.stages[number].rate_ma_per_s == slowest  # type: ignore[attr-defined]
    }
    return memory, strokes


def true_band_m(strokes: dict[int, Array]) -> float:
    """Return the largest difference of the true branches over the current, in m: the same at every current."""
    bands = []
    numbers = sorted(strokes)
    for up, down in zip(numbers[::2], numbers[1::2], strict=True):
        rising, falling = strokes[up], strokes[down]
        over = np.linspace(rising[:, 0].min(), rising[:, 0].max(), 2000)
        above = np.interp(over, falling[::-1, 0], falling[::-1, 1])
        bands.append(np.max(above - np.interp(over, rising[:, 0], rising[:, 1])))
    return float(max(bands))


def correlation(found: Signature, settings: PlantSettings, seed: int) -> float:
    """Return the correlation of the map with the mean of the friction field in each bin."""
    phase = math.pi * uniform(seed, Stream.FRICTION, 0)
    cells = round(BIN_M / CELL_WIDTH_M)
    truth = []
    for each in found.by_place:
        first = round((each.position_m - 0.5 * BIN_M) / CELL_WIDTH_M)
        truth.append(float(np.mean([_field(cell, phase) for cell in range(first, first + cells)])))
    assert settings.stochastic.friction_fraction > 0.0
    return float(np.corrcoef(truth, [each.friction_n for each in found.by_place])[0, 1])


def run(case: Case) -> tuple[Case, dict[str, float], bool]:
    """Return the error of each quantity in percent (the correlation as it is), and whether it names what it missed."""
    settings = plant_settings(case.preset, {"sensor": LOW if case.is_low else HIGH, **case.changes})
    valve, truth = believed(case.preset), settings.valve
    limits = ProcedureLimits.of(valve, GuardSettings())
    memory, strokes = played(settings, signature_experiment(valve, limits, PERIOD_S), case.seed)
    found = signature(memory.stretches, valve, limits, PERIOD_S)
    low_m, high_m = found.reached_m
    unreached = [
        end_m - begin_m
        for begin_m, end_m, stop_m in (
            (valve.travel_min_m, low_m, found.closed_m),
            (high_m, valve.travel_max_m, found.open_m),
        )
        if math.isnan(stop_m)
    ]
    named = sum("not reached" in line for line in remarks(found, valve)) == sum(gap_m > 0.0 for gap_m in unreached)
    if case.preset == "stochastic":
        return case, {"correlation": correlation(found, settings, case.seed)}, named
    fitting_n, resting_n = truth.coulomb_friction_n, truth.static_friction_n
    errors = {
        "sliding friction": found.sliding_n.value / fitting_n,
        "static friction": found.static_n.value / resting_n,
    }
    if not case.is_low:
        return case, {f"2 % noise: {name}": 100.0 * (ratio - 1.0) for name, ratio in errors.items()}, named
    worst = max((each.friction_n for each in found.by_place), key=lambda force_n: abs(force_n - fitting_n))
    upper_n = truth.bench_set_n + truth.spring_rate_n_per_m * truth.span_m
    errors |= {
        "spring rate": found.spring_n_per_m.value / truth.spring_rate_n_per_m,
        "sliding friction by place": worst / fitting_n,
        "hysteresis": found.hysteresis_m / (2.0 * fitting_n / truth.spring_rate_n_per_m),
        "bench set, upper end": (found.preload_n.value + found.spring_n_per_m.value * truth.span_m) / upper_n,
        "dynamic error band": found.dynamic_error_band_m / true_band_m(strokes),
    }
    if case.preset == "seated":
        gain = truth.diaphragm_area_m2 * truth.pressure_gain_pa_per_ma
        errors["seat load"] = found.seat_load_n / (truth.bench_set_n - limits.current_low_ma * gain)
    return case, {name: 100.0 * (ratio - 1.0) for name, ratio in errors.items()}, named


def rows(results: list[tuple[Case, dict[str, float], bool]]) -> Iterator[tuple[str, str, str, bool]]:
    """Yield quantity, goal, figure and whether it is met."""
    found = defaultdict(list)
    for _, errors, _ in results:
        for name, error in errors.items():
            found[name].append(error)
    for name, goal in GOALS.items():
        if name in found:
            low, high = min(found[name]), max(found[name])
            figure = f"{low:+.2f} to {high:+.2f} % ({len(found[name])} runs)"
            yield name, f"± {goal:g} %", figure, max(abs(low), abs(high)) <= goal
    least = min(found["correlation"])
    figure = f"{least:.3f} at least ({len(found['correlation'])} runs)"
    yield "stochastic: map against the half that stays", f"≥ {LEAST_CORRELATION:g}", figure, least >= LEAST_CORRELATION
    named = sum(each for _, _, each in results)
    yield "travel that was not reached is named", "always", f"{named} of {len(results)} runs", named == len(results)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="two runs only")
    parser.add_argument("--workers", type=int, default=multiprocessing.cpu_count())
    arguments = parser.parse_args()
    chosen = cases(short=arguments.short)
    with multiprocessing.Pool(min(arguments.workers, len(chosen))) as pool:
        results = list(tqdm(pool.imap(run, chosen), total=len(chosen), unit=" valves", disable=None))
    return show(rows(results))


if __name__ == "__main__":
    sys.exit(main())
