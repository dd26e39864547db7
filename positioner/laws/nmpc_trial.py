"""Whether a move has happened: the stem where it was meant to go, or still where it stood. Pure.

A push that fails to free the stem must not teach that friction slows it, and small moves hide in the noise. So the
average of a stem that never moved is carried along, and the likelihood of both is weighed, reading by reading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

from positioner.adaptive_estimate import average

if TYPE_CHECKING:
    from positioner.adaptive_estimate import Resting


class Verdict(Enum):
    """What the readings say so far."""

    OPEN = "open"
    MOVED = "moved"
    STUCK = "stuck"


@dataclass(frozen=True, slots=True)
class Trial:
    """A move that is not yet sure to have happened.

    origin: the estimate of a stem that did not move. direction: ±1, of the move.
    push_n: what it was pushed with beyond its spring. at_limit: that was no more than Γ asks for.
    evidence: log likelihood ratio, positive when it moved.
    """

    origin: Resting
    direction: float
    push_n: float
    at_limit: bool
    evidence: float = 0.0


def judge(
    trial: Trial, moved: Resting, measured_m: float, variance_m2: float, threshold: float
) -> tuple[Trial, Verdict]:
    """Return the trial after a reading, and the verdict; `moved` is the estimate of a stem that did move."""
    evidence = (
        trial.evidence
        + _log_likelihood(moved, measured_m, variance_m2)
        - _log_likelihood(trial.origin, measured_m, variance_m2)
    )
    trial = replace(trial, origin=average(trial.origin, measured_m, variance_m2), evidence=evidence)
    if abs(evidence) < threshold:
        return trial, Verdict.OPEN
    return trial, Verdict.MOVED if evidence > 0.0 else Verdict.STUCK


def _log_likelihood(stem: Resting, measured_m: float, variance_m2: float) -> float:
    variance = stem.variance_m2 + variance_m2
    error = measured_m - stem.x
    return -0.5 * (error * error / variance + math.log(variance))
