"""A slide in samples of one period: `motion` for one load and one direction. Pure.

What depends on the load alone is computed once. Then a sample takes four products.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.motion import modes

if TYPE_CHECKING:
    from positioner.valve.motion import Load, MotionModel


@dataclass(frozen=True, slots=True)
class Slide:
    """A slide in `direction` (±1) against `load`, in samples of `period_s`.

    x_x, x_v, v_x, v_v: derivatives of x and v after a sample in which the stem does not stop, to x and v before it;
    x_ma, v_ma: to the current. has_one_zero: whether the speed can be 0 only once within a sample.
    rest_m_per_ma, rest_at_0_m: the place where the forces balance, by current.
    """

    model: MotionModel
    load: Load
    direction: float
    period_s: float
    x_x: float
    x_v: float
    v_x: float
    v_v: float
    x_ma: float
    v_ma: float
    has_one_zero: bool
    rest_m_per_ma: float
    rest_at_0_m: float

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


def slide_of(model: MotionModel, load: Load, direction: float, period_s: float) -> Slide:
    """Return the slide against `load` in `direction` (±1)."""
    rate, gain = load.spring_n_per_m, model.gain_n_per_ma
    half, stiffness = load.viscous_n_s_per_m / (2.0 * model.mass_kg), rate / model.mass_kg
    omega2 = stiffness - half * half
    even, odd = modes(half, omega2, stiffness, period_s)
    x_x, v_x = even + half * odd, -stiffness * odd
    rest_m_per_ma, rest_at_0_m = gain / rate, -(model.bench_set_n + direction * load.friction_n) / rate
    return Slide(
        model=model,
        load=load,
        direction=direction,
        period_s=period_s,
        x_x=x_x,
        x_v=odd,
        v_x=v_x,
        v_v=even - half * odd,
        x_ma=(1.0 - x_x) * rest_m_per_ma,
        v_ma=-v_x * rest_m_per_ma,
        has_one_zero=omega2 <= 0.0 or math.sqrt(omega2) * period_s < math.pi,
        rest_m_per_ma=rest_m_per_ma,
        rest_at_0_m=rest_at_0_m,
    )
