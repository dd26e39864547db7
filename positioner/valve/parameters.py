"""The parameters of a valve as the controller knows them, and the forces that follow from them. Pure.

The controller shares no physics with the plant emulator.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.valve.actuator import ActuatorParameters


def id_problem(given: object) -> str:
    """Return why this is no id of a valve, empty where it is one: it is the name of a folder, and part of messages."""
    if isinstance(given, str) and re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", given):
        return ""
    return "must be 1 to 64 letters, digits, dots, dashes or underscores"


@dataclass(frozen=True, slots=True, kw_only=True)
class ValveParameters(SettingsTable):
    """Nominal parameters of the valve (paper Table 3), the `[valve]` table of a configuration.

    id: identity of the valve; the stiction table belongs to it.
    mass_kg: m, moving mass: plug, stem and diaphragm plate.
    diaphragm_area_m2: S_a, effective area of the diaphragm.
    pressure_gain_pa_per_ma: K_p of eq. 9, pressure per mA behind the I/P converter.
    spring_rate_n_per_m: K_m, rate of the actuator's spring.
    static_friction_n: F_s, the force that starts the stem.
    coulomb_friction_n: F_c, the force that keeps it going; never more than the static one.
    viscous_friction_n_s_per_m: F_v, friction that grows with the speed.
    stribeck_velocity_m_per_s: V_s, the speed at which the friction falls from F_s to F_c.
    stick_velocity_m_per_s: DV, below which the stem counts as resting.
    bench_set_n: spring force at position 0 (preload), 0 in the paper.
    span_m: the travel that is 100 % in errors and setpoints.
    travel_min_m, travel_max_m: the hard stops; setpoints beyond them are refused.
    sensor_time_constant_s: lag of the position reading; 0 is none.
    backlash_m: play between stem and position sensor.
    actuator: from the loop current to the pressure, the `[valve.actuator]` table.
    """

    id: str
    mass_kg: Annotated[float, Interval(ge=0.01, le=200.0)] = 1.361
    diaphragm_area_m2: Annotated[float, Interval(ge=1e-4, le=2.0)] = 0.06452
    pressure_gain_pa_per_ma: Annotated[float, Interval(ge=10.0, le=1e5)] = 0.75 * 6894.757
    spring_rate_n_per_m: Annotated[float, Interval(ge=100.0, le=1e8)] = 52538.0
    static_friction_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 1707.7
    coulomb_friction_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 1423.0
    viscous_friction_n_s_per_m: Annotated[float, Interval(ge=0.1, le=1e6)] = 612.9
    stribeck_velocity_m_per_s: Annotated[float, Interval(ge=1e-6, le=0.1)] = 0.000254
    stick_velocity_m_per_s: Annotated[float, Interval(ge=1e-6, le=0.1)] = 0.0001524
    bench_set_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 0.0
    span_m: Annotated[float, Interval(ge=1e-3, le=1.3)] = 0.127
    travel_min_m: Annotated[float, Interval(ge=-0.1, le=1.0)] = 0.0
    travel_max_m: Annotated[float, Interval(ge=1e-3, le=1.3)] = 0.1397
    sensor_time_constant_s: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.0
    backlash_m: Annotated[float, Interval(ge=0.0, le=0.1)] = 0.0
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)

    def __post_init__(self) -> None:
        """Refuse combinations that the limits of the single keys allow."""
        if problem := id_problem(self.id):
            raise ValueError(f"id '{self.id}' {problem}")
        if self.coulomb_friction_n > self.static_friction_n:
            raise ValueError("coulomb_friction_n exceeds static_friction_n: sliding friction is never the larger")
        if self.travel_max_m <= self.travel_min_m:
            raise ValueError("travel_max_m must be greater than travel_min_m")
        if self.backlash_m >= self.span_m:
            raise ValueError("backlash_m must be smaller than span_m: with more the reading says nothing")

    @property
    def force_gain_n_per_ma(self) -> float:
        """S_a K_p in N/mA, the force of one mA (eqs 7 and 10)."""
        return self.diaphragm_area_m2 * self.pressure_gain_pa_per_ma

    @property
    def lag_s(self) -> float:
        """How late the reading of a sliding stem follows the current: actuator, viscous friction, sensor."""
        return (
            self.actuator.slower_lag_s
            + self.actuator.dead_time_s
            + self.viscous_friction_n_s_per_m / self.spring_rate_n_per_m
            + self.sensor_time_constant_s
        )

    @property
    def is_immediate(self) -> bool:
        """Whether a reading shows at once what a current does: nothing is late, and nothing has play."""
        return self.actuator.is_immediate and self.sensor_time_constant_s == 0.0 and self.backlash_m == 0.0

    def balance_current_ma(self, position_m: float) -> float:
        """Return the current in mA that balances the spring at rest: the middle of the stick band."""
        return (self.spring_rate_n_per_m * position_m + self.bench_set_n) / self.force_gain_n_per_ma

    def reach_m(self, low_ma: float, high_ma: float) -> tuple[float, float]:
        """Return the lowest and the highest position in m that the stem can slide to under these currents."""
        low_n = self.force_gain_n_per_ma * low_ma - self.bench_set_n + self.coulomb_friction_n
        high_n = self.force_gain_n_per_ma * high_ma - self.bench_set_n - self.coulomb_friction_n
        rate = self.spring_rate_n_per_m
        return max(low_n / rate, self.travel_min_m), min(high_n / rate, self.travel_max_m)

    def restartable_m(self, low_ma: float, high_ma: float) -> tuple[float, float]:
        """Return the range in m from which these currents free the stem both ways: K x + F_0 ± F_s within B·u.

        The lowest is above the highest where there is no such place.
        """
        low_n = self.force_gain_n_per_ma * low_ma - self.bench_set_n + self.static_friction_n
        high_n = self.force_gain_n_per_ma * high_ma - self.bench_set_n - self.static_friction_n
        rate = self.spring_rate_n_per_m
        return max(low_n / rate, self.travel_min_m), min(high_n / rate, self.travel_max_m)

    def net_force_n(self, position_m: float, current_ma: float) -> float:
        """Return F_e = F_pressure - F_spring in N (eqs 3 and 7)."""
        return self.force_gain_n_per_ma * (current_ma - self.balance_current_ma(position_m))

    def kinetic_friction_n(self, speed_m_per_s: float) -> float:
        """Return γ = F_c + (F_s - F_c) exp(-(v/V_s)²) in N (eq. 4, D1: the exponent is negative)."""
        ratio = speed_m_per_s / self.stribeck_velocity_m_per_s
        excess = self.static_friction_n - self.coulomb_friction_n
        return self.coulomb_friction_n + excess * math.exp(-min(ratio * ratio, 700.0))
