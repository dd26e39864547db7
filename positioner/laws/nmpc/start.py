"""Where the passes of a plan start: the fastest inputs that keep the bound, and their multipliers. Pure.

Full current, one input between, then the braking current: this is the time-optimal plan, and nearly always the solution
of the programme, too. Then a pass changes nothing, and the solver only confirms it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.laws.nmpc.move import Limits
    from positioner.laws.nmpc.prediction import Trajectory
    from positioner.laws.nmpc.programme import Pass
    from positioner.valve.slide import Slide


def fastest(slide: Slide, limits: Limits, x: float, v: float, target_m: float) -> list[float]:
    """Return the inputs (H_u) in mA, each as strong as it may be for a stem that is to stop at the target."""
    s, count = slide.direction, len(limits.braking)
    inputs_ma = list(limits.driving)
    for step in range(count):
        ahead_x, ahead_v = slide.after(x, v, inputs_ma[step])
        if s * (slide.stop(ahead_x, ahead_v)[0] - target_m) > 0.0:
            least_ma = limits.braking[step]
            current_ma = _stopping_at(slide, x, v, target_m, least_ma, inputs_ma[step])
            inputs_ma[step] = current_ma
            if current_ma != least_ma:
                # from here on the braking current itself leads to the target
                for later in range(step + 1, count):
                    inputs_ma[later] = limits.brake_ma
                return limits.cut(inputs_ma)
            ahead_x, ahead_v = slide.after(x, v, current_ma)
        x, v = ahead_x, ahead_v
    return inputs_ma


def _stopping_at(slide: Slide, x: float, v: float, target_m: float, least_ma: float, most_ma: float) -> float:
    """Return the input in mA after which the stem stops at the target, by Newton's method from `most_ma` down."""
    s, current_ma = slide.direction, most_ma
    for _ in range(_NEWTON_STEPS):
        ahead_x, ahead_v = slide.after(x, v, current_ma)
        place_m, by_x, by_v = slide.stop(ahead_x, ahead_v)
        if ahead_v != 0.0:
            slope = by_x * slide.x_ma + by_v * slide.v_ma
        else:
            # it stops within the sample
            end = slide.model.step(x, v, current_ma, slide.load, s, slide.period_s)
            slope = end.dx_dq * slide.model.gain_n_per_ma
        if slope < _LEAST_M_PER_MA:
            break
        # not beyond the limits: seen in the direction of the move
        wanted = s * (current_ma + (target_m - place_m) / slope)
        better_ma = s * min(max(wanted, s * least_ma), s * most_ma)
        change_ma, current_ma = abs(better_ma - current_ma), better_ma
        if change_ma < _NEWTON_MA:
            break
    return current_ma


def multipliers(posed: Pass, limits: Limits, trajectory: Trajectory, inputs_ma: list[float]) -> list[float]:
    """Return the multipliers (H_u + H_p) with which the `fastest` inputs are a solution of their programme.

    An input at a limit has a multiplier of its own, any other one that of its stopping point: the stationarity of the
    Lagrangian, backwards from the last input. Where one has the wrong sign, it is 0, and the inputs are no solution.
    """
    s, count, moving, rows = limits.direction, len(inputs_ma), trajectory.moving, posed.program.A
    steps = len(trajectory.positions)
    found = [0.0] * (count + steps)
    first = len(rows)
    for j in range(count - 1, -1, -1):
        # the column of input j: its own row, then the stopping points from step j on
        first -= 1 + steps - j
        left = -posed.gradient[j]
        for i in range(j + 1, moving):
            left -= rows[first + 1 + i - j] * found[count + i]
        if inputs_ma[j] == limits.driving[j]:
            found[j] = s * max(s * left, 0.0)
        elif inputs_ma[j] == limits.braking[j]:
            found[j] = s * min(s * left, 0.0)
        elif j < moving and rows[first + 1] > _LEAST_LEVER:
            found[count + j] = max(left / rows[first + 1], 0.0)
    return found


_NEWTON_STEPS, _NEWTON_MA = 6, 1e-3
_LEAST_M_PER_MA = 1e-9
"""An input that moves a stopping point by less cannot stop the stem at the target."""
_LEAST_LEVER = 1e-6
"""The least effect of an input on its own stopping point from which a multiplier is computed."""
