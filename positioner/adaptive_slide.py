"""Sliding with a spring rate and a friction that are estimates themselves: closed form and every derivative. Pure.

The motion of `model.slide`, m·v̇ = q - K·x - F_v·v with the net push q = B·u - bench set - s·F, for any K and q, with
its derivatives to all that it depends on. A stop inside the sample is part of the flow, so that where the stem comes to
rest tells of K and F. At the stop v = 0: the instant of the stop moves, the place does not, to first order, and the
derivatives of the place are those at a fixed time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from positioner.model import ValveParameters

_DEGENERATE = 1e-9
"""|ω²| below this part of h² counts as critical damping."""

_SERIES = 1e-2
"""|ω² t²| below which a derivative is taken from its series."""

STOPPING_TIME_S = 60.0
"""Longer than any stop takes; a frictionless stem, which never stops, has then come to its rest."""


class Flow(NamedTuple):
    """Where a slide ends: x (m), v (m/s), whether it stopped, and derivatives to x, v, the net push q and K."""

    x: float
    v: float
    stopped: bool
    dx_dx: float
    dx_dv: float
    dx_dq: float
    dx_dk: float
    dv_dx: float
    dv_dv: float
    dv_dq: float
    dv_dk: float


@dataclass(frozen=True, slots=True)
class Slider:
    """What the motion needs of the valve, and takes as known: m, F_v, B and the bench set."""

    mass_kg: float
    viscous_n_s_per_m: float
    gain_n_per_ma: float
    bench_set_n: float

    def push_n(self, current_ma: float, direction: float, friction_n: float) -> float:
        """Return q in N: the force of the current, less the preload and the friction of a move in `direction` (±1)."""
        return self.gain_n_per_ma * current_ma - self.bench_set_n - direction * friction_n

    def current_ma(self, force_n: float) -> float:
        """Return the current in mA whose force, less the preload, is `force_n`."""
        return (force_n + self.bench_set_n) / self.gain_n_per_ma

    def flow(self, x: float, v: float, q: float, rate: float, direction: float, duration_s: float) -> Flow:
        """Return the motion in `direction` (±1) under the net push q (N) and the spring rate K, at most `duration_s`.

        A stem that rests, unpushed, or that moves against `direction`, has stopped at once.
        """
        half = self.viscous_n_s_per_m / (2.0 * self.mass_kg)
        stiffness = rate / self.mass_kg
        omega2 = stiffness - half * half
        z = x - q / rate
        stop_s = _stop_time_s(z, v, half, omega2, stiffness, direction)
        stopped = stop_s <= duration_s
        t = stop_s if stopped else duration_s
        even, odd, odd_slope = _modes(half, omega2, stiffness, t)
        # z(t) = a z + b v and v(t) = c z + d v
        a, b = even + half * odd, odd
        c, d = -stiffness * odd, even - half * odd
        # ω² grows with K by 1/m
        a_k, b_k = (half * odd_slope - 0.5 * t * odd) / self.mass_kg, odd_slope / self.mass_kg
        tilt = q / (rate * rate)
        dx_dk = (a - 1.0) * tilt + a_k * z + b_k * v
        dx_dq = (1.0 - a) / rate
        if stopped:
            return Flow(q / rate + a * z + b * v, 0.0, True, a, b, dx_dq, dx_dk, 0.0, 0.0, 0.0, 0.0)
        c_k, d_k = -odd / self.mass_kg - stiffness * b_k, -0.5 * t * odd / self.mass_kg - half * b_k
        dv_dk = c * tilt + c_k * z + d_k * v
        return Flow(q / rate + a * z + b * v, c * z + d * v, False, a, b, dx_dq, dx_dk, c, d, -c / rate, dv_dk)


def slider_of(valve: ValveParameters) -> Slider:
    """Return the slider of `valve`."""
    return Slider(
        valve.mass_kg, valve.viscous_friction_n_s_per_m, valve.force_gain_n_per_ma, valve.bench_set_n
    )


def _modes(half: float, omega2: float, stiffness: float, t: float) -> tuple[float, float, float]:
    """Return e^(-ht) cos ωt, e^(-ht) sin(ωt)/ω and the latter's derivative to ω²; hyperbolic when overdamped."""
    if omega2 < -_DEGENERATE * half * half:
        # by its two real poles: cosh alone overflows in a long slide
        sigma = math.sqrt(-omega2)
        slow, fast = math.exp(-stiffness / (half + sigma) * t), math.exp(-(half + sigma) * t)
        even, odd = (slow + fast) / 2.0, (slow - fast) / (2.0 * sigma)
    else:
        omega, decay = math.sqrt(max(omega2, 0.0)), math.exp(-half * t)
        even, odd = decay * math.cos(omega * t), decay * (math.sin(omega * t) / omega if omega else t)
    turn = omega2 * t * t
    if abs(turn) < _SERIES:
        # the difference below would cancel
        return even, odd, -math.exp(-half * t) * t**3 * (1.0 / 6.0 - turn / 60.0 + turn * turn / 1680.0)
    return even, odd, (t * even - odd) / (2.0 * omega2)


def _stop_time_s(z: float, v: float, half: float, omega2: float, stiffness: float, direction: float) -> float:
    """Return when v(t) = e^(-ht) [v cos ωt - (h v + K/m z) sin(ωt)/ω] first reaches 0, infinity if never."""
    if direction * v < 0.0 or (v == 0.0 and direction * z >= 0.0):
        return 0.0
    slope = half * v + stiffness * z
    if abs(omega2) <= _DEGENERATE * half * half:
        return v / slope if slope and v / slope > 0.0 else math.inf
    if omega2 > 0.0:
        omega = math.sqrt(omega2)
        angle = math.atan2(direction * v * omega, direction * slope)
        return (angle if angle > 0.0 else angle + math.pi) / omega
    sigma = math.sqrt(-omega2)
    ratio = v * sigma / slope if slope else math.inf
    return math.atanh(ratio) / sigma if 0.0 < ratio < 1.0 else math.inf
