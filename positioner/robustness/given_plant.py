"""The robustness test on one given plant: a preset, a plant file, or one with its own physics. Shell: reads files.

The plant stays what it is: nothing inside it is drawn, for physics of others have no such parameters. Drawn are the
period, the noise of the sensor, the setpoints, and what the positioner is told.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from plant_emulator.plants import complete_tables, plant_named
from plant_emulator.presets import root_preset
from positioner.bench.inprocess import configure
from positioner.bench.own_plant import on_own_plant
from positioner.bench.scenario import Scenario
from positioner.errors import UsageError
from positioner.robustness.cases import ROOT, base_of

if TYPE_CHECKING:
    from positioner.robustness.cases import Base


def base_of_plant(name: str) -> Base:
    """Return what is drawn around the plant of that name.

    Raises:
        ConfigurationError: there is no such plant, or a value of it is wrong.
        UsageError: it changes by schedule: then no two dwells are on the same plant.
    """
    settings = plant_named(name)
    if settings.schedule:
        raise UsageError(f"--plant {name}: [[schedule]] changes it while it is played: leave that out")
    tables = complete_tables(settings) | {"preset": root_preset(settings.preset or ROOT)}
    told = on_own_plant(Scenario(name="given", title="given", setpoints_mm=(0.0,), dwell_s=1.0), settings)
    base = base_of(configure(told))
    own = {key: value for key, value in (base.own or {}).items() if key != "noise_of_reading"}
    start = replace(base.nominal.valve, initial_position_m=settings.valve.initial_position_m)
    nominal = replace(base.nominal, valve=start)
    return replace(base, nominal=nominal, own=own, control={}, period_s=None, plant=tables)
