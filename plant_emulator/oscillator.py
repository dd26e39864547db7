"""Motion between two events, in closed form: a mass on a spring, damped, pushed by a changing pressure. Pure.

    m·ẍ + c·ẋ + K·x = f_∞ + r·t + Σ f_Δ·e^(-ρt)

With y = x - f_∞/K, and y(0), v(0) the start, x = f_∞/K + y(0)·g₀ + v(0)·g₁ + Σ (f_Δ/m)·φ_ρ + (r/K)·(t - g₁) -
(r·c/K²)·(1 - g₀): g₁ is the response to an impulse, g₀ to a displacement and φ_ρ to the exponential. φ_ρ is the divided
difference of e^(λt) over the poles λ₁, λ₂ and -ρ: it has a value at resonance, too, where the usual formula divides 0
by 0.

A sensor with a lag 1/σ shows ∫ σ·e^(-σ(t-t'))·x(t') dt'. That of g₁ is σ·φ_σ, that of φ_ρ is σ·(φ_ρ - φ_σ)/(σ - ρ).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plant_emulator.force import PushingForce

_NEAR = 1e-6
"""Relative to K/m: below it, poles count as coincident. Rounding stays below 1e-11 m on either side."""


_APART = 0.5
"""Half the difference of the poles times t: above it subtracting their exponentials loses no digits."""

_ALIKE = 1e-4
"""Relative distance below which the lags of sensor and pressure coincide; only where both are a pole, too."""


class Oscillator:
    """Mass, damping and spring, with the quantities that follow from them; immutable by convention."""

    __slots__ = (
        "damping",
        "decay",
        "fast",
        "mass",
        "root",
        "slow",
        "split",
        "spring",
        "square",
        "stiffness",
        "wildness",
    )

    def __init__(self, mass_kg: float, damping_n_s_per_m: float, spring_n_per_m: float) -> None:
        self.mass = mass_kg
        self.damping = damping_n_s_per_m
        self.spring = spring_n_per_m
        self.stiffness = spring_n_per_m / mass_kg
        self.decay = damping_n_s_per_m / (2.0 * mass_kg)
        self.square = self.decay * self.decay - self.stiffness
        self.root = math.sqrt(abs(self.square))
        self.fast = -(self.decay + self.root)
        # the product of the poles is K/m: no cancellation in the slow one
        self.slow = self.stiffness / self.fast
        self.split = self.square > 0.0
        self.wildness = math.sqrt(spring_n_per_m + damping_n_s_per_m * damping_n_s_per_m / mass_kg)

    def responses(self, t: float) -> tuple[float, float, float]:
        """Return g₀(t), g₁(t) in s, and dg₁/dt."""
        if self.split and self.root * t > _APART:
            slow, fast = math.exp(self.slow * t), math.exp(self.fast * t)
            even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / self.root
        else:
            envelope, angle = math.exp(-self.decay * t), self.root * t
            if angle == 0.0:
                even, odd = envelope, envelope * t
            elif self.split:
                even, odd = envelope * math.cosh(angle), envelope * math.sinh(angle) / self.root
            else:
                even, odd = envelope * math.cos(angle), envelope * math.sin(angle) / self.root
        swing = self.decay * odd
        return even + swing, odd, even - swing

    def exponential_response(self, t: float, rate: float, g0: float, g1: float) -> float:
        """Return φ(t) in s², the response from rest to a unit of acceleration that decays as e^(-rate·t)."""
        distance = rate * rate - 2.0 * self.decay * rate + self.stiffness
        if abs(distance) > _NEAR * self.stiffness:
            return (math.exp(-rate * t) - g0 + rate * g1) / distance
        if self.square > _NEAR * self.stiffness:
            near, far = sorted((self.slow, self.fast), key=lambda pole: abs(pole + rate))
            half = 0.5 * (near + rate) * t
            pair = math.exp(0.5 * (near - rate) * t) * t * (math.sinh(half) / half if half else 1.0)
            return (pair - g1) / (-rate - far)
        # all three poles coincide: the first terms of the series of the divided difference about their mean
        mean = -(2.0 * self.decay + rate) / 3.0
        spread = 2.0 * (mean + self.decay) ** 2 + 2.0 * self.square + (mean + rate) ** 2
        return math.exp(mean * t) * 0.5 * t * t * (1.0 + spread * t * t / 24.0)

    def lagged_response(self, t: float, decay: float, rate: float, impulse: float, g0: float, g1: float) -> float:
        """Return ∫ e^(-rate·(t-t'))·φ(t') dt' in s³ for the φ of `decay`; `impulse` is φ(t) for `rate`."""
        distance = rate * rate - 2.0 * self.decay * rate + self.stiffness
        if abs(distance) > _NEAR * self.stiffness:
            # the equation of motion itself, integrated: only the exponentials of decay and rate remain
            half = 0.5 * (rate - decay) * t
            both = math.exp(-0.5 * (rate + decay) * t) * t * (math.sinh(half) / half if half else 1.0)
            response = self.exponential_response(t, decay, g0, g1)
            return (both - g1 + decay * response + (rate - 2.0 * self.decay) * response) / distance
        if abs(rate - decay) > _ALIKE * rate:
            return (self.exponential_response(t, decay, g0, g1) - impulse) / (rate - decay)
        # all coincide: the mean of two neighbours, whose errors of first order cancel
        above, below = decay * (1.0 + 2.0 * _ALIKE), decay * (1.0 - 2.0 * _ALIKE)
        high = (self.exponential_response(t, above, g0, g1) - impulse) / (rate - above)
        low = (self.exponential_response(t, below, g0, g1) - impulse) / (rate - below)
        return 0.5 * (high + low)


class Glide:
    """The motion under constant friction, from a start position and velocity."""

    __slots__ = ("force", "load", "offset", "oscillator", "rest", "velocity")

    def __init__(
        self, oscillator: Oscillator, position_m: float, velocity_m_per_s: float, force: PushingForce, load_n: float
    ) -> None:
        """Prepare the motion; `load_n` is the constant force against the push: preload and dry friction."""
        self.oscillator = oscillator
        self.force = force
        self.load = load_n
        self.rest = (force.final_n - load_n) / oscillator.spring
        self.offset = position_m - self.rest
        self.velocity = velocity_m_per_s

    def at(self, t: float) -> tuple[float, float]:
        """Return the position in m and the velocity in m/s after `t` seconds."""
        oscillator = self.oscillator
        g0, g1, g1_rate = oscillator.responses(t)
        position = self.rest + self.offset * g0 + self.velocity * g1
        velocity = self.velocity * g1_rate - oscillator.stiffness * self.offset * g1
        for deviation_n, rate in self.force.decays:
            gain = deviation_n / oscillator.mass
            response = oscillator.exponential_response(t, rate, g0, g1)
            position += gain * response
            velocity += gain * (g1 - rate * response)
        if self.force.ramp_n_per_s != 0.0:
            drift = self.force.ramp_n_per_s / oscillator.spring
            behind = drift * oscillator.damping / oscillator.spring
            position += drift * (t - g1) - behind * (1.0 - g0)
            velocity += drift * (1.0 - g1_rate) - behind * oscillator.stiffness * g1
        return position, velocity

    def position(self, t: float) -> float:
        """Return the position in m after `t` seconds."""
        return self.at(t)[0]

    def lagged(self, t: float, rate: float) -> float:
        """Return what a sensor with the lag 1/`rate` shows of the motion after `t` seconds, in m; it began at 0."""
        oscillator, force = self.oscillator, self.force
        g0, g1, _ = oscillator.responses(t)
        fading = math.exp(-rate * t)
        impulse = oscillator.exponential_response(t, rate, g0, g1)
        displaced = g0 - fading + oscillator.stiffness * impulse
        shown = self.rest * (1.0 - fading) + self.offset * displaced + self.velocity * rate * impulse
        for deviation_n, decay in force.decays:
            shown += deviation_n / oscillator.mass * rate * oscillator.lagged_response(t, decay, rate, impulse, g0, g1)
        if force.ramp_n_per_s != 0.0:
            drift = force.ramp_n_per_s / oscillator.spring
            behind = drift * oscillator.damping / oscillator.spring
            shown += drift * (t - (1.0 - fading) / rate - rate * impulse) - behind * (1.0 - fading - displaced)
        return shown

    def acceleration(self, t: float, position_m: float, velocity_m_per_s: float) -> float:
        """Return the acceleration in m/s² in the state that `at(t)` gave."""
        oscillator = self.oscillator
        net = self.force.at(t) - self.load - oscillator.spring * position_m - oscillator.damping * velocity_m_per_s
        return net / oscillator.mass

    def jerk(self, t: float, velocity_m_per_s: float, acceleration_m_per_s2: float) -> float:
        """Return the jerk in m/s³ in the state that `at(t)` gave."""
        oscillator = self.oscillator
        slowing = oscillator.spring * velocity_m_per_s + oscillator.damping * acceleration_m_per_s2
        return (self.force.slope(t) - slowing) / oscillator.mass

    def jerk_bound(self, t: float, velocity_m_per_s: float, acceleration_m_per_s2: float, left_s: float) -> float:
        """Return an upper bound of the size of the jerk in m/s³, from `t` until `left_s` later."""
        swing = self._swing(t, velocity_m_per_s, acceleration_m_per_s2, left_s)
        return (self.force.slope_bound(t, left_s) + swing * self.oscillator.wildness) / self.oscillator.mass

    def snap_bound(self, t: float, velocity_m_per_s: float, acceleration_m_per_s2: float, left_s: float) -> float:
        """Return an upper bound of the size of the jerk's derivative in m/s⁴, from `t` until `left_s` later."""
        oscillator = self.oscillator
        swing = self._swing(t, velocity_m_per_s, acceleration_m_per_s2, left_s)
        jerk_bound = (self.force.slope_bound(t, left_s) + swing * oscillator.wildness) / oscillator.mass
        slowing = oscillator.spring * swing / math.sqrt(oscillator.mass) + oscillator.damping * jerk_bound
        return (self.force.bend_bound(t) + slowing) / oscillator.mass

    def _swing(self, t: float, velocity_m_per_s: float, acceleration_m_per_s2: float, left_s: float) -> float:
        """Return a bound of W = √(m·a² + K·v²); only a change of the force makes it grow: dW/dt ≤ |df/dt|/√m.

        W bounds a and v, and by the Cauchy-Schwarz inequality K·v + c·a ≤ W·√(K + c²/m).
        """
        oscillator = self.oscillator
        swing = math.sqrt(
            oscillator.mass * acceleration_m_per_s2 * acceleration_m_per_s2
            + oscillator.spring * velocity_m_per_s * velocity_m_per_s
        )
        return swing + self.force.change_bound(t, left_s) / math.sqrt(oscillator.mass)
