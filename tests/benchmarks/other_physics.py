"""The presets of other physics: their speed beside Karnopp's, and what an identification and then a bench make of them.

python -m benchmarks.other_physics [--speed] [--bench] [--only PRESET,...]

--speed: microseconds of a period of 1 ms with frames (a command taken, the plant advanced, a position published), under
commands that change at random every 0.1 s; the median of five rounds. --bench: `identify` in memory, then eight
setpoints of the law `nmpc` with what it found.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import asdict
from statistics import median
from typing import Any

import numpy as np

from plant_emulator.device import advance, initial_device, publish, take
from plant_emulator.presets import plant_settings, root_preset
from positioner.bench.configure import told
from positioner.bench.inprocess import run_in_process
from positioner.bench.metrics import dwell_metrics
from positioner.bench.playable import within_reach
from positioner.bench.scenario import Scenario
from positioner.commissioning.identify import IdentifyError
from positioner.robustness.sets import OTHER_PHYSICS
from positioner.studies.identified_plant import identify_plant
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.wire.codec import make_codec
from positioner.wire.messages import CurrentCommand

_ROUNDS, _PERIODS = 5, 3000
_PARTS = (0.3, 0.7, 0.5, 0.55, 0.2, 0.8, 0.75, 0.4)
_SEED = 7


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _cycle_us(preset: str, lag_s: float) -> float:
    """Return the median time of a period in µs."""
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s} if lag_s else {}
    settings = plant_settings(preset, {"actuator": lags})
    codec, found = make_codec(), []
    for number in range(_ROUNDS):
        chance = np.random.default_rng(number)
        device, spent_s, current_ma = initial_device(settings, number), 0.0, 12.0
        for period in range(_PERIODS):
            if period % 100 == 0:
                current_ma = float(chance.uniform(5.0, 18.0))
            frame = codec.encode(CurrentCommand(current_ma), period)
            begun_s = time.perf_counter()
            device = take(codec, device, (frame,))
            device = advance(settings, device, 1e-3)
            device, _ = publish(codec, settings, device)
            spent_s += time.perf_counter() - begun_s
        found.append(spent_s / _PERIODS * 1e6)
    return median(found)


def _speed(presets: tuple[str, ...]) -> None:
    _say("| plant | lag | µs of a period with frames | Karnopp's | its speed over Karnopp's |")
    _say("|---|---|---|---|---|")
    for name in presets:
        root = root_preset(name)
        has_lag = plant_settings(name).actuator.model == "lag"
        for lag_s in (0.0, 0.05) if has_lag and root == "paper" else (0.0,):
            base_us, own_us = _cycle_us(root, lag_s), _cycle_us(name, lag_s)
            lag = f"{lag_s * 1e3:g} ms" if has_lag else "–"
            _say(f"| `{name}` | {lag} | {own_us:.1f} | {base_us:.1f} | {base_us / own_us:.2f} |")


def _played(preset: str, valve: dict[str, Any], estimator: dict[str, Any]) -> str:
    """Return mean and worst error of a bench."""
    settings = plant_settings(preset)
    dwell_s = 6.0 if settings.actuator.model == "mass-flow" else 3.0
    scenario = Scenario(
        name="other-physics",
        title=preset,
        law="nmpc",
        seed=_SEED,
        setpoints_mm=within_reach(settings, _PARTS),
        dwell_s=dwell_s,
        plant={"preset": preset},
        valve=valve,
        estimator=estimator,
    )
    recording = run_in_process(scenario).recording
    figures = dwell_metrics(recording.trace, scenario.dwell_edges_s, settings.valve.span_m)
    mean = sum(each.mean_abs_error_pct for each in figures) / len(figures)
    worst = max(figures, key=lambda each: each.mean_abs_error_pct)
    lost = sum(each.mean_abs_error_pct > 1.0 for each in figures)
    return f"{mean:.3f} | {worst.mean_abs_error_pct:.2f} at {worst.setpoint_mm:g} mm | {lost}"


def _bench(presets: tuple[str, ...]) -> None:
    _say("| plant | identify says | K | F_s | F_c | F_v | lag, ms | mean error | worst dwell | dwells above 1 % |")
    _say("|---|---|---|---|---|---|---|---|---|---|")
    for name in presets:
        settings, root = plant_settings(name), root_preset(name)
        nominal = told(plant_settings(root))
        believed = ValveParameters(id="identify", **{**nominal, "actuator": ActuatorParameters()})
        sensor = settings.sensor
        noise = {"noise_of_reading": sensor.noise_of_reading, "noise_of_span": sensor.noise_of_span}
        plain = {**nominal, "actuator": {}, "preset": root}
        _say(f"| `{name}` | not identified | | | | | told none | {_played(name, plain, noise)} |")
        try:
            found = identify_plant(settings, believed, _SEED)
        except IdentifyError as error:
            _say(f"| `{name}` | {error} | | | | | | | | |")
            continue
        says = "explains its record"
        if found.unexplained:
            says = "no result: " + ", ".join(
                dict.fromkeys(f"{each.kind} {each.phase}".strip() for each in found.unexplained)
            )
        pairs = (
            (found.spring_rate_n_per_m.value, settings.valve.spring_rate_n_per_m),
            (found.static_friction_n.value, settings.valve.static_friction_n),
            (found.coulomb_friction_n.value, settings.valve.coulomb_friction_n),
            (found.viscous_friction_n_s_per_m.value, settings.valve.viscous_friction_n_s_per_m),
        )
        off = " | ".join(f"{(value / true - 1.0) * 100.0:+.1f} %" for value, true in pairs)
        lag = f"{found.fill_time_constant_s.value * 1e3:.0f} / {found.vent_time_constant_s.value * 1e3:.0f}"
        valve = {key: value for key, value in asdict(found.laid_over(believed)).items() if key != "id"}
        figures = _played(name, {**valve, "preset": root}, {**noise, **found.tables()["estimator"]})
        _say(f"| `{name}` | {says} | {off} | {lag} | {figures} |")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.other_physics", description=__doc__)
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--bench", action="store_true")
    parser.add_argument("--only", type=lambda text: tuple(text.split(",")), default=OTHER_PHYSICS)
    options = parser.parse_args()
    if options.speed or not options.bench:
        _speed(options.only)
    if options.bench or not options.speed:
        _bench(options.only)


if __name__ == "__main__":
    main()
