"""The programme of one pass: tracking, the limits of the current, and the stopping points (eq. 17). Pure.

Positions are scaled so that the first input moves the last one by 1; each stopping point, so that the first input moves
it by 1. Far from the target, where the braking current still drives the stem, none of them moves by much.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.optimization.qp import QuadraticProgram
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.move import Limits
    from positioner.laws.nmpc.prediction import Trajectory
    from positioner.laws.nmpc.settings import ApproachSettings


@dataclass(frozen=True, slots=True)
class Pass:
    """One pass: the programme in the inputs (H_u), linearised along some inputs.

    gradient (H_u): of the cost, at these inputs. scales: the m by which 1 of a row moves its stopping point, for every
    step in which the stem moves.
    """

    program: QuadraticProgram
    gradient: list[float]
    scales: list[float]


def program(
    settings: ApproachSettings, limits: Limits, target_m: float, trajectory: Trajectory, inputs_ma: list[float]
) -> Pass:
    """Return the programme that is linearised along `inputs_ma` (H_u).

    Where the stem cannot stop before the target any more, the bound is relaxed to what full braking reaches (D10).
    """
    s, count, steps, moving = limits.direction, len(inputs_ma), len(trajectory.positions), trajectory.moving
    x_x, x_v, v_x, v_v = trajectory.x_x, trajectory.x_v, trajectory.v_x, trajectory.v_v
    x_ma, v_ma, stop_x, stop_v = trajectory.x_ma, trajectory.v_ma, trajectory.stop_x, trajectory.stop_v
    input_weight, brake_ma = settings.input_weight, limits.brake_ma
    unit_m = _unit_m(trajectory, count)
    # where the stem rests, all steps are one
    weights = [1.0] * moving
    weights[moving - 1] = steps - moving + settings.terminal_factor
    errors, room, late = [0.0] * moving, [0.0] * moving, False
    reach_m = _REACH_MA * abs(unit_m)
    for i in range(moving):
        # a target beyond the reach of all currents is moved nearer: better numbers for the solver, and the same plan
        error_m = min(max(target_m - trajectory.positions[i], -reach_m), reach_m)
        errors[i] = weights[i] * error_m / unit_m
        room[i] = s * (target_m - trajectory.stops[i])
        late = late or room[i] < 0.0
    scales, moved, least = [1.0] * moving, [0.0] * moving, [0.0] * moving
    gradient, rows, responses = [0.0] * count, list[float](), list[list[float]]()
    for j in range(count):
        x, v, slope = 0.0, 0.0, 0.0
        own_ma, less_ma = inputs_ma[j], limits.braking[j] - inputs_ma[j]
        response = [0.0] * moving
        rows.append(1.0)
        for i in range(j, moving):
            # Loop invariant: x and v are the derivatives of the state before step i to input j
            x, v = x_x[i] * x + x_v[i] * v, v_x[i] * x + v_v[i] * v
            if i == j or j == count - 1:
                x += x_ma[i]
                v += v_ma[i]
            stop = s * (stop_x[i] * x + stop_v[i] * v)
            if j == 0:
                scales[i] = max(abs(stop), _LEAST_M_PER_MA)
            stop /= scales[i]
            rows.append(stop)
            moved[i] += stop * own_ma
            if late:
                least[i] += stop * less_ma
            share = x / unit_m
            response[i] = share
            slope += errors[i] * share
        rows += [0.0] * (steps - max(moving, j))
        responses.append(response)
        gradient[j] = input_weight * (own_ma - brake_ma) - slope
    hessian = _hessian(trajectory, weights, responses, input_weight)
    upper = list(limits.high)
    for i in range(moving):
        bound = room[i] / scales[i]
        upper.append(moved[i] + (max(bound, least[i]) if late else bound))
    upper += [_FREE] * (steps - moving)
    linear = _less_product(gradient, hessian, inputs_ma)
    return Pass(QuadraticProgram(hessian, linear, rows, limits.low + [-_FREE] * steps, upper), gradient, scales)


def _unit_m(trajectory: Trajectory, count: int) -> float:
    """Return by how many m 1 mA in the first step moves the last position."""
    x, v = trajectory.x_ma[0], trajectory.v_ma[0]
    for i in range(1, trajectory.moving):
        x, v = trajectory.x_x[i] * x + trajectory.x_v[i] * v, trajectory.v_x[i] * x + trajectory.v_v[i] * v
        if count == 1:
            x += trajectory.x_ma[i]
            v += trajectory.v_ma[i]
    return x or 1.0


def _hessian(
    trajectory: Trajectory, weights: list[float], responses: list[list[float]], input_weight: float
) -> list[float]:
    """Return the upper triangle of the Hessian, column by column."""
    if trajectory.slides and len(responses) == len(weights):
        return _hessian_of_slide(responses[0], weights[-1] - 1.0, input_weight)
    hessian = list[float]()
    for k in range(len(responses)):
        other = responses[k]
        for j in range(k + 1):
            one, total = responses[j], 0.0
            for i in range(k, len(weights)):
                total += weights[i] * one[i] * other[i]
            hessian.append(total)
        hessian[-1] += input_weight
    return hessian


def _hessian_of_slide(response: list[float], extra: float, input_weight: float) -> list[float]:
    """Return the same where the stem never stops: all inputs have the response of the first one, but later.

    The sum of response[i - j] response[i - k] over the steps i then grows by one term from column k + 1 to k. `extra`
    is added to the weight of the last step.
    """
    steps = len(response)
    hessian, sums = [0.0] * (steps * (steps + 1) // 2), [0.0] * steps
    for k in range(steps - 1, -1, -1):
        other, first = response[steps - 1 - k], k * (k + 1) // 2
        for j in range(k + 1):
            term = response[steps - 1 - j] * other
            sums[k - j] += term
            hessian[first + j] = sums[k - j] + extra * term
        hessian[first + k] += input_weight
    return hessian


def _less_product(gradient: list[float], hessian: list[float], inputs_ma: list[float]) -> list[float]:
    """Return `gradient` less the product of the Hessian, given by the columns of its upper triangle, and the inputs."""
    result, place = list(gradient), 0
    for k in range(len(inputs_ma)):
        own_ma, own = inputs_ma[k], result[k]
        for j in range(k):
            entry = hessian[place]
            result[j] -= entry * own_ma
            own -= entry * inputs_ma[j]
            place += 1
        result[k] = own - hessian[place] * own_ma
        place += 1
    return result


_LEAST_M_PER_MA = 1e-9
"""An input that moves a stopping point by less counts as one that does not move it."""
_REACH_MA = 20.0
"""No plan needs an error that is larger than the effect of this current."""
_FREE = 1e6
"""A bound that no row of the programme reaches."""
