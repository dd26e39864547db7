"""A slide in samples of one period, and where it can be stopped: `motion` for one load and one direction. Pure.

What depends on the load alone is computed once. Then a sample takes four products, and a stopping point one exponential
and one inverse function.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.motion import DEGENERATE, STOPPING_TIME_S, modes

if TYPE_CHECKING:
    from positioner.valve.motion import Load, MotionModel


@dataclass(frozen=True, slots=True)
class Slide:
    """A slide in `direction` (±1) against `load`, in samples of `period_s`, and its braking current.

    x_x, x_v, v_x, v_v: derivatives of x and v after a sample in which the stem does not stop, to x and v before it;
    x_ma, v_ma: to the current. has_one_zero: whether the speed can be 0 only once within a sample.
    rest_m_per_ma, rest_at_0_m: the place where the forces balance, by current; brake_rest_m: under the braking current.
    """

    model: MotionModel
    load: Load
    direction: float
    period_s: float
    half: float
    stiffness: float
    omega2: float
    omega: float
    x_x: float
    x_v: float
    v_x: float
    v_v: float
    x_ma: float
    v_ma: float
    has_one_zero: bool
    rest_m_per_ma: float
    rest_at_0_m: float
    brake_rest_m: float

    def after(self, x: float, v: float, current_ma: float) -> tuple[float, float]:
        """Return x (m) and v (m/s) after one sample under `current_ma`; the stem may stop in it."""
        rest_m = self.rest_m_per_ma * current_ma + self.rest_at_0_m
        z, s = x - rest_m, self.direction
        speed = self.v_x * z + self.v_v * v
        if self.has_one_zero and s * v >= 0.0 and s * speed > 0.0:
            return rest_m + self.x_x * z + self.x_v * v, speed
        if v == 0.0 and s * z >= 0.0:
            return x, 0.0
        end = self.model.step(x, v, current_ma, self.load, s, self.period_s)
        return end.x, end.v

    def stop(self, x: float, v: float) -> tuple[float, float, float]:
        """Return where in m the stem stops under the braking current, and the derivatives of that place to x and v.

        A stem that the braking current still drives without end has reached its balance.
        """
        z, s, half, omega = x - self.brake_rest_m, self.direction, self.half, self.omega
        if s * v < 0.0 or (v == 0.0 and s * z >= 0.0):
            return x, 1.0, 0.0
        slope = half * v + self.stiffness * z
        even, odd = 0.0, 0.0
        has_stop = False
        if omega == 0.0:
            if slope and v / slope > 0.0:
                t = v / slope
                even = math.exp(-half * t)
                odd, has_stop = even * t, True
        elif self.omega2 > 0.0:
            # the angle ωt is in (0, π]: its sine has the sign of the move
            across, along = s * v * omega, s * slope
            length = math.sqrt(across * across + along * along)
            decay = math.exp(-half * (math.atan2(across, along) if across else math.pi) / omega)
            even, odd, has_stop = decay * along / length, decay * across / (length * omega), True
        elif slope:
            ratio = v * omega / slope
            if 0.0 < ratio < 1.0:
                even = math.exp(-half * math.atanh(ratio) / omega) / math.sqrt(1.0 - ratio * ratio)
                odd, has_stop = even * v / slope, True
        if not has_stop:
            even, odd, _ = modes(half, self.omega2, self.stiffness, STOPPING_TIME_S)
        dx_dx = even + half * odd
        return self.brake_rest_m + dx_dx * z + odd * v, dx_dx, odd


def slide_of(model: MotionModel, load: Load, direction: float, period_s: float, brake_ma: float) -> Slide:
    """Return the slide against `load` in `direction` (±1), to be braked with `brake_ma`."""
    rate, gain = load.spring_n_per_m, model.gain_n_per_ma
    half, stiffness = load.viscous_n_s_per_m / (2.0 * model.mass_kg), rate / model.mass_kg
    omega2 = stiffness - half * half
    omega = math.sqrt(abs(omega2)) if abs(omega2) > DEGENERATE * half * half else 0.0
    even, odd, _ = modes(half, omega2, stiffness, period_s)
    x_x, v_x = even + half * odd, -stiffness * odd
    rest_m_per_ma, rest_at_0_m = gain / rate, -(model.bench_set_n + direction * load.friction_n) / rate
    return Slide(
        model=model,
        load=load,
        direction=direction,
        period_s=period_s,
        half=half,
        stiffness=stiffness,
        omega2=omega2,
        omega=omega,
        x_x=x_x,
        x_v=odd,
        v_x=v_x,
        v_v=even - half * odd,
        x_ma=(1.0 - x_x) * rest_m_per_ma,
        v_ma=-v_x * rest_m_per_ma,
        has_one_zero=omega2 <= 0.0 or omega * period_s < math.pi,
        rest_m_per_ma=rest_m_per_ma,
        rest_at_0_m=rest_at_0_m,
        brake_rest_m=rest_m_per_ma * brake_ma + rest_at_0_m,
    )
