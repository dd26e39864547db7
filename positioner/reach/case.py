"""One case: a valve with its sensor, its period and the limits of its current, and how it moves. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.nmpc.belief import belief_of
from positioner.laws.nmpc.move import Limits
from positioner.laws.nmpc.slip import numbers_of
from positioner.valve.rollout import plant_of

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.nmpc.belief import ValveBelief
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.rollout import Plant, Rollout


_REST_S = 1.0


@dataclass(frozen=True, slots=True)
class Case:
    """A valve, its sensor, the sample period, from a reading to its command, and the limits of the current in mA."""

    valve: ValveParameters
    estimator: EstimatorSettings
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
    def averaged_m(self) -> float:
        """Standard deviation of the mean of the readings of one second at rest, in m."""
        return self.sigma_m * math.sqrt(self.period_s / _REST_S)

    @property
    def belief(self) -> ValveBelief:
        """What a law that starts believes of the valve."""
        return belief_of(self.valve)

    @property
    def limits(self) -> Limits:
        """The limits of its moves."""
        return Limits(self.low_ma, self.high_ma, self.valve.travel_min_m, self.valve.travel_max_m)

    def plant(self, period_s: float = 0.0) -> Plant:
        """Return how the valve moves, in samples of `period_s`; 0 is the case's own."""
        return plant_of(self.valve, period_s or self.period_s, self.delay_s)

    def rollout(self, period_s: float = 0.0) -> Rollout:
        """Return the motion of the configured valve, in samples of `period_s`; 0 is the case's own."""
        return self.plant(period_s).rollout(numbers_of(self.belief.numbers.mean))

    def with_valve(self, **changes: object) -> Case:
        """Return the case with other parameters of the valve."""
        return replace(self, valve=replace(self.valve, **changes))  # type: ignore[arg-type]
