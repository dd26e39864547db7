"""A slip of the stem under a pressure that lags: its motion sample by sample, and where it can be stopped. Pure.

m·v̇ = B·p - F_0 - K·x - s[F_c + (F_s - F_c) e^(-(v/V_s)²)] - F_v·v (eqs 4 and 11), implicit in v, in the steps of the
`Drive`. Where s·v reaches 0 the stem stops and stays.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.drive import Drive
    from positioner.valve.parameters import ValveParameters

_SLIDING = 25.0
"""Above this (v/V_s)² the friction is F_c."""


@dataclass(frozen=True, slots=True)
class StemModel:
    """What the motion needs of the valve beside spring and friction: m, B, the bench set F_0, F_v and V_s."""

    mass_kg: float
    gain_n_per_ma: float
    bench_set_n: float
    viscous_n_s_per_m: float
    stribeck_m_per_s: float

    @classmethod
    def of(cls, valve: ValveParameters) -> StemModel:
        """Return the model of `valve`."""
        return cls(
            valve.mass_kg,
            valve.force_gain_n_per_ma,
            valve.bench_set_n,
            valve.viscous_friction_n_s_per_m,
            valve.stribeck_velocity_m_per_s,
        )

    def net_n(self, pressure_ma: float, spring_n_per_m: float, x: float) -> float:
        """Return the force of pressure and spring on the stem in N."""
        return self.gain_n_per_ma * pressure_ma - self.bench_set_n - spring_n_per_m * x

    def pressure_ma(self, force_n: float) -> float:
        """Return the pressure in mA whose force, less the bench set, is `force_n`."""
        return (force_n + self.bench_set_n) / self.gain_n_per_ma


@dataclass(frozen=True, slots=True)
class Slip:
    """A slip in `direction` (±1) against the spring rate K, the static friction F_s and the sliding friction F_c."""

    model: StemModel
    drive: Drive
    direction: float
    spring_n_per_m: float
    static_n: float
    sliding_n: float

    def with_sliding(self, sliding_n: float) -> Slip:
        """Return the slip with another F_c."""
        return Slip(self.model, self.drive, self.direction, self.spring_n_per_m, self.static_n, sliding_n)

    def with_drive(self, drive: Drive) -> Slip:
        """Return the slip with another actuator."""
        return Slip(self.model, drive, self.direction, self.spring_n_per_m, self.static_n, self.sliding_n)

    def after(
        self, x: float, v: float, pressure_ma: float, converter_ma: float, current_ma: float
    ) -> tuple[float, float, float, float, bool]:
        """Return x, v, pressure and converter output after one sample, and whether the stem stopped in it."""
        drive, model, s = self.drive, self.model, self.direction
        h, rate, sliding_n = drive.step_s, self.spring_n_per_m, self.sliding_n
        excess_n = self.static_n - sliding_n
        by_mass, damping = h / model.mass_kg, 1.0 + h * model.viscous_n_s_per_m / model.mass_kg
        stribeck2 = model.stribeck_m_per_s * model.stribeck_m_per_s
        stopped = False
        for _ in range(drive.steps):
            pressure_ma, converter_ma = drive.step(pressure_ma, converter_ma, current_ma)
            if stopped:
                continue
            friction_n, fast = sliding_n, v * v
            if fast < _SLIDING * stribeck2 and v != 0.0:
                friction_n += excess_n * math.exp(-fast / stribeck2)
            force_n = model.gain_n_per_ma * pressure_ma - model.bench_set_n - rate * x - s * friction_n
            speed = (v + by_mass * force_n) / damping
            if s * speed <= 0.0:
                # within this step, evenly braked
                x += 0.5 * h * v * v / (v - speed) if v != speed else 0.0
                v, stopped = 0.0, True
            else:
                x += 0.5 * h * (v + speed)
                v = speed
        return x, v, pressure_ma, converter_ma, stopped

    def begun(self, x: float, begin_ma: float, end_ma: float, duration_s: float) -> tuple[float, float]:
        """Return x and v some time after the stem was freed at x, under a pressure that changes evenly.

        v is 0 if the stem sticks at once.
        """
        drive, model, s = self.drive, self.model, self.direction
        start_m, v = x, 0.0
        h = duration_s / drive.steps
        damping = 1.0 + h * model.viscous_n_s_per_m / model.mass_kg
        for step in range(drive.steps):
            pressure_ma = begin_ma + (step + 0.5) / drive.steps * (end_ma - begin_ma)
            force_n = model.net_n(pressure_ma, self.spring_n_per_m, x) - s * self.sliding_n
            speed = (v + h * force_n / model.mass_kg) / damping
            if s * speed <= 0.0:
                return start_m, 0.0
            x += 0.5 * h * (v + speed)
            v = speed
        return x, v

    def stop_m(
        self, x: float, v: float, pressure_ma: float, converter_ma: float, first_ma: float, brake_ma: float
    ) -> float:
        """Return where in m the stem stops after one sample under `first_ma`, then with the pressure to `brake_ma`."""
        x, v, pressure_ma, converter_ma, stopped = self.after(x, v, pressure_ma, converter_ma, first_ma)
        return x if stopped else self.braked_m(x, v, pressure_ma, converter_ma, brake_ma)

    def braked_m(self, x: float, v: float, pressure_ma: float, converter_ma: float, brake_ma: float) -> float:
        """Return where in m a stem that slides stops with the pressure to `brake_ma` from now on."""
        left_s, stopped = _LONGEST_STOP_S, False
        while not stopped and left_s > 0.0:
            current_ma = self.drive.command_ma(pressure_ma, converter_ma, brake_ma)
            x, v, pressure_ma, converter_ma, stopped = self.after(x, v, pressure_ma, converter_ma, current_ma)
            left_s -= self.drive.period_s
        return x


_LONGEST_STOP_S = 1.0
