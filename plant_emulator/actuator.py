"""I/P converter and diaphragm: loop current in, pressure out; eq. 10, delayed by a dead time and a first-order lag.

Pure. The dead time is a queue of command edges with the instants at which they take effect, so that it is exact
whatever the steps are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from plant_emulator.oscillator import PushingForce

if TYPE_CHECKING:
    from plant_emulator.parameters import ActuatorSettings


_ROUNDING_S = 1e-12
"""An edge this close to the end of a step belongs to the next one, however the instants were rounded."""


@dataclass(frozen=True, slots=True)
class AirLine:
    """Current that acts now, and the commands on their way: (instant in s, current in mA), oldest first."""

    current_ma: float
    pending: tuple[tuple[float, float], ...] = ()

    @property
    def newest_ma(self) -> float:
        """The current that was commanded last, arrived or not."""
        return self.pending[-1][1] if self.pending else self.current_ma


def commanded(
    line: AirLine, dead_time_s: float, current_ma: float, start_s: float, duration_s: float
) -> tuple[AirLine, tuple[tuple[float, float], ...]]:
    """Return the line after `current_ma` was held for `duration_s`, and what acted meanwhile: (current, seconds)."""
    if dead_time_s == 0.0 or (not line.pending and line.current_ma == current_ma):
        acted = ((current_ma, duration_s),)
        return (line if line.current_ma == current_ma else AirLine(current_ma)), acted
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
    return AirLine(acting_ma, pending[arrived:]), tuple(stretches)


def pushing_force(actuator: ActuatorSettings, area_m2: float, pressure_pa: float, target_pa: float) -> PushingForce:
    """Return the force on the diaphragm while the pressure settles from `pressure_pa` to `target_pa`."""
    filling = target_pa > pressure_pa
    time_constant_s = actuator.fill_time_constant_s if filling else actuator.vent_time_constant_s
    if time_constant_s == 0.0 or target_pa == pressure_pa:
        return PushingForce(area_m2 * target_pa)
    return PushingForce(area_m2 * target_pa, area_m2 * (pressure_pa - target_pa), 1.0 / time_constant_s)
