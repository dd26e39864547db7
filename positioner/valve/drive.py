"""The actuator in samples: the pressure after one, and the current that takes it where it should be. Pure.

The deadbeat command D(p*) lets the pressure be p* at the end of the sample, within the limits of the loop's current:
    D(p*) = p + (p* - p)/(1 - e^(-T/τ)),
or, where the slew limit acts in the first part of the sample, the current whose course ends in p*. Without a lag it is
p* itself. Behind a converter with a lag, p is led to p* a little later than one sample, since two lags cannot be
undone within one: w goes in one sample to where p would be at p* after T + 2 τ_c. The dead time is not here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.course import lags_of

if TYPE_CHECKING:
    from positioner.valve.actuator import ActuatorParameters
    from positioner.valve.course import Lags, Piece

_CONVERTER_LAGS = 2.0
"""Behind a converter the pressure is to arrive so many of the converter's τ_c after the sample."""
_NEWTON_STEPS = 40
_CLOSE_S = 1e-12


@dataclass(frozen=True, slots=True)
class Drive:
    """An actuator in samples of `period_s`, between two currents.

    arrival_s: when the pressure is to arrive: after a sample, or later behind a converter. fill_arrival, vent_arrival:
    the part of its way that it covers until then. fill_part, vent_part, converter_part: p and w, in a sample.
    """

    lags: Lags
    period_s: float
    arrival_s: float
    low_ma: float
    high_ma: float
    fill_arrival: float
    vent_arrival: float
    fill_part: float
    vent_part: float
    converter_part: float

    def after(self, pressure_ma: float, converter_ma: float, current_ma: float) -> tuple[float, float]:
        """Return pressure and converter output after one sample under `current_ma`."""
        lags, period_s = self.lags, self.period_s
        if lags.converter_s > 0.0:
            last = lags.course(pressure_ma, converter_ma, current_ma, period_s)[-1]
            return last.pressure_ma(last.duration_s), lags.converter_ma(converter_ma, current_ma, period_s)
        gap_ma = current_ma - pressure_ma
        lag_s = lags.of(gap_ma)
        slewing_s = abs(gap_ma) / lags.slew_ma_per_s - lag_s
        if slewing_s <= 0.0:
            part = self.fill_part if gap_ma > 0.0 else self.vent_part
            return current_ma - gap_ma * (1.0 - part), current_ma
        slope = math.copysign(lags.slew_ma_per_s, gap_ma)
        if slewing_s >= period_s:
            return pressure_ma + slope * period_s, current_ma
        return current_ma - slope * lag_s * math.exp(-(period_s - slewing_s) / lag_s), current_ma

    def course(self, pressure_ma: float, converter_ma: float, current_ma: float) -> list[Piece]:
        """Return the pieces of the pressure in one sample under `current_ma`."""
        return self.lags.course(pressure_ma, converter_ma, current_ma, self.period_s)

    def command_ma(self, pressure_ma: float, converter_ma: float, wanted_ma: float) -> float:
        """Return the deadbeat current D(p*) that takes the pressure to `wanted_ma`, as far as the loop can give it."""
        current_ma = self.aim_ma(pressure_ma, wanted_ma)
        if self.lags.converter_s <= 0.0:
            return current_ma
        return self.limited(converter_ma + (current_ma - converter_ma) / self.converter_part)

    def aim_ma(self, pressure_ma: float, wanted_ma: float) -> float:
        """Return the output of the converter that takes the pressure to `wanted_ma`; without its lag, the current."""
        way_ma = wanted_ma - pressure_ma
        arrival = self.fill_arrival if way_ma > 0.0 else self.vent_arrival
        lag_s = self.lags.of(way_ma)
        if lag_s <= 0.0:
            return self.limited(wanted_ma)
        gap_ma = way_ma / arrival
        if abs(gap_ma) > self.lags.slew_ma_per_s * lag_s:
            gap_ma = math.copysign(self._slewing_gap_ma(abs(way_ma), lag_s), way_ma)
        return self.limited(pressure_ma + gap_ma)

    def ramp_ma(self, pressure_ma: float, direction: float, rate_ma_per_s: float) -> tuple[float, float]:
        """Return current and converter output of a pressure that changes steadily by ±`rate_ma_per_s`."""
        lags, change = self.lags, direction * rate_ma_per_s
        converter_ma = pressure_ma + change * lags.of(direction)
        lead_s = lags.converter_s if lags.of(direction) + lags.converter_s > 0.0 else self.period_s
        return self.limited(converter_ma + change * lead_s), self.limited(converter_ma)

    def limited(self, current_ma: float) -> float:
        """Return the current inside the limits of the loop."""
        return min(max(current_ma, self.low_ma), self.high_ma)

    def _slewing_gap_ma(self, way_ma: float, lag_s: float) -> float:
        """Return |u - p| in mA with which p covers `way_ma` until it is to arrive, at the slew limit at first.

        For the time t at the limit: S t + S τ (1 - e^(-(T - t)/τ)) is the way, and S (t + τ) the gap.
        """
        slew, period_s = self.lags.slew_ma_per_s, self.arrival_s
        if way_ma >= slew * period_s:
            return slew * (period_s + lag_s)
        t = 0.0
        for _ in range(_NEWTON_STEPS):
            # concave and rising: Newton's method from the left never passes the root
            left = math.exp(-(period_s - t) / lag_s)
            step_s = (way_ma / slew - t - lag_s * (1.0 - left)) / (1.0 - left)
            t += step_s
            if step_s < _CLOSE_S:
                break
        return slew * (min(t, period_s) + lag_s)


def drive_of(actuator: ActuatorParameters, period_s: float, low_ma: float, high_ma: float, scale: float = 1.0) -> Drive:
    """Return the drive of `actuator` between these currents, with fill and vent lags `scale` times as long."""
    lags = lags_of(actuator, scale)
    arrival_s = period_s + _CONVERTER_LAGS * lags.converter_s
    return Drive(
        lags,
        period_s,
        arrival_s,
        low_ma,
        high_ma,
        _covered(arrival_s, lags.fill_s),
        _covered(arrival_s, lags.vent_s),
        _covered(period_s, lags.fill_s),
        _covered(period_s, lags.vent_s),
        _covered(period_s, lags.converter_s),
    )


def _covered(duration_s: float, lag_s: float) -> float:
    """Return the part of its way that a first-order lag covers."""
    return 1.0 - math.exp(-duration_s / lag_s) if lag_s > 0.0 else 1.0
