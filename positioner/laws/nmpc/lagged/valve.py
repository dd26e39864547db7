"""What the law knows of a valve with actuator lag before anything is learned. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.belief import Belief, LandingBiases
from positioner.laws.nmpc.lagged.drive import drive_of
from positioner.laws.nmpc.lagged.regression import OnsetRegression
from positioner.laws.nmpc.lagged.sensor_lag import sensor_lag
from positioner.laws.nmpc.lagged.slip import Slip, StemModel
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.drive import Drive
    from positioner.laws.nmpc.lagged.sensor_lag import SensorLag
    from positioner.laws.nmpc.lagged_settings import LaggedSettings
    from positioner.valve.parameters import ValveParameters

_LEAST_STATIC_N = 1.0
"""A valve without friction is believed to have so much: a ramp needs an end."""
_SLIDING_DOUBT, _SLIDING_SCATTER = 0.03, 0.03
"""Before the first slip: relative standard deviations of F_c from its configured part of F_s, and of single slips."""


@dataclass(frozen=True, slots=True)
class LaggedValve:
    """The constants: settings, motion, actuator and sensor, and the configured K, F_s and F_c.

    dead_time_s: from a reading until the command that it causes begins to act on the converter.
    """

    settings: LaggedSettings
    model: StemModel
    drive: Drive
    sensor: SensorLag
    dead_time_s: float
    spring_n_per_m: float
    static_n: float
    sliding_n: float
    span_m: float

    @property
    def period_s(self) -> float:
        """T_s in s."""
        return self.drive.period_s

    @property
    def delay_samples(self) -> int:
        """Samples that pass before a command acts, the last one in part."""
        return math.ceil(self.dead_time_s / self.period_s - 1e-6)

    @property
    def gap_n(self) -> float:
        """F_s - F_c in N, at least 2 % of F_s."""
        return max(self.static_n - self.sliding_n, 0.02 * self.static_n)

    @property
    def has_lag(self) -> bool:
        """Whether there is a lag to learn: one that is not over within a sample."""
        return self.drive.fill_s >= self.drive.period_s

    @property
    def longest_slip_s(self) -> float:
        """The longest time in s that a slip can take; a stem that slides longer in the model has stopped in fact."""
        friction_s = 10.0 * self.model.viscous_n_s_per_m / self.spring_n_per_m
        return 0.25 + friction_s + 2.0 * max(self.drive.fill_s, self.drive.vent_s)

    @property
    def slowest_m_per_s(self) -> float:
        """A slip with less speed has ended."""
        return min(2e-4, 0.0075 * self.gap_n / self.model.viscous_n_s_per_m)

    def tolerance_m(self, sigma_m: float) -> float:
        """Return the error in m that is not worth a correction; `sigma_m` is of one reading."""
        return math.hypot(self.settings.tolerance_of_span * self.span_m, self.settings.tolerance_of_noise * sigma_m)

    def prior(self, spring_n_per_m: float, static_n: float, sliding_n: float) -> Belief:
        """Return what is believed before the first onset."""
        own = self.settings
        k, f, t = own.spring_doubt * spring_n_per_m, own.friction_doubt * static_n, own.lag_doubt
        ratio, c = sliding_n / static_n, _SLIDING_DOUBT * sliding_n
        tt = t * t if self.has_lag else 0.0
        cc = ratio * ratio * f * f + c * c
        onsets = OnsetRegression(
            spring_n_per_m, static_n, 1.0, sliding_n, k * k, 0.0, 0.0, 0.0, f * f, 0.0, ratio * f * f, tt, 0.0, cc
        )
        return Belief(onsets, _SLIDING_SCATTER * _SLIDING_SCATTER, 0.08, 0, LandingBiases())

    def sliding_within(self, sliding_n: float, static_n: float) -> float:
        """Return F_c inside its limits, for this F_s."""
        return min(max(sliding_n, 0.5 * static_n), static_n - 0.5 * self.gap_n)

    def within(self, onsets: OnsetRegression) -> OnsetRegression:
        """Return the regression inside its limits around the configured valve, with F_c below F_s."""
        found = onsets.within(self.spring_n_per_m, self.static_n, self.has_lag)
        return replace(found, sliding_n=self.sliding_within(found.sliding_n, found.static_n))

    def slip(self, belief: Belief, drive: Drive, direction: float) -> Slip:
        """Return the motion of a slip as it is believed to be."""
        onsets = belief.onsets
        return Slip(self.model, drive, direction, onsets.spring_n_per_m, onsets.static_n, onsets.sliding_n)

    def spring_n(self, belief: Belief, x: float) -> float:
        """Return the force of the spring at x in N, without the bench set."""
        return belief.onsets.spring_n_per_m * x


def lagged_valve(
    settings: LaggedSettings, valve: ValveParameters, period_s: float, delay_s: float, low_ma: float, high_ma: float
) -> LaggedValve:
    """Return the constants for a valve whose commands act `delay_s` after a reading, between these currents in mA."""
    return LaggedValve(
        settings,
        StemModel.of(valve),
        drive_of(valve.actuator, period_s, low_ma, high_ma),
        sensor_lag(valve.sensor_time_constant_s, period_s),
        valve.actuator.dead_time_s + delay_s,
        valve.spring_rate_n_per_m,
        max(valve.static_friction_n, _LEAST_STATIC_N),
        valve.coulomb_friction_n,
        valve.span_m,
    )


def is_lagged(valve: ValveParameters) -> bool:
    """Return whether something lies between current, stem and reading, as configured."""
    return not valve.actuator.is_immediate or valve.sensor_time_constant_s > 0.0 or valve.backlash_m > 0.0
