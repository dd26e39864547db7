"""An emulated valve, identified in memory: `positioner identify` without bus, frames and guard. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator import valve
from positioner.commissioning.experiment import Experiment
from positioner.commissioning.identify import IdentifyError, identify
from positioner.commissioning.procedure import ProcedureLimits
from positioner.guard.settings import GuardSettings
from positioner.laws.law import Observation

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from positioner.commissioning.experiment import IdentifyMemory
    from positioner.commissioning.identified import IdentifiedValve
    from positioner.valve.parameters import ValveParameters

_LONGEST_S = 400.0


def identify_plant(
    settings: PlantSettings, believed: ValveParameters, seed: int = 1, period_s: float = 0.001
) -> IdentifiedValve:
    """Return what `positioner identify` finds out about the plant `settings`, whose noise has `seed`.

    `believed` is the valve as it is configured before: its geometry, mass, and force per mA.

    Raises:
        IdentifyError: the experiment was aborted, or shows too little.
    """
    limits = ProcedureLimits.of(believed, GuardSettings())
    memory, _ = experiment_on(settings, Experiment.of(believed, limits, period_s), seed)
    if memory.aborted:
        raise IdentifyError(memory.aborted)
    return identify(memory.stretches, believed, limits, period_s)


def experiment_on(settings: PlantSettings, experiment: Experiment, seed: int) -> tuple[IdentifyMemory, float]:
    """Return the memory of the experiment at its end, and the plant time in s that it took.

    Raises:
        IdentifyError: it does not end.
    """
    period_s = experiment.period_s
    plant, measured_m = valve.measure(settings, valve.initial_state(settings, seed))
    memory = experiment.begin(measured_m)
    applied_ma, time_s = memory.state.current_ma, 0.0
    while not memory.ended:
        pressure_pa = plant.actuator.pressure_pa if settings.sensor.reports_pressure else None
        observation = Observation(measured_m, applied_ma, period_s, measured_m, time_s, pressure_pa)
        memory, applied_ma = experiment.advance(memory, observation)
        plant, measured_m = valve.measure(settings, valve.step(settings, plant, applied_ma, period_s))
        time_s += period_s
        if time_s > _LONGEST_S:
            raise IdentifyError(f"the experiment has not ended after {_LONGEST_S:g} s: {memory.number}")
    return memory, time_s
