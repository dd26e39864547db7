"""A plant with its own physics: `positioner bench --plant examples/my_plant.py:LuGre` (docs/own-plant.md)."""

import math


class LuGre:
    """A stem on its spring under LuGre friction (Canudas de Wit et al., 1995); the pressure follows at once."""

    mass_kg, area_m2, gain_pa_per_ma, spring_n_per_m = 1.361, 0.06452, 5171.07, 52538.0
    static_n, coulomb_n, viscous_n_s_per_m, stribeck_m_per_s = 1707.7, 1423.0, 612.9, 0.002
    bristle_n_per_m, damping_n_s_per_m, stop_m = 2e7, 5e3, 0.1397
    tables = {  # what a positioner is told of it, and the emulator's noise
        "preset": "paper",
        "valve": {"static_friction_n": static_n, "coulomb_friction_n": coulomb_n, "initial_position_m": 0.05},
        "sensor": {"noise_of_span": 0.0005},
    }

    def begin(self, seed):
        """Return the position in m, the velocity in m/s, and the deflection of the bristles in m."""
        return 0.05, 0.0, 0.0

    def advance(self, state, current_ma, seconds):
        """Return the state after steps of at most 20 µs: ẋ = v, ż = v − σ0 |v| z / g(v), F = σ0 z + σ1 ż + σ2 v."""
        x, v, z = state
        push_n = self.area_m2 * self.gain_pa_per_ma * current_ma
        steps = math.ceil(seconds / 2e-5)
        h = seconds / steps
        for _ in range(steps):
            g = self.coulomb_n + (self.static_n - self.coulomb_n) * math.exp(-((v / self.stribeck_m_per_s) ** 2))
            slip = v - self.bristle_n_per_m * abs(v) * z / g
            friction_n = self.bristle_n_per_m * z + self.damping_n_s_per_m * slip + self.viscous_n_s_per_m * v
            v += h * (push_n - self.spring_n_per_m * x - friction_n) / self.mass_kg
            x, z = x + h * v, z + h * slip
            if not 0.0 <= x <= self.stop_m:
                x, v = min(max(x, 0.0), self.stop_m), 0.0
        return x, v, z

    def reading(self, state):
        """Return what the sensor shows, in m."""
        return state[0]

    def truth(self, state):
        """Return the position in m and the velocity in m/s."""
        return state[:2]
