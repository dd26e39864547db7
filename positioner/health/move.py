"""One move of the stem from rest to rest, and with what it is measured. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.motion import Load, MotionModel

if TYPE_CHECKING:
    from positioner.valve.parameters import ValveParameters


@dataclass(frozen=True, slots=True)
class Move:
    """A move from rest to rest.

    at_s: the instant of its first reading; rest_s: for how long the stem had rested.
    before_m, after_m: the places of rest. direction: ±1. path_m: the whole way, with the corrections that
    followed at once; they may go back.
    force_n: F_0 + K·x̄ ± F_c·path/way; force_sigma_n: its σ by the noise of the readings.
    slip_n: B·u at the slip, the middle between the farthest current that held the stem and the one that freed it;
    slip_half_n: half of their distance. lowest_n, highest_n: B·u of the currents under which it rested.
    complete: that force_n is known; otherwise the stem turned, crept, or a reading was missing.
    """

    at_s: float
    rest_s: float
    before_m: float
    after_m: float
    direction: float
    path_m: float
    force_n: float
    force_sigma_n: float
    slip_n: float
    slip_half_n: float
    lowest_n: float
    highest_n: float
    complete: bool

    @property
    def friction_part(self) -> float:
        """The factor of F_c in force_n: ±1, or more where the stem went back on its way."""
        return self.direction * max(self.path_m / abs(self.after_m - self.before_m), 1.0)

    @property
    def middle_m(self) -> float:
        """The middle of the way in m, x̄."""
        return 0.5 * (self.before_m + self.after_m)


@dataclass(frozen=True, slots=True)
class MoveSettings:
    """What a move is measured with, in SI units: the motion as it is configured, noise, and the period of readings."""

    model: MotionModel
    load: Load
    noise_of_reading: float
    noise_of_span_m: float
    period_s: float

    @classmethod
    def of(cls, valve: ValveParameters, noise_of_reading: float, noise_of_span: float, period_s: float) -> MoveSettings:
        """Return the settings of a configured valve and its sensor's noise."""
        return cls(
            MotionModel.of(valve),
            Load.of(valve),
            noise_of_reading,
            max(noise_of_span * valve.span_m, 1e-6),
            period_s,
        )

    @property
    def gain_n_per_ma(self) -> float:
        """The force of a milliampere in N."""
        return self.model.gain_n_per_ma

    def sigma_m(self, position_m: float) -> float:
        """Return the standard deviation of a reading in m."""
        return self.noise_of_reading * abs(position_m) + self.noise_of_span_m
