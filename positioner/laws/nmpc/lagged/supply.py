"""A supply that is too low for the highest currents: a rise of the pressure that ends below its current. Pure.

A rise follows ṗ = κ (c - p)/τ̂, with the end c = u where the supply suffices, and κ = τ̂/τ. The rate of the pressure,
times τ̂, at the beginning of a rise (a_1 at p_1) and later (a_2 at p_2) gives κ = (a_1 - a_2)/(p_2 - p_1) and
c = p_2 + a_2/κ, whatever the lag is. This holds where the lag alone limits the rise: not before the I/P converter has
come to its current, and not at the slew limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.drive import Drive

_ABOVE_MA = 0.5
"""The current is so far above a pressure that rises."""
_SETTLED_MA = 0.05
"""A converter that is nearer to its current has come there."""
_WINDOW_MA, _WINDOW_SIGMA = 1.5, 12.0
"""A rate is measured over an expected rise of so much, and of so many σ of a reading."""
_APART_MA = 1.0
"""Two rates are compared where the pressure has risen by so much between them."""
_LEAST_KAPPA, _MOST_KAPPA = 0.5, 2.0
_BELOW_MA, _SIGMAS = 0.5, 4.0
_SPARE_MA, _SPARE_SIGMAS = 0.2, 2.0
"""So much is added to the end: a highest current that is too low would keep places out of reach, and a little too much
does no harm."""
"""A rise that is to end so much, and so many σ, below its current has no supply for more."""


@dataclass(frozen=True, slots=True)
class Supply:
    """A rise of the pressure under one current.

    current_ma: that current. expected_ma: the rise that the model expects since `begin_ma`. first_ma, first_rate_ma,
    first_sigma_ma: p_1, a_1 and its standard deviation, which is 0 before the first rate.
    """

    current_ma: float = 0.0
    expected_ma: float = 0.0
    begin_ma: float = 0.0
    first_ma: float = 0.0
    first_rate_ma: float = 0.0
    first_sigma_ma: float = 0.0

    def after(
        self, drive: Drive, measured_ma: float, acting_ma: float, converter_ma: float, sigma_ma: float
    ) -> tuple[Supply, float | None]:
        """Return the rise after a reading, and the highest current in mA that has an effect, None without a limit.

        acting_ma, converter_ma: the current that acts, and the output of the I/P converter in the model.
        """
        ahead_ma = acting_ma - measured_ma
        if ahead_ma < _ABOVE_MA or acting_ma != self.current_ma or abs(acting_ma - converter_ma) > _SETTLED_MA:
            return Supply(acting_ma, 0.0, measured_ma), None
        expected_ma = self.expected_ma + drive.fill_sample * ahead_ma
        if expected_ma < max(_WINDOW_MA, _WINDOW_SIGMA * sigma_ma):
            return self._going_on(expected_ma, self.begin_ma), None
        here_ma = 0.5 * (self.begin_ma + measured_ma)
        rate_ma = (measured_ma - self.begin_ma) / expected_ma * (acting_ma - here_ma)
        rate_sigma_ma = _ROOT_2 * sigma_ma / expected_ma * (acting_ma - here_ma)
        if rate_ma + 2.0 * rate_sigma_ma > drive.slew_ma_per_s * drive.fill_s:
            return Supply(acting_ma, 0.0, measured_ma), None
        if self.first_sigma_ma == 0.0:
            return Supply(acting_ma, 0.0, measured_ma, here_ma, rate_ma, rate_sigma_ma), None
        apart_ma = here_ma - self.first_ma
        if apart_ma > _APART_MA:
            kappa = (self.first_rate_ma - rate_ma) / apart_ma
            if _LEAST_KAPPA < kappa < _MOST_KAPPA:
                left_ma = rate_ma / kappa
                weight = left_ma / apart_ma
                doubt_ma = ((1.0 + weight) * rate_sigma_ma + weight * self.first_sigma_ma) / kappa
                end_ma = here_ma + left_ma
                if end_ma + max(_BELOW_MA, _SIGMAS * doubt_ma) < acting_ma:
                    return NO_RISE, min(end_ma + _SPARE_MA + _SPARE_SIGMAS * doubt_ma, acting_ma)
        return self._going_on(0.0, measured_ma), None

    def _going_on(self, expected_ma: float, begin_ma: float) -> Supply:
        return Supply(self.current_ma, expected_ma, begin_ma, self.first_ma, self.first_rate_ma, self.first_sigma_ma)


NO_RISE = Supply()
_ROOT_2 = 1.4142135623730951
