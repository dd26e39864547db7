"""What the laws of the league on real valves know of a plant: what `positioner identify` finds out about it. Pure.

Before the identification the positioner believes in the nominal valve, without lag.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from plant_emulator.presets import DEFAULT_PRESET, plant_settings, root_preset
from positioner.bench.configure import told
from positioner.studies.identified_plant import identify_plant
from positioner.studies.real_valves.valves import NOISES, plant_tables
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from collections.abc import Mapping

SEED = 301
"""Of the noise and of the friction during the identification."""


@dataclass(frozen=True, slots=True)
class Identification:
    """One plant with one lag and noise, identified once for all laws and seeds."""

    plant: str
    lag_s: float
    noise: str
    period_s: float

    @property
    def law(self) -> str:
        """What moves the valve."""
        return "identify"

    @property
    def title(self) -> str:
        """What the progress bar shows."""
        return f"identify {self.plant}, lag {self.lag_s * 1e3:g} ms, noise {self.noise} %"

    @property
    def key(self) -> str:
        """Name of the result file."""
        return f"identify-{self.plant}-{self.lag_s * 1e3:g}ms-{self.noise}-{self.period_s * 1e3:g}ms"


def identify(item: Identification) -> dict[str, Any]:
    """Return the values of `[valve]` and `[estimator]`, as a positioner has them after the identification."""
    settings = plant_settings(overrides=plant_tables(item.plant, item.lag_s, item.noise, {}))
    nominal = told(plant_settings(root_preset(settings.preset or DEFAULT_PRESET)))
    believed = ValveParameters(id="identify", **{**nominal, "actuator": ActuatorParameters()})
    found = identify_plant(settings, believed, SEED, item.period_s)
    valve = {key: value for key, value in asdict(found.laid_over(believed)).items() if key != "id"}
    return {"valve": valve, "estimator": {**NOISES[item.noise], **found.tables()["estimator"]}}


def as_text(known: Mapping[str, Any]) -> str:
    """Return the values as a bout carries them."""
    return json.dumps(known, sort_keys=True)
