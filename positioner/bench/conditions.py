"""The plants that laws are judged on, and where on them a setpoint is fair. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from plant_emulator.presets import plant_settings
from positioner.bench.playable import setpoint_problems
from positioner.errors import ConfigurationError

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings


@dataclass(frozen=True, slots=True)
class Condition:
    """A plant under a name: a preset and what is laid over it. The controller always believes in the nominal one."""

    name: str
    overrides: dict[str, Any] = field(default_factory=dict)

    @property
    def settings(self) -> PlantSettings:
        """The plant."""
        return plant_settings(overrides=self.overrides)


_NOMINAL = plant_settings("paper").valve
CONDITIONS = (
    Condition("nominal", {"preset": "paper"}),
    Condition("spring-10", {"preset": "spring-10"}),
    Condition("spring-20", {"preset": "spring-20"}),
    Condition(
        "friction-10",
        {
            "preset": "paper",
            "valve": {
                "static_friction_n": 0.9 * _NOMINAL.static_friction_n,
                "coulomb_friction_n": 0.9 * _NOMINAL.coulomb_friction_n,
                "viscous_friction_n_s_per_m": 0.9 * _NOMINAL.viscous_friction_n_s_per_m,
            },
        },
    ),
    Condition("friction-20", {"preset": "friction-20"}),
    Condition("friction+10", {"preset": "friction+10"}),
    Condition("friction+20", {"preset": "friction+20"}),
    Condition("stochastic", {"preset": "stochastic"}),
    Condition("noise-free", {"preset": "paper", "sensor": {"noise_of_reading": 0.0}}),
)


def check_setpoints(setpoints_mm: tuple[float, ...], conditions: tuple[Condition, ...]) -> None:
    """Refuse setpoints from which some plant cannot be restarted: a law would be judged on what no law can do.

    Raises:
        ConfigurationError: with a line for each setpoint and the plant that rules it out.
    """
    problems = [
        problem
        for condition in conditions
        for problem in setpoint_problems(setpoints_mm, condition.name, condition.settings)
    ]
    if problems:
        raise ConfigurationError("league", tuple(problems))
