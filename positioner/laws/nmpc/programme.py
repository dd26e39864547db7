"""The programme of one pass: tracking, the limits of the current, and the stopping points (eq. 17). Pure.

Positions are scaled so that the first input moves the last one by 1; each stopping point, so that the first input moves
it by 1. Far from the target, where the braking current still drives the stem, none of them moves by much.

While the stem does not stop within the horizon, the Hessian is the same in every pass.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.optimization.qp import QuadraticProgram
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.prediction import Trajectory
    from positioner.laws.nmpc.settings import ApproachSettings
    from positioner.valve.slide import Slide


@dataclass(frozen=True, slots=True)
class Cost:
    """What is the same in every pass.

    hessian: its upper triangle, column by column. unit_m: by how much 1 mA in the first step moves the last position.
    weights (H_p): of the errors. input_weight: of a current away from the braking current.
    """

    hessian: list[float]
    unit_m: float
    weights: list[float]
    input_weight: float


@dataclass(frozen=True, slots=True)
class Limits:
    """The inputs (H_u) in mA that brake the most and that drive the most, and the braking current of a stop."""

    braking: list[float]
    driving: list[float]
    brake_ma: float


def cost_of(settings: ApproachSettings, slide: Slide) -> Cost:
    """Return the constant part of the programme."""
    steps, count = settings.prediction_steps, settings.control_steps
    weight, extra = settings.input_weight, settings.terminal_factor - 1.0
    impulse, held = _responses(slide, steps, count)
    unit_m = impulse[steps - 1] if count > 1 else held[steps - 1]
    for i in range(steps):
        impulse[i] /= unit_m
        held[i] /= unit_m
    # the sum over the steps i of impulse[i - j] impulse[i - k] depends on k - j, but for its last terms
    sums = [0.0] * count
    for apart in range(count):
        for i in range(steps - count):
            sums[apart] += impulse[i + apart] * impulse[i]
    columns = list[list[float]]()
    for k in range(count - 1, -1, -1):
        column = [0.0] * (k + 1)
        for j in range(k + 1):
            term = impulse[steps - 1 - j] * impulse[steps - 1 - k]
            sums[k - j] += term
            column[j] = sums[k - j] + extra * term
        columns.append(column)
    if steps > count:
        columns[0] = _held_column(impulse, held, steps, count, extra)
    hessian = list[float]()
    for k in range(count - 1, -1, -1):
        columns[k][-1] += weight
        hessian += columns[k]
    weights = [1.0] * steps
    weights[steps - 1] = settings.terminal_factor
    return Cost(hessian, unit_m, weights, weight)


def _responses(slide: Slide, steps: int, count: int) -> tuple[list[float], list[float]]:
    """Return by how many m 1 mA moves the positions (H_p) from its step on, and 1 mA that is held from step H_u on."""
    x, v, total = slide.x_ma, slide.v_ma, 0.0
    impulse, held = [0.0] * steps, [0.0] * steps
    for i in range(steps):
        impulse[i] = x
        if i + count <= steps:
            total += x
            held[i + count - 1] = total
        x, v = slide.x_x * x + slide.x_v * v, slide.v_x * x + slide.v_v * v
    return impulse, held


def _held_column(impulse: list[float], held: list[float], steps: int, count: int, extra: float) -> list[float]:
    """Return the last column of the tracking cost, of an input that is held."""
    column = [0.0] * count
    for j in range(count):
        total = 0.0
        for i in range(count - 1, steps):
            own = impulse[i - j] if j < count - 1 else held[i]
            term = own * held[i]
            total += term + extra * term if i == steps - 1 else term
        column[j] = total
    return column


def program(
    cost: Cost, slide: Slide, limits: Limits, target_m: float, trajectory: Trajectory, inputs_ma: list[float]
) -> tuple[QuadraticProgram, list[float]]:
    """Return the programme in the inputs (H_u), linearised along `inputs_ma`, and the m by which 1 of a row moves it.

    Where the stem cannot stop before the target any more, the bound is relaxed to what full braking reaches (D10).
    """
    s, count, steps, moving = slide.direction, len(inputs_ma), len(trajectory.positions), trajectory.moving
    weights, unit_m = cost.weights[:moving], cost.unit_m if trajectory.slides else _unit_m(trajectory, count)
    for i in range(moving, steps):
        # where the stem rests, all steps are one
        weights[moving - 1] += cost.weights[i]
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
        own_ma, brake_ma = inputs_ma[j], limits.braking[j] - inputs_ma[j]
        response = [0.0] * moving
        rows.append(1.0)
        for i in range(j, moving):
            # Loop invariant: x and v are the derivatives of the state after step i to input j
            x, v = trajectory.x_x[i] * x + trajectory.x_v[i] * v, trajectory.v_x[i] * x + trajectory.v_v[i] * v
            if i == j or j == count - 1:
                x += trajectory.x_ma[i]
                v += trajectory.v_ma[i]
            stop = s * (trajectory.stop_x[i] * x + trajectory.stop_v[i] * v)
            if j == 0:
                scales[i] = max(abs(stop), _LEAST_M_PER_MA)
            stop /= scales[i]
            rows.append(stop)
            moved[i] += stop * own_ma
            if late:
                least[i] += stop * brake_ma
            response[i] = x / unit_m
            slope += errors[i] * response[i]
        rows += [0.0] * (steps - max(moving, j))
        responses.append(response)
        gradient[j] = cost.input_weight * (own_ma - limits.brake_ma) - slope
    hessian = cost.hessian if trajectory.slides else _hessian(cost, weights, responses)
    _subtract_product(gradient, hessian, inputs_ma)
    low, high = (limits.braking, limits.driving) if s > 0.0 else (limits.driving, limits.braking)
    upper = list(high)
    for i in range(moving):
        bound = room[i] / scales[i]
        upper.append(moved[i] + (max(bound, least[i]) if late else bound))
    upper += [_FREE] * (steps - moving)
    return QuadraticProgram(hessian, gradient, rows, low + [-_FREE] * steps, upper), scales


def _unit_m(trajectory: Trajectory, count: int) -> float:
    """Return by how many m 1 mA in the first step moves the last position."""
    x, v = trajectory.x_ma[0], trajectory.v_ma[0]
    for i in range(1, trajectory.moving):
        x, v = trajectory.x_x[i] * x + trajectory.x_v[i] * v, trajectory.v_x[i] * x + trajectory.v_v[i] * v
        if count == 1:
            x += trajectory.x_ma[i]
            v += trajectory.v_ma[i]
    return x or 1.0


def _hessian(cost: Cost, weights: list[float], responses: list[list[float]]) -> list[float]:
    """Return the upper triangle of the Hessian, column by column, where the stem stops."""
    hessian = list[float]()
    for k in range(len(responses)):
        other = responses[k]
        for j in range(k + 1):
            one, total = responses[j], 0.0
            for i in range(k, len(weights)):
                total += weights[i] * one[i] * other[i]
            hessian.append(total)
        hessian[-1] += cost.input_weight
    return hessian


def _subtract_product(gradient: list[float], hessian: list[float], inputs_ma: list[float]) -> None:
    """Subtract the product of the Hessian, given by the columns of its upper triangle, and the inputs."""
    place = 0
    for k in range(len(inputs_ma)):
        for j in range(k):
            gradient[j] -= hessian[place] * inputs_ma[k]
            gradient[k] -= hessian[place] * inputs_ma[j]
            place += 1
        gradient[k] -= hessian[place] * inputs_ma[k]
        place += 1


_LEAST_M_PER_MA = 1e-9
"""An input that moves a stopping point by less counts as one that does not move it."""
_REACH_MA = 20.0
"""No plan needs an error that is larger than the effect of this current."""
_FREE = 1e6
"""A bound that no row of the programme reaches."""
