"""How to get to a setpoint: at once, or back first and then in one jump, and with what ramp. Pure.

A stem that is freed by a ramp jumps at least J_det, until the slip is noticed and stopped. A target nearer than that is
reached by a step back and one jump. The ramp is the fastest one whose J_det is well below the error: on a fast ramp the
stem is freed sooner, and slips farther before the law knows.
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

    def plan(self, belief: Belief, rest: LaggedRest, setpoint_m: float, sigma_m: float, time_s: float) -> Move:
        """Return the move of a stem that rests as `rest` to `setpoint_m`; `sigma_m` is of one reading."""
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
        is_final = abs(error_m) >= need_m
        near = is_final and abs(error_m) < _NEAR * jump_m
        target_m = setpoint_m if is_final else rest.x - s * _BACK * need_m
        s = s if is_final else -s
        aim_m = target_m - s * belief.biases.of(s, near=near)
        return Move(rest.x, target_m, s, aim_m, near, rate, is_final, time_s)

    def _jump(self, slip: Slip, x: float, rate: float, sigma_m: float) -> tuple[float, float]:
        return detectable_jump(slip, self.sensor, x, rate, self.delay_samples, sigma_m, self.settings.brake_share)


_SHORTEST_S = 0.004
"""No slip is expected to be noticed sooner."""
_SPARE = 1.15
"""A target must be so many times as far away as the detectable jump."""
_BACK = 1.05
_NEAR = 2.5
_MULTIPLES = (256.0, 64.0, 16.0, 4.0, 2.0)
"""Of the slowest rate: the ramps that are tried."""
