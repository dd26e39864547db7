"""The plants that laws are judged on, and where on them a setpoint is fair. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from plant_emulator.presets import plant_settings
from positioner.errors import ConfigurationError, Problem

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

LOOP_LOW_MA, LOOP_HIGH_MA = 4.0, 20.0


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


def restartable_mm(settings: PlantSettings) -> tuple[float, float]:
    """Return the range in mm from which 4 to 20 mA can start the stem both ways: K x + F_0 ± F_s within B·u."""
    valve = settings.valve
    gain = valve.diaphragm_area_m2 * valve.pressure_gain_pa_per_ma
    friction_n = valve.static_friction_n * (1.0 + settings.stochastic.friction_fraction)
    low = (gain * LOOP_LOW_MA - valve.bench_set_n + friction_n) / valve.spring_rate_n_per_m
    high = (gain * LOOP_HIGH_MA - valve.bench_set_n - friction_n) / valve.spring_rate_n_per_m
    return max(low, valve.travel_min_m) * 1e3, min(high, valve.travel_max_m) * 1e3


def check_setpoints(setpoints_mm: tuple[float, ...], conditions: tuple[Condition, ...]) -> None:
    """Refuse setpoints from which some plant cannot be restarted: a law would be judged on what no law can do.

    Raises:
        ConfigurationError: with a line for each setpoint and the plant that rules it out.
    """
    problems = []
    for setpoint in setpoints_mm:
        for condition in conditions:
            low, high = restartable_mm(condition.settings)
            if not low <= setpoint <= high:
                told = f"4 to 20 mA restart {condition.name} both ways from {low:.1f} to {high:.1f} mm only"
                problems.append(Problem(f"setpoint {setpoint:g} mm", None, told))
    if problems:
        raise ConfigurationError("league", tuple(problems))
