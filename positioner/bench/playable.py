"""Scenarios that a bench or a league refuses: setpoints that no law can serve, contradictory valves. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.presets import DEFAULT_PRESET, plant_settings, root_preset
from positioner.errors import ConfigurationError, Problem
from positioner.wire.formats import EncodingError
from positioner.wire.messages import Setpoint

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from plant_emulator.parameters import PlantSettings
    from positioner.bench.scenario import Scenario
    from positioner.config.schema import Configuration

LOOP_LOW_MA, LOOP_HIGH_MA = 4.0, 20.0
_MOST_NAMED = 20
_GEOMETRY = ("span_m", "travel_min_m", "travel_max_m")
"""Keys in which plant and controller must agree: they can be read off the valve itself."""


def restartable_mm(
    settings: PlantSettings, low_ma: float = LOOP_LOW_MA, high_ma: float = LOOP_HIGH_MA
) -> tuple[float, float]:
    """Return the range in mm from which `low_ma` to `high_ma` move the stem both ways: K x + F_0 ± F_s within B·u."""
    static_n = settings.valve.static_friction_n * (1.0 + settings.stochastic.friction_fraction)
    return _balanced_mm(settings, static_n, low_ma, high_ma)


def slidable_mm(settings: PlantSettings) -> tuple[float, float]:
    """Return the range in mm to which the lowest and the highest current let a stem slide: K x + F_0 ± F_c = B·u."""
    return _balanced_mm(settings, settings.valve.coulomb_friction_n, LOOP_LOW_MA, LOOP_HIGH_MA)


def _balanced_mm(settings: PlantSettings, friction_n: float, low_ma: float, high_ma: float) -> tuple[float, float]:
    """Return the range in mm in which K x + F_0 and this friction either way lie within B·u.

    K and F_0 are those of spring and process together, and the supply may end below `high_ma`.
    """
    valve, process = settings.valve, settings.process
    gain = valve.diaphragm_area_m2 * valve.pressure_gain_pa_per_ma
    if settings.actuator.supply_pa > 0.0:
        high_ma = min(high_ma, settings.actuator.supply_pa / valve.pressure_gain_pa_per_ma)
    preload_n = valve.bench_set_n + process.force_n
    spring_n_per_m = valve.spring_rate_n_per_m + process.gradient_n_per_m
    low = (gain * low_ma - preload_n + friction_n) / spring_n_per_m
    high = (gain * high_ma - preload_n - friction_n) / spring_n_per_m
    return max(low, valve.travel_min_m) * 1e3, min(high, valve.travel_max_m) * 1e3


def within_reach(settings: PlantSettings, parts: tuple[float, ...]) -> tuple[float, ...]:
    """Return the places in mm at `parts` (0 to 1) of the range from which the plant can be restarted both ways."""
    low_mm, high_mm = restartable_mm(settings)
    return tuple(round(low_mm + part * (high_mm - low_mm), 3) for part in parts)


def setpoint_problems(
    setpoints_mm: Iterable[float],
    name: str,
    settings: PlantSettings,
    low_ma: float = LOOP_LOW_MA,
    high_ma: float = LOOP_HIGH_MA,
) -> Iterator[Problem]:
    """Yield a problem for each setpoint from which the plant `name` cannot be restarted: no law can serve it.

    Of many such setpoints only the lowest and the highest are named.
    """
    low_mm, high_mm = restartable_mm(settings, low_ma, high_ma)
    loop = f"{low_ma:g} to {high_ma:g} mA restart {name} both ways"
    bad = [each for each in dict.fromkeys(setpoints_mm) if not low_mm <= each <= high_mm]
    if len(bad) > _MOST_NAMED:  # of a moving setpoint the ends say all
        bad = sorted({min(bad), max(bad)})
    for setpoint_mm in bad:
        text = f"{loop} from {low_mm:.1f} to {high_mm:.1f} mm only" if low_mm <= high_mm else f"{loop} from nowhere"
        if low_mm <= 1e3 * setpoint_mm <= high_mm:
            text += f"; setpoints are in mm: {1e3 * setpoint_mm:g}?"
        yield Problem(f"setpoint {setpoint_mm:g} mm", None, text)


def check_playable(scenario: Scenario, configuration: Configuration, *, beyond_reach: bool = False) -> PlantSettings:
    """Return the plant of `scenario`, which the positioner of `configuration` is to control.

    beyond_reach: setpoints from which the plant cannot be restarted are played, too.

    Raises:
        ConfigurationError: the plant's parameters are wrong, the positioner is configured for another valve, or the
            plant cannot be restarted from a setpoint within the guard's currents.
    """
    plant, guard = plant_settings(overrides=scenario.plant), configuration.guard
    problems = [*_contradictions(scenario, plant, configuration)]
    name = plant.preset or "the plant"
    if not beyond_reach:
        problems += setpoint_problems(scenario.setpoints_mm, name, plant, guard.current_low_ma, guard.current_high_ma)
    problems += _unsent(scenario, configuration)
    if problems:
        raise ConfigurationError(scenario.name, tuple(problems))
    return plant


def _unsent(scenario: Scenario, configuration: Configuration) -> Iterator[Problem]:
    """Yield a problem for each setpoint that the setpoint frame of the user's DBC cannot carry."""
    codec = configuration.make_codec()
    for setpoint_mm in dict.fromkeys(scenario.setpoints_mm):
        try:
            codec.encode(Setpoint(setpoint_mm * 1e-3), 0)
        except EncodingError as error:
            yield Problem(f"setpoint {setpoint_mm:g} mm", None, f"does not fit the setpoint frame: {error}")


def _contradictions(scenario: Scenario, plant: PlantSettings, configuration: Configuration) -> Iterator[Problem]:
    own = root_preset(plant.preset or DEFAULT_PRESET)
    configured = scenario.valve.get("preset", own)
    if configured != own:
        text = f"the plant is {own!r}; leave it out, and [valve] follows the plant"
        yield Problem(f"valve.preset = {configured!r}", None, text)
        return
    for key in _GEOMETRY:
        theirs, ours = getattr(plant.valve, key), getattr(configuration.valve, key)
        if not math.isclose(theirs, ours, rel_tol=1e-9, abs_tol=1e-9):
            text = f"contradicts plant.valve.{key} = {theirs:g}: give both the same"
            yield Problem(f"valve.{key} = {ours:g}", None, text)
