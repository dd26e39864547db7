"""The quadratic programme that places a stop: which currents lead a sliding stem to its target. Pure, but for OSQP.

The stop x_s of a rollout is linearised along planned currents u: in changes δ at up to eight knots, with straight lines
between them. Of all currents within the limits, and within the largest rate R, those are taken that put the stop at the
target r and differ least from the planned ones (a pass of sequential quadratic programming):

    min ½ Σ δ_k² + ½ w (x_s - r + Σ g_k δ_k)²    subject to    low ≤ u_k + δ_k ≤ high,    |Δu_i + Δδ_i| ≤ R T_s

g_k is found by one rollout for each knot, so dead time, lags, a slew limit and the instants at which the stem is freed
and stops are in it. Stops that are far from the target take more than one pass.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from positioner.laws.nmpc.stop import limited, stop_of
from positioner.optimization.qp import QuadraticProgram
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.laws.nmpc.move import Limits
    from positioner.laws.nmpc.stop import Stop, Task
    from positioner.optimization.qp import Solver
    from positioner.valve.rollout import Moving, Rollout

KNOTS = 8
"""Inputs of the programme: each costs a rollout, and a bisection to 0.4 % of a sample takes as many."""
_WEIGHT = 1e3
"""w, in units of the largest g: the programme leaves a thousandth of the error that it can remove."""
_TRIALS = 8
"""Of how far to go: the regula falsi of Illinois triples its digits in three (Dowell and Jarratt 1971)."""
_OF_RANGE = 0.5
"""g is the slope over half of the way to the limit, so that an actuator at its slew limit has one."""
_LEAST_M_PER_MA = 1e-9
"""Changes that move the stop by less do not matter."""
NEAR = 1e-4
"""Of span: near enough to the target, half of the least σ of a stop."""
_FREE_MA = 1e6
"""A bound that is never reached."""


@dataclass(frozen=True, slots=True)
class StopPlanner:
    """Puts stops at their targets, within `within_m`; solver: for `KNOTS` inputs and as many outputs."""

    solver: Solver
    limits: Limits
    within_m: float

    def placed(
        self, rollout: Rollout, task: Task, begun: Moving, planned: tuple[float, ...]
    ) -> tuple[tuple[float, ...], Stop, int]:
        """Return the currents in mA that put the stop nearest to the target, that stop, and the programmes solved.

        Args:
            rollout: the motion of the valve.
            task: the move.
            begun: where the stem is.
            planned: the currents of the next samples to begin with.
        """
        stop = stop_of(rollout, task, planned, begun)
        error_m = stop.position_m - task.target_m
        if abs(error_m) < self.within_m:
            return planned, stop, 0
        line = Line.until(max(stop.ends, 1), limited(task, planned, stop.ends))
        changes = self._changes(rollout, task, begun, line, error_m)
        best = planned, stop
        if changes is None:
            return *best, 0
        ends, part, last = [(0.0, error_m), (math.inf, 0.0)], 1.0, -1
        for _ in range(_TRIALS):
            wanted = line.changed([part * change for change in changes])
            currents = limited(task, tuple(map(self.limits.clipped, wanted)), len(wanted))
            stop = stop_of(rollout, task, currents, begun)
            missed_m = stop.position_m - task.target_m
            if abs(missed_m) < abs(best[1].position_m - task.target_m):
                best = currents, stop
            if abs(missed_m) < self.within_m:
                break
            side = 0 if missed_m * error_m > 0.0 else 1
            if side == last and ends[1][0] < math.inf:
                other, other_m = ends[1 - side]
                ends[1 - side] = other, 0.5 * other_m
            ends[side], last = (part, missed_m), side
            (near, near_m), (far, far_m) = ends
            part = (near * far_m - far * near_m) / (far_m - near_m) if far < math.inf else 2.0 * part
        return *best, 1

    def _changes(self, rollout: Rollout, task: Task, begun: Moving, line: Line, error_m: float) -> list[float] | None:
        """Return by how much the currents are to change at the knots, None where they do not move the stop."""
        free, goes_up = replace(task, step_ma=math.inf), error_m < 0.0
        end_ma, slopes = self.limits.high_ma if goes_up else self.limits.low_ma, list[float]()
        before_m = task.target_m + error_m
        for knot, sample in enumerate(line.knots):
            step_ma = _OF_RANGE * (end_ma - line.planned[sample])
            changed = line.changed([step_ma if each == knot else 0.0 for each in range(len(line.knots))])
            moved = stop_of(rollout, free, changed, begun)
            slopes.append((moved.position_m - before_m) / step_ma if step_ma and moved.freed >= 0 else 0.0)
        unit_m = max(map(abs, slopes))
        if unit_m < _LEAST_M_PER_MA:
            return None
        program = programme(line, task, self.limits, [slope / unit_m for slope in slopes], error_m / unit_m)
        return self.solver.solve(program, (0.0,) * KNOTS, (0.0,) * (2 * KNOTS))


@dataclass(frozen=True, slots=True)
class Line:
    """Planned currents in mA, and the samples of the knots; after the last one changes go to 0 until `end`."""

    planned: tuple[float, ...]
    knots: tuple[int, ...]
    end: int

    @staticmethod
    def until(end: int, planned: tuple[float, ...]) -> Line:
        """Return the line whose knots are evenly spaced until a sample; no two of them are in the same one."""
        return Line(planned, tuple(sorted({knot * end // KNOTS for knot in range(KNOTS)})), end)

    def changed(self, changes: Sequence[float]) -> tuple[float, ...]:
        """Return the currents with these changes at the knots, and straight lines between them."""
        found = list(self.planned)
        for knot in range(len(self.knots)):
            is_last = knot + 1 == len(self.knots)
            begin, end = self.knots[knot], self.end if is_last else self.knots[knot + 1]
            change, after = changes[knot], 0.0 if is_last else changes[knot + 1]
            for sample in range(begin, end):
                found[sample] += change + (after - change) * (sample - begin) / (end - begin)
        return tuple(found)


def programme(line: Line, task: Task, limits: Limits, slopes: list[float], error_ma: float) -> QuadraticProgram:
    """Return the programme in δ, whose outputs are the changes from knot to knot; spare inputs are held at 0.

    slopes: g over its largest value; error_ma: x_s - r over it.
    """
    spare = KNOTS - len(line.knots)
    hessian, rows, slopes = list[float](), list[float](), slopes + [0.0] * spare
    low, high, most_down, most_up = list[float](), list[float](), list[float](), list[float]()
    begin, before_ma = -1, task.before_ma
    for k in range(KNOTS):
        hessian += [_WEIGHT * slopes[j] * slopes[k] + (j == k) for j in range(k + 1)]
        rows += [1.0, 1.0, -1.0, *[0.0] * KNOTS][: KNOTS - k + 1]
    for knot in line.knots:
        steps = [after - before for before, after in pairwise((before_ma, *line.planned[begin + 1 : knot + 1]))]
        low.append(min(limits.low_ma - line.planned[knot], 0.0))
        high.append(max(limits.high_ma - line.planned[knot], 0.0))
        most_down.append(max(-len(steps) * (task.step_ma + min(steps)), -_FREE_MA))
        most_up.append(min(len(steps) * (task.step_ma - max(steps)), _FREE_MA))
        begin, before_ma = knot, line.planned[knot]
    none, free = [0.0] * spare, [_FREE_MA] * spare
    linear = [_WEIGHT * error_ma * slope for slope in slopes]
    down = [-each for each in free]
    return QuadraticProgram(hessian, linear, rows, low + none + most_down + down, high + none + most_up + free)
