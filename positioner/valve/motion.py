"""The motion of a sliding stem in closed form: the one motion model of all laws. Pure.

m·v̇ = q - K·x - F_v·v, where the net push q = B·u - bench set - s·F_c, and s = ±1 is the direction of the move. This is
eq. 11 without its Stribeck term, which matters below a few V_s only. Where the speed reaches 0, the stem stops and
stays. At a stop, small changes shift the instant, but not the place: its derivatives are those at a fixed time.

All numbers are scalars, so that the same lines can be compiled ahead of time.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.valve.parameters import ValveParameters

DEGENERATE = 1e-9
"""The damping counts as critical while |ω²| is below this part of h²."""
_ALIKE = 1e-2
"""Two real poles count as nearly equal while they differ from h by less than this part of it."""


@dataclass(frozen=True, slots=True)
class Load:
    """What resists the motion: K (N/m), F_c (N) and F_v (N s/m)."""

    spring_n_per_m: float
    friction_n: float
    viscous_n_s_per_m: float

    @classmethod
    def of(cls, valve: ValveParameters) -> Load:
        """Return the nominal load of `valve`."""
        return cls(valve.spring_rate_n_per_m, valve.coulomb_friction_n, valve.viscous_friction_n_s_per_m)


@dataclass(frozen=True, slots=True)
class Transition:
    """Where a slide ends: x (m), v (m/s), whether it stopped, and derivatives to x and v."""

    x: float
    v: float
    stopped: bool
    dx_dx: float
    dx_dv: float
    dv_dx: float
    dv_dv: float


@dataclass(frozen=True, slots=True)
class MotionModel:
    """What the motion needs of the valve beside the load: m, B and the bench set."""

    mass_kg: float
    gain_n_per_ma: float
    bench_set_n: float

    @classmethod
    def of(cls, valve: ValveParameters) -> MotionModel:
        """Return the model of `valve`."""
        return cls(valve.mass_kg, valve.force_gain_n_per_ma, valve.bench_set_n)

    def push_n(self, current_ma: float, direction: float, friction_n: float) -> float:
        """Return q in N: the force of the current, less the preload and the friction of a move in `direction` (±1)."""
        return self.gain_n_per_ma * current_ma - self.bench_set_n - direction * friction_n

    def current_ma(self, force_n: float) -> float:
        """Return the current in mA whose force, less the preload, is `force_n`."""
        return (force_n + self.bench_set_n) / self.gain_n_per_ma

    def step(
        self, x: float, v: float, current_ma: float, load: Load, direction: float, duration_s: float
    ) -> Transition:
        """Return the motion from x (m) and v (m/s) in `direction` (±1) under `current_ma`, for `duration_s` at most.

        A stem that rests and is not pushed forward, or that moves against `direction`, has stopped at once.
        """
        rate = load.spring_n_per_m
        q = self.push_n(current_ma, direction, load.friction_n)
        half = load.viscous_n_s_per_m / (2.0 * self.mass_kg)
        stiffness = rate / self.mass_kg
        omega2 = stiffness - half * half
        z = x - q / rate
        stop_s = _stop_time_s(z, v, half, omega2, stiffness, direction)
        stopped = stop_s <= duration_s
        t = stop_s if stopped else duration_s
        even, odd = modes(half, omega2, stiffness, t)
        # z(t) = a z + b v and v(t) = c z + d v
        a, b = even + half * odd, odd
        c, d = -stiffness * odd, even - half * odd
        x_end = q / rate + a * z + b * v
        if stopped:
            return Transition(x_end, 0.0, True, a, b, 0.0, 0.0)
        return Transition(x_end, c * z + d * v, False, a, b, c, d)


def modes(half: float, omega2: float, stiffness: float, t: float) -> tuple[float, float]:
    """Return e^(-ht) cos ωt and e^(-ht) sin(ωt)/ω; hyperbolic when overdamped."""
    if omega2 < -DEGENERATE * half * half:
        sigma = math.sqrt(-omega2)
        if sigma < _ALIKE * half and sigma * t < 1.0:
            # the difference of two poles this much alike would cancel
            decay = math.exp(-half * t)
            even, odd = decay * math.cosh(sigma * t), decay * math.sinh(sigma * t) / sigma
        else:
            # by its two real poles: cosh alone overflows in a long slide
            slow, fast = math.exp(-stiffness / (half + sigma) * t), math.exp(-(half + sigma) * t)
            even, odd = (slow + fast) / 2.0, (slow - fast) / (2.0 * sigma)
    else:
        omega, decay = math.sqrt(max(omega2, 0.0)), math.exp(-half * t)
        even, odd = decay * math.cos(omega * t), decay * (math.sin(omega * t) / omega if omega else t)
    return even, odd


def _stop_time_s(z: float, v: float, half: float, omega2: float, stiffness: float, direction: float) -> float:
    """Return when v(t) = e^(-ht) [v cos ωt - (h v + K/m z) sin(ωt)/ω] first reaches 0, infinity if never.

    0 for a stem that rests and is not pushed in `direction`, or that already moves against it.
    """
    if direction * v < 0.0 or (v == 0.0 and direction * z >= 0.0):
        return 0.0
    slope = half * v + stiffness * z
    if abs(omega2) <= DEGENERATE * half * half:
        return v / slope if slope and v / slope > 0.0 else math.inf
    if omega2 > 0.0:
        omega = math.sqrt(omega2)
        # + 0.0: a rest may come as -0.0, whose angle is -π
        angle = math.atan2((v + 0.0) * omega, slope)
        return (angle if angle > 0.0 else angle + math.pi) / omega
    sigma = math.sqrt(-omega2)
    ratio = v * sigma / slope if slope else math.inf
    return math.atanh(ratio) / sigma if 0.0 < ratio < 1.0 else math.inf
