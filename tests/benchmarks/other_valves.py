"""The law `nmpc` on valves that are not as configured, and on sensors that are worse: a table of conditions.

python -m benchmarks.other_valves [--dwells N] [--dwell S] [--seeds A,B] [--only "NAME[;NAME...]"]
    [--without-table] [--restarts-every N]

Each run plays the law and the plant without frames. The noise is made here, around a plant with a perfect sensor. The
setpoints are drawn from the range in which the plant itself, not the believed valve, can be restarted both ways.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, field
from dataclasses import replace as changed
from statistics import fmean
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from plant_emulator import valve
from plant_emulator.presets import plant_settings
from plant_emulator.sensor_settings import SensorSettings
from positioner.bench.inprocess import configure
from positioner.bench.metrics import Trace, dwell_metrics
from positioner.bench.scenario import Scenario
from positioner.laws.law import Observation
from positioner.valve.credible import Limits
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from plant_emulator.parameters import PlantSettings
    from positioner.bench.metrics import DwellMetrics


@dataclass(frozen=True)
class Noise:
    """What the sensor adds: σ as a part of the reading, its correlation from sample to sample, and how long it holds.

    outliers: the part of the readings that are off by `outlier_m` to either side. step_m: of the quantisation.
    """

    of_reading: float = 0.02
    correlation: float = 0.0
    held: int = 1
    outliers: float = 0.0
    outlier_m: float = 0.02
    step_m: float = 0.0


class Sensor:
    """The readings of one run."""

    def __init__(self, noise: Noise, seed: int) -> None:
        """Begin with a noise in its steady state."""
        self.noise, self.random, self.count = noise, np.random.default_rng(seed), 0
        self.unit = float(self.random.normal())

    def read(self, position_m: float) -> float:
        """Return the reading of a stem at `position_m`."""
        noise, draw, by = self.noise, self.random, self.noise.correlation
        if self.count % noise.held == 0:
            self.unit = by * self.unit + math.sqrt(1.0 - by * by) * float(draw.normal())
        self.count += 1
        read_m = position_m * (1.0 + noise.of_reading * self.unit)
        if noise.outliers and draw.random() < noise.outliers:
            read_m += float(draw.choice((-1.0, 1.0))) * noise.outlier_m
        return round(read_m / noise.step_m) * noise.step_m if noise.step_m else read_m


@dataclass(frozen=True)
class Condition:
    """One row of the table: a plant, its sensor, and by how many samples its actuator is late.

    late: each number of samples is as probable as the others; the echo tells which command acted. initial_m: where the
    stem rests at first, None for the preset's place. lag_s: of the actuator, which nobody tells the law; told_of_span:
    σ that the law is told of the sensor, as a part of the span, None for 2 % of the reading.
    """

    name: str
    preset: str = "paper"
    spring: float = 1.0
    friction: float = 1.0
    noise: Noise = field(default_factory=Noise)
    late: tuple[int, ...] = (0,)
    period_s: float = 0.001
    initial_m: float | None = None
    lag_s: float = 0.0
    told_of_span: float | None = None

    @property
    def plant(self) -> PlantSettings:
        """The plant, with a perfect sensor."""
        own = plant_settings(self.preset)
        stem = own.valve
        return changed(
            own,
            valve=changed(
                stem,
                spring_rate_n_per_m=self.spring * stem.spring_rate_n_per_m,
                static_friction_n=self.friction * stem.static_friction_n,
                coulomb_friction_n=self.friction * stem.coulomb_friction_n,
                initial_position_m=stem.initial_position_m if self.initial_m is None else self.initial_m,
            ),
            actuator=changed(own.actuator, fill_time_constant_s=self.lag_s, vent_time_constant_s=self.lag_s),
            sensor=SensorSettings(),
        )

    @property
    def told(self) -> dict[str, float]:
        """The `[estimator]` table of the law."""
        of_span = self.told_of_span
        return {} if of_span is None else {"noise_of_reading": 0.0, "noise_of_span": of_span}


_SHORT_S = 1e-3

CONDITIONS = (
    Condition("nominal"),
    Condition("spring -25 %", spring=0.75),
    Condition("spring -25 %, 115 mm", spring=0.75, initial_m=0.115),
    Condition("spring +25 %", spring=1.25),
    Condition("spring +25 %, 50 mm", spring=1.25, initial_m=0.05),
    Condition("friction -25 %", friction=0.75),
    Condition("friction +25 %", friction=1.25),
    Condition("stochastic", preset="stochastic"),
    Condition("AR(0.9)", noise=Noise(correlation=0.9)),
    Condition("AR(0.99)", noise=Noise(correlation=0.99)),
    Condition("held 10", noise=Noise(held=10)),
    Condition("outliers 1 %", noise=Noise(outliers=0.01)),
    Condition("outliers 4 %", noise=Noise(outliers=0.04)),
    Condition("no noise", noise=Noise(0.0)),
    Condition("0.5 % noise", noise=Noise(0.005)),
    Condition("4 % noise", noise=Noise(0.04)),
    Condition("quantised 0.1 mm", noise=Noise(0.0, step_m=1e-4)),
    Condition("quantised 0.5 mm", noise=Noise(0.0, step_m=5e-4)),
    Condition("late 1", late=(1,)),
    Condition("late 2", late=(2,)),
    Condition("late 0-1", late=(0, 1)),
    Condition("late 1-2", late=(1, 2)),
    Condition("5 ms", period_s=0.005),
    Condition("10 ms", period_s=0.01),
    Condition("20 ms", period_s=0.02),
    Condition("10 ms no noise", period_s=0.01, noise=Noise(0.0)),
    Condition("20 ms no noise", period_s=0.02, noise=Noise(0.0)),
    Condition("0.1 ms", period_s=0.0001),
    Condition("0.1 ms spring -25 %", period_s=0.0001, spring=0.75),
    Condition("0.1 ms late 1", period_s=0.0001, late=(1,)),
    Condition("0.1 ms late 2", period_s=0.0001, late=(2,)),
)
SHORT = tuple(each.name for each in CONDITIONS if each.period_s >= _SHORT_S)
_LOW_MA, _HIGH_MA = 4.0, 20.0
_SMALL_STEP = 2
_BORDER = 0.01
"""Part of the restartable range that is left out at each end."""


def setpoints_m(plant: PlantSettings, count: int, seed: int) -> tuple[float, ...]:
    """Return setpoints from which the plant can be restarted in both directions, one in three of them a small step."""
    own = plant.valve
    gain = own.diaphragm_area_m2 * own.pressure_gain_pa_per_ma
    most = 1.0 + plant.stochastic.friction_fraction
    low_m = (gain * _LOW_MA - own.bench_set_n + most * own.static_friction_n) / own.spring_rate_n_per_m
    high_m = (gain * _HIGH_MA - own.bench_set_n - most * own.static_friction_n) / own.spring_rate_n_per_m
    low_m, high_m = max(low_m, own.travel_min_m), min(high_m, own.travel_max_m)
    edge_m, draw = _BORDER * (high_m - low_m), np.random.default_rng(1000 + seed)
    low_m, high_m = low_m + edge_m, high_m - edge_m
    found: list[float] = []
    for index in range(count):
        wanted_m = float(draw.uniform(low_m, high_m))
        if index % 3 == _SMALL_STEP:
            wanted_m = min(max(found[-1] + float(draw.uniform(-0.02, 0.02)) * own.span_m, low_m), high_m)
        found.append(wanted_m)
    return tuple(found)


def play(
    condition: Condition, seed: int, dwells: int, dwell_s: float, *, uses_table: bool, restarts_every: int = 0
) -> Iterator[tuple[DwellMetrics, int]]:
    """Yield the figures of each dwell, and the moves in it.

    The law starts anew after so many dwells, 0 for never.
    """
    plant, period_s = condition.plant, condition.period_s
    control = {} if uses_table else {"table_from_s": 1e6}
    scenario = Scenario(
        name="other-valve",
        title=condition.name,
        law="nmpc",
        sample_period_s=period_s,
        setpoints_mm=(80.0,),
        dwell_s=dwell_s,
        plant={"preset": condition.preset},
        control=control,
        estimator=condition.told,
    )
    configuration = configure(scenario)
    law, limits, span_m = configuration.make_law(), Limits(configuration.valve), configuration.valve.span_m
    table = StictionTable()
    state, sensor, draw = valve.initial_state(plant, seed), Sensor(condition.noise, seed), np.random.default_rng(seed)
    memory: Any = None
    samples, begun_m = round(dwell_s / period_s), setpoints_m(plant, dwells, seed)
    # what was commanded; the first commands that act are the current that balances the spring
    sent: list[float] = []
    acting, control_s = -1, 0.0
    applied_ma = configuration.valve.balance_current_ma(state.stem.position_m)
    here_m = state.stem.position_m
    for dwell, setpoint_m in enumerate(begun_m):
        if restarts_every and dwell % restarts_every == 0:
            memory, control_s = None, 0.0
        positions, currents, moves = np.zeros(samples + 1), np.zeros(samples + 1), 0
        positions[0], currents[0] = here_m, applied_ma
        for sample in range(samples):
            measured_m = round(sensor.read(state.stem.position_m) / 1e-8) * 1e-8
            if memory is None:
                memory = law.begin(measured_m)
            observation = Observation(measured_m, applied_ma, period_s, setpoint_m, control_s)
            memory, estimate = law.estimate(memory, observation)
            for lesson in estimate.lessons:
                if control_s and limits.allows(lesson, table.cell_width_m / 2.0):
                    table = table.record(lesson.quantity, lesson.position_m, lesson.direction, lesson.value)
            memory, decision = law.decide(memory, estimate.stem, observation, table)
            moves += decision.reason is not None
            sent.append(min(max(decision.current_ma, _LOW_MA), _HIGH_MA))
            control_s += period_s
            acting = max(acting, len(sent) - 1 - int(draw.choice(condition.late)))
            applied_ma = sent[acting] if acting >= 0 else applied_ma
            state = valve.step(plant, state, applied_ma, period_s)
            positions[sample + 1], currents[sample + 1] = state.stem.position_m, applied_ma
        here_m = state.stem.position_m
        trace = Trace(
            time_s=np.arange(samples + 1, dtype=np.float64) * np.float64(period_s),
            position_m=positions,
            setpoint_m=np.full(samples + 1, setpoint_m),
            current_ma=currents,
        )
        yield dwell_metrics(trace, (0.0, dwell_s), span_m)[0], moves


def row(
    condition: Condition, seeds: tuple[int, ...], dwells: int, dwell_s: float, *, uses_table: bool, restarts_every: int
) -> str:
    """Return the figures of a condition."""
    each: list[tuple[DwellMetrics, int]] = []
    for seed in seeds:
        one = play(condition, seed, dwells // len(seeds), dwell_s, uses_table=uses_table, restarts_every=restarts_every)
        each += one
    figures = [dwell for dwell, _ in each]
    errors = sorted(dwell.mean_abs_error_pct for dwell in figures)
    return (
        f"{condition.name:20} {fmean(errors):7.3f} {errors[int(0.95 * len(errors))]:7.3f} {errors[-1]:7.2f} "
        f"{sum(dwell.settle_1pct_s is None for dwell in figures):5d} {sum(dwell.limit_cycle for dwell in figures):6d} "
        f"{fmean(moves for _, moves in each):6.2f} {max(moves for _, moves in each):5d}"
    )


def main() -> None:
    """Print the table of the conditions."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.other_valves", description=__doc__)
    parser.add_argument("--dwells", type=int, default=80)
    parser.add_argument("--dwell", type=float, default=1.5)
    parser.add_argument("--seeds", default="1,2")
    parser.add_argument("--only", default=";".join(SHORT))
    parser.add_argument("--without-table", action="store_true")
    parser.add_argument("--restarts-every", type=int, default=0)
    given = parser.parse_args()
    names = [name.strip() for name in given.only.split(";")]
    seeds = tuple(int(seed) for seed in given.seeds.split(","))
    sys.stdout.write("condition             mean %   95 %   worst  unset cycles  moves  most\n")
    for condition in tqdm([each for each in CONDITIONS if each.name in names], leave=False, disable=None):
        uses_table, every = not given.without_table, given.restarts_every
        figures = row(condition, seeds, given.dwells, given.dwell, uses_table=uses_table, restarts_every=every)
        sys.stdout.write(figures + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
