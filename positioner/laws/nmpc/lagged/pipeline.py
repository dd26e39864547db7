"""What the law knows of the pressure: the currents on their way, the pressure they make, how it depends on τ. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.drive import Drive


@dataclass(frozen=True, slots=True)
class Pipeline:
    """The pressure now, in mA, and what will change it.

    pressure_ma, converter_ma: p̂ and the output of the I/P converter. waiting: the currents that are still in the dead
    time, the oldest first; one more than its whole samples. share: the part of a sample by which the dead time exceeds
    whole samples. acting_ma: the current that made the last sample's change. by_lag: φ = ∂p̂/∂τ in mA/s.
    doubt_ma: standard deviation of the pressure with which control began, as far as it still matters.
    """

    pressure_ma: float
    converter_ma: float
    waiting: tuple[float, ...]
    share: float
    acting_ma: float
    by_lag: float = 0.0
    doubt_ma: float = 0.0

    def after(self, drive: Drive, current_ma: float) -> Pipeline:
        """Return the pipeline one sample later; `current_ma` is the command that was given at its beginning."""
        currents = (*self.waiting, current_ma)
        acting_ma = self.share * currents[0] + (1.0 - self.share) * currents[1]
        pressure_ma, converter_ma = drive.after(self.pressure_ma, self.converter_ma, acting_ma)
        driving_ma = acting_ma if drive.converter_s == 0.0 else 0.5 * (self.converter_ma + converter_ma)
        lag_s = drive.fill_s if driving_ma > self.pressure_ma else drive.vent_s
        by_lag, left = 0.0, 0.0
        if drive.is_slewing(pressure_ma - self.pressure_ma):
            by_lag, left = self.by_lag, 1.0
        elif lag_s > 0.0:
            left = math.exp(-drive.period_s / lag_s)
            by_lag = left * (self.by_lag + (self.pressure_ma - driving_ma) * drive.period_s / (lag_s * lag_s))
        return Pipeline(pressure_ma, converter_ma, currents[1:], self.share, acting_ma, by_lag, left * self.doubt_ma)

    def measured(self, pressure_ma: float, variance_ma2: float) -> Pipeline:
        """Return the pipeline with a pressure that a sensor has corrected: what is left of its error is no lag's."""
        doubt_ma = math.sqrt(max(variance_ma2, 0.0))
        return Pipeline(pressure_ma, self.converter_ma, self.waiting, self.share, self.acting_ma, 0.0, doubt_ma)

    def pending(self) -> tuple[float, ...]:
        """Return the currents of the samples that the next command cannot change any more, the next one first."""
        waiting, share = self.waiting, self.share
        return tuple([share * waiting[i] + (1.0 - share) * waiting[i + 1] for i in range(len(waiting) - 1)])


def pipeline_at(current_ma: float, doubt_ma: float, dead_time_s: float, period_s: float) -> Pipeline:
    """Return the pipeline of an actuator that has been at about `current_ma` for long, with this doubt in mA."""
    samples = dead_time_s / period_s
    whole = math.floor(samples + _ROUNDING)
    share = max(samples - whole, 0.0)
    waiting = (current_ma,) * (whole + 1)
    return Pipeline(current_ma, current_ma, waiting, share, current_ma, doubt_ma=doubt_ma)


_ROUNDING = 1e-6
"""Of a quotient of two times, in samples."""
