"""How to get to a setpoint: at once, or aside first and then in one jump, and with what ramp. Pure.

A stem that is freed by a ramp jumps at least J_det, until the slip is noticed and stopped. A target nearer than that is
reached by a step aside and one jump: back and then forward, or beyond it and then back, whichever takes the pressure
less time and is within the loop's limits. The ramp is the fastest one whose J_det is well below the error: on a fast
ramp the stem is freed sooner, and slips farther before the law knows.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.detectable import detectable_jump
from positioner.laws.nmpc.lagged.memory import Move
from positioner.laws.nmpc.lagged.slip import Slip
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.belief import Belief
    from positioner.laws.nmpc.lagged.drive import Drive
    from positioner.laws.nmpc.lagged.rest import LaggedRest
    from positioner.laws.nmpc.lagged.sensor_lag import SensorLag
    from positioner.laws.nmpc.lagged.slip import StemModel
    from positioner.laws.nmpc.lagged_settings import LaggedSettings


@dataclass(frozen=True, slots=True)
class Planner:
    """What a plan needs of the law: settings, model, actuator, sensor, samples of dead time, least F_s - F_c."""

    settings: LaggedSettings
    model: StemModel
    drive: Drive
    sensor: SensorLag
    delay_samples: int
    least_gap_n: float

    def plan(
        self,
        belief: Belief,
        rest: LaggedRest,
        setpoint_m: float,
        pressure_ma: float,
        sigma_m: float,
        time_s: float,
        corrections: int,
        *,
        is_second: bool,
    ) -> Move:
        """Return the move of a stem that rests as `rest`.

        Args:
            belief: the learned valve.
            rest: where the stem is.
            setpoint_m: where it is to be.
            pressure_ma: the pressure now.
            sigma_m: standard deviation of one reading.
            time_s: the law's time.
            corrections: moves that were made for this setpoint and did not do.
            is_second: whether the stem has already moved aside for this jump.
        """
        own, onsets = self.settings, belief.onsets
        error_m = setpoint_m - rest.x
        s = math.copysign(1.0, error_m)
        slip = Slip(self.model, self.drive, s, onsets.spring_n_per_m, onsets.static_n, belief.sliding_n)
        rise_ma = own.ramp_share * max(slip.static_n - slip.sliding_n, self.least_gap_n) / self.model.gain_n_per_ma
        slowest = rise_ma / max(2.0 * self.drive.period_s, _SHORTEST_S)
        _, noticed_s = self._jump(slip, rest.x, slowest, sigma_m)
        rate = min(rise_ma / max(noticed_s, self.drive.period_s), 3.0 * slowest)
        jump_m, _ = self._jump(slip, rest.x, rate, sigma_m)
        need_m = _SPARE * jump_m + 2.0 * rest.sigma_m
        firm_n = onsets.static_n * (1.0 + 2.0 * belief.doubt)
        firm = Slip(self.model, self.drive, s, onsets.spring_n_per_m, firm_n, belief.sliding_n)
        for multiple in _MULTIPLES:
            fast_m, _ = self._jump(firm, rest.x, multiple * rate, sigma_m)
            if _SPARE * fast_m + 2.0 * rest.sigma_m < own.ramp_reach * abs(error_m):
                rate *= multiple
                break
        near = abs(error_m) < _NEAR * jump_m
        if abs(error_m) >= (jump_m if is_second else need_m):
            return self._move(belief, rest, setpoint_m, rate, time_s, near=near, is_final=True)
        aside_m = (_ASIDE + _FARTHER * min(corrections, _MOST_FARTHER)) * need_m
        back_m, beyond_m = rest.x - s * aside_m, setpoint_m + s * aside_m
        back = self._duration(slip, rest.x, pressure_ma, back_m)
        beyond = self._duration(slip, rest.x, pressure_ma, beyond_m)
        aside = beyond_m if beyond < _CLEARLY * back else back_m
        return self._move(belief, rest, aside, rate, time_s, near=False, is_final=False)

    def _move(
        self,
        belief: Belief,
        rest: LaggedRest,
        target_m: float,
        rate: float,
        time_s: float,
        *,
        near: bool,
        is_final: bool,
    ) -> Move:
        s = math.copysign(1.0, target_m - rest.x)
        aim_m = target_m - s * belief.biases.of(s, near=near)
        return Move(rest.x, target_m, s, aim_m, near, rate, is_final, time_s)

    def _duration(self, slip: Slip, x: float, pressure_ma: float, aside_m: float) -> float:
        """Return how long the pressure takes to free the stem at x and then at `aside_m`, in time constants."""
        s = math.copysign(1.0, aside_m - x)
        first_ma = slip.model.pressure_ma(slip.spring_n_per_m * x + s * slip.static_n)
        landed_ma = slip.model.pressure_ma(slip.spring_n_per_m * aside_m + s * slip.sliding_n)
        second_ma = slip.model.pressure_ma(slip.spring_n_per_m * aside_m - s * slip.static_n)
        return self._arrival(pressure_ma, first_ma) + self._arrival(landed_ma, second_ma)

    def _arrival(self, from_ma: float, to_ma: float) -> float:
        """Return how long the pressure takes at full current, in time constants; infinity if it never gets there."""
        limit_ma = self.drive.high_ma if to_ma > from_ma else self.drive.low_ma
        left = (limit_ma - to_ma) / (limit_ma - from_ma) if limit_ma != from_ma else 0.0
        return -math.log(left) if left > _LEAST_LEFT else math.inf

    def _jump(self, slip: Slip, x: float, rate: float, sigma_m: float) -> tuple[float, float]:
        return detectable_jump(slip, self.sensor, x, rate, self.delay_samples, sigma_m, self.settings.brake_share)


_SHORTEST_S = 0.004
"""No slip is expected to be noticed sooner."""
_SPARE = 1.15
"""A target must be so many times as far away as the detectable jump."""
_ASIDE = 1.05
_FARTHER, _MOST_FARTHER = 0.25, 4
"""A longer jump lands better, since its slip is seen for longer: the step aside grows with the corrections."""
_CLEARLY = 0.95
"""To go beyond the target must be so much shorter than to go back."""
_LEAST_LEFT = 0.02
"""A pressure nearer to the limit than this part of the way is not reached for certain."""
_NEAR = 2.5
_MULTIPLES = (256.0, 64.0, 16.0, 4.0, 2.0)
"""Of the slowest rate: the ramps that are tried."""
