"""S and J of a valve from its slips, by robust least squares. Pure.

A stem at x slips when u = c + k·x_before + s·F_s/B, and stops when u = c + k·x_after + s·F_c/B; s = ±1. In the units of
the command S = (F_s + F_c)/B and J = (F_s - F_c)/B (Choudhury, Thornhill and Shah 2005). A loop that swings between two
places gives k·(x_after - x_before) = J and no more, so a travel gain that is known, however roughly, counts as a row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.verdict import Estimate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.diagnostics.direct.slips import Slip

Array = NDArray[np.float64]

_NORMAL_95 = 1.96
_HUBER = 1.5
_COARSE = 0.95
"""Of half a step of the command: in a regular cycle every slip may come at the same place within a step."""
_ROUNDS = 30


@dataclass(frozen=True, slots=True)
class Friction:
    """What the slips say, in the units of the command; slope is k, offset is c.

    residual: the robust standard deviation of what the equations leave.
    """

    stick: Estimate
    jump: Estimate
    slope: float
    offset: float
    residual: float

    @property
    def static(self) -> float:
        """F_s/B, half the width of the stick band."""
        return 0.5 * (self.stick.value + self.jump.value)

    @property
    def sliding(self) -> float:
        """F_c/B."""
        return 0.5 * (self.stick.value - self.jump.value)


def friction_of(slips: Sequence[Slip], noise: float, slope: float, slope_sigma: float) -> Friction:
    """Return S and J of at least three slips in both directions.

    noise: standard deviation of a reading. slope, slope_sigma: what is known of k beforehand, and how well.
    """
    rows, commands, places, lengths = [], [], [], []
    for slip in slips:
        rows += [(1.0, slip.before.place, slip.direction, 0.0), (1.0, slip.after.place, 0.0, slip.direction)]
        commands += [slip.command_at_slip, slip.command_at_stop]
        places += [slip.half_step / math.sqrt(3.0), slip.stop_step / math.sqrt(3.0)]
        lengths += [slip.before.end - slip.before.begin, slip.after.end - slip.after.begin]
    matrix, command, step = np.array(rows), np.array(commands), np.array(places)
    reading = noise * noise / np.array(lengths)
    middle = float(np.mean(matrix[:, 1]))
    matrix[:, 1] -= middle
    found, weight, scale = np.array([0.0, slope, 0.0, 0.0]), np.ones(command.size), 1.0
    inverse = np.eye(4)
    for _ in range(_ROUNDS):
        variance = step * step + reading * found[1] * found[1] + 1e-12
        trust = weight / variance
        normal = matrix.T @ (matrix * trust[:, None])
        # the places carry noise, too: without this term it would make the slope too small
        known = np.delete(normal[1], 1)
        others = np.delete(np.delete(normal, 1, 0), 1, 1) + 1e-12 * np.eye(3)
        alone = float(normal[1, 1] - known @ np.linalg.solve(others, known))
        normal[1, 1] += 1.0 / (slope_sigma * slope_sigma) - min(float(trust @ reading), 0.5 * max(alone, 0.0))
        inverse = np.linalg.inv(normal + 1e-12 * np.eye(4))
        found = inverse @ (matrix.T @ (trust * command) + np.array([0.0, slope / slope_sigma**2, 0.0, 0.0]))
        off = (command - matrix @ found) / np.sqrt(variance)
        scale = max(1.4826 * float(np.median(np.abs(off))), 1e-6)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(off), 1e-12))
    residual = 1.4826 * float(np.median(np.abs(command - matrix @ found)))
    spread = inverse * max(scale, 1.0) ** 2
    sums, differences = np.array([0.0, 0.0, 1.0, 1.0]), np.array([0.0, 0.0, 1.0, -1.0])
    coarse = _COARSE * float(np.median([slip.half_step for slip in slips]))
    stick, jump = (
        Estimate(float(each @ found), math.hypot(_NORMAL_95 * math.sqrt(float(each @ spread @ each)), coarse))
        for each in (sums, differences)
    )
    return Friction(stick, jump, float(found[1]), float(found[0] - found[1] * middle), residual)
