"""One case: a valve with its sensor, its period and the limits of its current, and the motions that follow. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.nmpc.lagged.slip import Slip
from positioner.laws.nmpc.lagged.valve import LaggedValve, is_lagged, lagged_valve

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.nmpc.settings import NmpcSettings
    from positioner.valve.parameters import ValveParameters


_REST_S = 1.0


@dataclass(frozen=True, slots=True)
class Case:
    """A valve, its sensor, the sample period, from a reading to its command, and the limits of the current in mA."""

    valve: ValveParameters
    estimator: EstimatorSettings
    settings: NmpcSettings
    period_s: float
    delay_s: float
    low_ma: float
    high_ma: float

    @classmethod
    def of(cls, configuration: Configuration) -> Case:
        """Return the case of a configuration."""
        control, guard = configuration.control, configuration.guard
        return cls(
            configuration.valve,
            configuration.estimator,
            control.nmpc,
            control.sample_period_s,
            control.command_delay_s,
            guard.current_low_ma,
            guard.current_high_ma,
        )

    @property
    def middle_m(self) -> float:
        """The middle of the places that the stem can leave both ways, or of its travel where there are none."""
        low_m, high_m = self.valve.restartable_m(self.low_ma, self.high_ma)
        if low_m > high_m:
            low_m, high_m = self.valve.travel_min_m, self.valve.travel_max_m
        return (low_m + high_m) / 2.0

    @property
    def sigma_m(self) -> float:
        """Standard deviation of one reading in the middle, in m."""
        return measurement_sigma_m(self.estimator, self.valve, self.middle_m)

    @property
    def tolerance_m(self) -> float:
        """The error that the law does not correct, in m; on a valve without lag, after a second at rest."""
        own = self.settings.lagged
        if is_lagged(self.valve):
            return math.hypot(own.tolerance_of_span * self.valve.span_m, own.tolerance_of_noise * self.sigma_m)
        return self.settings.tolerance_m + self.settings.doubt_sigma * self.sigma_m * math.sqrt(self.period_s / _REST_S)

    def lagged(self, period_s: float = 0.0) -> LaggedValve:
        """Return the law's model of the valve, in samples of `period_s`; 0 is the case's own."""
        return lagged_valve(
            self.settings.lagged, self.valve, period_s or self.period_s, self.delay_s, self.low_ma, self.high_ma
        )

    def with_valve(self, **changes: object) -> Case:
        """Return the case with other parameters of the valve."""
        return replace(self, valve=replace(self.valve, **changes))  # type: ignore[arg-type]


def slip_of(lagged: LaggedValve, direction: float) -> Slip:
    """Return the motion of a stem that slips in `direction` (±1)."""
    sliding_n = min(lagged.sliding_n, lagged.static_n)
    return Slip(lagged.model, lagged.drive, direction, lagged.spring_n_per_m, lagged.static_n, sliding_n)


def freeing_ma(slip: Slip, x: float) -> float:
    """Return the pressure in mA that frees the stem at x (m)."""
    return slip.model.pressure_ma(slip.spring_n_per_m * x + slip.direction * slip.static_n)


def brake_ma(case: Case, slip: Slip, x: float) -> float:
    """Return the pressure in mA that brakes the stem before x (m), inside the stick band there."""
    share_n = slip.direction * case.settings.lagged.brake_share * slip.static_n
    return slip.drive.limited(slip.model.pressure_ma(slip.spring_n_per_m * x - share_n))
