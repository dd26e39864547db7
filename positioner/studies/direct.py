"""The closed loop of law and plant without frames: the figures of `inprocess`, several times as fast. Pure.

Readings, setpoints and currents are rounded as frames round them, so the figures are the same to the bit. The stiction
table stays empty: use this only for laws that neither use the table nor learn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from plant_emulator import sensor, valve
from positioner.bench.inprocess import configure
from positioner.bench.metrics import Trace, dwell_metrics
from positioner.bench.playable import check_playable
from positioner.laws.law import Observation
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import ActuatorState, CurrentCommand, PlantTruth, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from positioner.bench.metrics import DwellMetrics
    from positioner.bench.scenario import Scenario
    from positioner.wire.codec import Codec
    from positioner.wire.messages import Message


def play_directly(scenario: Scenario) -> Iterator[DwellMetrics]:
    """Yield the figures of every dwell of `scenario`, each at the end of the dwell.

    Raises:
        ConfigurationError: the scenario's tables do not make a valve or a positioner.
    """
    configuration = configure(scenario)
    law = configuration.make_law(plays=True)
    settings = check_playable(scenario, configuration)
    codec = configuration.make_codec()
    as_reading, as_truth = _rounding(codec, StemPosition, "position_m"), _rounding(codec, PlantTruth, "position_m")
    as_setpoint, as_command = _rounding(codec, Setpoint, "setpoint_m"), _rounding(codec, CurrentCommand, "current_ma")
    as_pressure = _rounding(codec, ActuatorState, "pressure_pa")
    low_ma, high_ma = configuration.guard.current_low_ma, configuration.guard.current_high_ma
    period_s = scenario.sample_period_s
    samples = scenario.samples_per_dwell * len(scenario.visited_mm)
    trace = Trace(
        time_s=np.arange(samples, dtype=np.float64) * np.float64(period_s),
        position_m=np.zeros(samples),
        setpoint_m=np.repeat(np.array(scenario.visited_mm) * 1e-3, scenario.samples_per_dwell),
        current_ma=np.zeros(samples),
    )
    table = StictionTable()
    plant = valve.initial_state(settings, scenario.seed)
    memory, applied_ma, control_s = None, 0.0, 0.0
    for dwell, setpoint_mm in enumerate(scenario.visited_mm):
        setpoint_m = as_setpoint(setpoint_mm * 1e-3)
        for sample in range(dwell * scenario.samples_per_dwell, (dwell + 1) * scenario.samples_per_dwell):
            plant, raw_m = valve.measure(settings, plant)
            measured_m = as_reading(raw_m)
            if memory is None:
                memory, applied_ma = law.begin(measured_m), configuration.valve.balance_current_ma(measured_m)
            pressure_pa = None
            if settings.sensor.reports_pressure:
                pressure_pa = as_pressure(sensor.pressure_pa(settings, plant.sensor, plant.actuator.pressure_pa))
            observation = Observation(
                measured_m, applied_ma, period_s, setpoint_m, control_s, pressure_pa, pressure_pa is not None
            )
            memory, estimate = law.estimate(memory, observation)
            memory, decision = law.decide(memory, estimate.stem, observation, table)
            applied_ma = min(max(decision.current_ma, low_ma), high_ma)
            control_s += period_s
            trace.position_m[sample] = as_truth(plant.stem.position_m)
            trace.current_ma[sample] = as_command(applied_ma)
            plant = valve.step(settings, plant, as_command(applied_ma), period_s)
        yield dwell_metrics(trace, scenario.dwell_edges_s[dwell : dwell + 2], configuration.valve.span_m)[0]


def _rounding(codec: Codec, kind: type[Message], name: str) -> Callable[[float], float]:
    """Return the function that rounds a value to the resolution of field `name` in the frame of `kind`."""
    form = next(form for form in codec.by_kind[kind].fields if form.name == name)

    def rounded(value: float) -> float:
        return round((value - form.si_offset) / form.si_per_bit) * form.si_per_bit + form.si_offset

    return rounded
