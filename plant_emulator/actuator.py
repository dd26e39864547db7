"""I/P converter and diaphragm: loop current in, force on the stem out; eq. 10 with a dead time and lags. Pure.

The dead time is a queue of commands with the instants at which they take effect, so it is exact for any length of the
steps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator import converter
from plant_emulator.chamber import phases
from plant_emulator.converter import Converted
from plant_emulator.force import PushingForce
from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings


_ROUNDING_S = 1e-12
"""An edge this close to the end of a step belongs to the next step, however the instants were rounded."""


@dataclass(frozen=True, slots=True)
class DelayLine:
    """The current that acts now, and the delayed commands: (instant in s, current in mA), oldest first."""

    current_ma: float
    pending: tuple[tuple[float, float], ...] = ()

    @property
    def newest_ma(self) -> float:
        """The current of the newest command, whether it acts already or not."""
        return self.pending[-1][1] if self.pending else self.current_ma


@dataclass(frozen=True, slots=True, kw_only=True)
class Actuator:
    """The pressures on the diaphragm and behind the I/P converter, and the commands on their way to them.

    pressure_pa: in a double-acting actuator, by how much that of the pushing chamber is above `opposing_pa`.
    """

    pressure_pa: float
    converter_pa: float
    converted: Converted
    line: DelayLine
    opposing_pa: float = 0.0


def initial_actuator(settings: PlantSettings, pressure_pa: float) -> Actuator:
    """Return an actuator that holds `pressure_pa`."""
    passed_ma = pressure_pa / settings.valve.pressure_gain_pa_per_ma
    return _settled(settings, pressure_pa, passed_ma, passed_ma - settings.actuator.offset_ma)


def held_actuator(settings: PlantSettings, current_ma: float) -> Actuator:
    """Return an actuator that has settled under `current_ma`."""
    passed_ma = converter.shifted_ma(settings.actuator, current_ma)
    return _settled(settings, converter.pressure_pa(settings, passed_ma), passed_ma, current_ma)


def opposing_target_pa(settings: PlantSettings, commanded_pa: float) -> float:
    """Return the pressure that the opposing chamber is to have, for a net pressure of `commanded_pa`."""
    return 0.5 * (settings.actuator.supply_pa - commanded_pa) if settings.chamber.double_acting else 0.0


def _settled(settings: PlantSettings, pressure_pa: float, passed_ma: float, current_ma: float) -> Actuator:
    return Actuator(
        pressure_pa=pressure_pa,
        converter_pa=pressure_pa,
        converted=Converted(passed_ma, passed_ma),
        line=DelayLine(current_ma),
        opposing_pa=opposing_target_pa(settings, pressure_pa),
    )


def driven(
    settings: PlantSettings, actuator: Actuator, current_ma: float, start_s: float, duration_s: float
) -> tuple[Actuator, tuple[tuple[PushingForce, float], ...]]:
    """Return the actuator after `current_ma` was commanded for `duration_s`, and its forces: (force, seconds) each."""
    area_m2, pressure_pa, converter_pa = settings.valve.diaphragm_area_m2, actuator.pressure_pa, actuator.converter_pa
    is_plain = settings.actuator.converter_time_constant_s == 0.0 and settings.actuator.slew_pa_per_s == 0.0
    line, stretches = commanded(actuator.line, settings.actuator.dead_time_s, current_ma, start_s, duration_s)
    converted, forces = actuator.converted, []
    for acting_ma, stretch_s in stretches:
        converted = converter.converted(settings.actuator, converted, acting_ma)
        target_pa = converter.pressure_pa(settings, converted.passed_ma)
        if is_plain:
            force = _force(settings, pressure_pa, target_pa)
            pressure_pa, converter_pa = force.at(stretch_s) / area_m2, target_pa
            forces.append((force, stretch_s))
            continue
        passed, pressure_pa, converter_pa = phases(settings.actuator, pressure_pa, converter_pa, target_pa, stretch_s)
        for phase in passed:
            decays = tuple([(area_m2 * deviation, rate) for deviation, rate in phase.decays])
            force = PushingForce(area_m2 * phase.final_pa, decays, area_m2 * phase.ramp_pa_per_s)
            forces.append((force, phase.duration_s))
    is_settled = pressure_pa == actuator.pressure_pa and converter_pa == actuator.converter_pa
    if is_settled and line is actuator.line and converted is actuator.converted:
        return actuator, tuple(forces)
    after = Actuator(pressure_pa=pressure_pa, converter_pa=converter_pa, converted=converted, line=line)
    return after, tuple(forces)


def commanded(
    line: DelayLine, dead_time_s: float, current_ma: float, start_s: float, duration_s: float
) -> tuple[DelayLine, tuple[tuple[float, float], ...]]:
    """Return the line after `current_ma` was held for `duration_s`, and what acted meanwhile: (current, seconds)."""
    if dead_time_s == 0.0 or (not line.pending and line.current_ma == current_ma):
        acted = ((current_ma, duration_s),)
        return (line if line.current_ma == current_ma else DelayLine(current_ma)), acted
    pending = line.pending
    if current_ma != line.newest_ma:
        pending = (*pending, (start_s + dead_time_s, current_ma))
    stretches = []
    now_s, end_s, acting_ma = start_s, start_s + duration_s, line.current_ma
    arrived = 0
    for instant_s, next_ma in pending:
        if instant_s >= end_s - _ROUNDING_S:
            break
        stretches.append((acting_ma, max(instant_s - now_s, 0.0)))
        now_s, acting_ma = max(instant_s, now_s), next_ma
        arrived += 1
    stretches.append((acting_ma, end_s - now_s))
    return DelayLine(acting_ma, pending[arrived:]), tuple(stretches)


def _force(settings: PlantSettings, pressure_pa: float, target_pa: float) -> PushingForce:
    """Return the force on the diaphragm while the pressure settles from `pressure_pa` to `target_pa`."""
    actuator, area_m2 = settings.actuator, settings.valve.diaphragm_area_m2
    filling = target_pa > pressure_pa
    time_constant_s = actuator.fill_time_constant_s if filling else actuator.vent_time_constant_s
    if time_constant_s == 0.0 or target_pa == pressure_pa:
        return PushingForce(area_m2 * target_pa)
    return PushingForce(area_m2 * target_pa, ((area_m2 * (pressure_pa - target_pa), 1.0 / time_constant_s),))
