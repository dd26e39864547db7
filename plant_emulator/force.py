"""The force that pushes the stem between two edges of the pressure: a constant, a ramp, and decaying parts. Pure."""

from __future__ import annotations

import math

from positioner.values import dataclass


@dataclass(frozen=True, slots=True)
class PushingForce:
    """final_n + ramp_n_per_s·t + the sum of deviation_n·e^(-rate_per_s·t) over (deviation_n, rate_per_s) in decays."""

    final_n: float
    decays: tuple[tuple[float, float], ...] = ()
    ramp_n_per_s: float = 0.0

    @property
    def is_simple(self) -> bool:
        """Whether the force settles monotonically, by one exponential at most."""
        return self.ramp_n_per_s == 0.0 and len(self.decays) <= 1

    def at(self, time_s: float) -> float:
        """Return the force in N, `time_s` from now."""
        force_n = self.final_n
        if self.ramp_n_per_s != 0.0:
            force_n += self.ramp_n_per_s * time_s
        for deviation_n, rate_per_s in self.decays:
            force_n += deviation_n * math.exp(-rate_per_s * time_s)
        return force_n

    def slope(self, time_s: float) -> float:
        """Return the rate of change of the force in N/s, `time_s` from now."""
        slope = self.ramp_n_per_s
        for deviation_n, rate_per_s in self.decays:
            slope -= rate_per_s * deviation_n * math.exp(-rate_per_s * time_s)
        return slope

    def slope_bound(self, time_s: float, left_s: float = math.inf) -> float:
        """Return an upper bound in N/s of the size of the slope, from `time_s` until `left_s` later."""
        bound = abs(self.ramp_n_per_s)
        for deviation_n, rate_per_s in self.decays:
            bound += abs(rate_per_s * deviation_n * math.exp(-rate_per_s * time_s))
        if len(self.decays) <= 1:
            return bound
        slope, bend = self._pair(time_s)
        return min(bound, slope, abs(self.slope(time_s)) + bend * left_s)

    def bend_bound(self, time_s: float) -> float:
        """Return an upper bound in N/s² of the size of the second derivative, from `time_s` on."""
        bound = 0.0
        for deviation_n, rate_per_s in self.decays:
            bound += abs(rate_per_s * deviation_n * math.exp(-rate_per_s * time_s)) * rate_per_s
        return min(bound, self._pair(time_s)[1]) if len(self.decays) > 1 else bound

    def change_bound(self, time_s: float, left_s: float) -> float:
        """Return an upper bound in N of how far the force can go to and fro, from `time_s` until `left_s` later."""
        bound = 0.0
        if self.ramp_n_per_s != 0.0:
            bound = abs(self.ramp_n_per_s) * left_s
        for deviation_n, rate_per_s in self.decays:
            slope = abs(rate_per_s * deviation_n * math.exp(-rate_per_s * time_s))
            bound += slope * min(1.0 / rate_per_s, left_s)
        return min(bound, self.slope_bound(time_s, left_s) * left_s) if len(self.decays) > 1 else bound

    def _pair(self, time_s: float) -> tuple[float, float]:
        """Return bounds of slope and second derivative that are good where the first two decays nearly cancel.

        The slope s of two decays has ṡ + ρ₁·s = h, h = D₂·ρ₂·(ρ₂ - ρ₁)·e^(-ρ₂t), ρ₁ ≤ ρ₂. So s stays within
        |s| + |h|/ρ₂ of now, and ṡ within ρ₁ times that and |h|.
        """
        first, second = self.decays[0], self.decays[1]
        (slow_n, low), (fast_n, high) = (first, second) if first[1] <= second[1] else (second, first)
        fast_slope = fast_n * high * math.exp(-high * time_s)
        driving = abs(fast_slope * (high - low))
        slope = abs(slow_n * low * math.exp(-low * time_s) + fast_slope) + driving / high
        bend = low * slope + driving
        slope += abs(self.ramp_n_per_s)
        for deviation_n, rate_per_s in self.decays[2:]:
            more = abs(rate_per_s * deviation_n * math.exp(-rate_per_s * time_s))
            slope, bend = slope + more, bend + more * rate_per_s
        return slope, bend

    def range_n(self, duration_s: float) -> tuple[float, float]:
        """Return bounds in N, between which the force stays for `duration_s`; of a simple force, for ever."""
        low = high = self.final_n
        if not self.decays and self.ramp_n_per_s == 0.0:
            return low, high
        if self.ramp_n_per_s != 0.0:
            change_n = self.ramp_n_per_s * duration_s
            low, high = low + min(change_n, 0.0), high + max(change_n, 0.0)
        for deviation_n, _ in self.decays:
            if deviation_n > 0.0:
                high += deviation_n
            else:
                low += deviation_n
        return low, high

    def time_above(self, bound_n: float) -> float:
        """Return the time in s until a simple force is above `bound_n`: 0 when it is, infinite when it never will."""
        if self.at(0.0) > bound_n:
            return 0.0
        return math.inf if self.final_n <= bound_n else self._time_at(bound_n)

    def time_below(self, bound_n: float) -> float:
        """Return the time in s until a simple force is below `bound_n`: 0 when it is, infinite when it never will."""
        if self.at(0.0) < bound_n:
            return 0.0
        return math.inf if self.final_n >= bound_n else self._time_at(bound_n)

    def _time_at(self, bound_n: float) -> float:
        deviation_n, rate_per_s = self.decays[0]
        return math.log(deviation_n / (bound_n - self.final_n)) / rate_per_s

    def after(self, time_s: float) -> PushingForce:
        """Return the same force, with `time_s` from now as its new start."""
        if not self.decays and self.ramp_n_per_s == 0.0:
            return self
        decays = tuple([(deviation * math.exp(-rate * time_s), rate) for deviation, rate in self.decays])
        return PushingForce(self.final_n + self.ramp_n_per_s * time_s, decays, self.ramp_n_per_s)
