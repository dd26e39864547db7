"""A push that was sent too late for its instant has not acted yet: the move begins again, and nothing is learned. Pure.

The echo in the reading names the command that acted. Without this, a late push would count as one that did not free
the stem, and would teach a larger static friction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.filter import average
from positioner.laws.nmpc.memory import report
from positioner.values import replace
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.law import Estimate, Observation
    from positioner.laws.nmpc.filter import Sliding
    from positioner.laws.nmpc.memory import NmpcMemory

_SAME_MA = 2e-3
"""Currents that differ by less are the same one, after the rounding of a frame."""


def is_push_late(memory: NmpcMemory, stem: Sliding, observation: Observation) -> bool:
    """Return whether the move of `stem` has begun for the law alone: what acted is the current of the rest before."""
    begins = memory.monitor.verification is not None and stem.v == 0.0
    return begins and memory.hold_ma is not None and abs(observation.applied_ma - memory.hold_ma) < _SAME_MA


def without_move(memory: NmpcMemory, observation: Observation, variance_m2: float) -> tuple[NmpcMemory, Estimate]:
    """Return memory and estimate of a stem that still rests where the move was to begin, after this cycle's reading."""
    verification = memory.monitor.verification
    assert verification is not None  # noqa: S101 - of the push that is late
    stem = average(verification.origin, observation.measured_m, variance_m2)
    return replace(
        memory,
        stem=stem,
        monitor=replace(memory.monitor, verification=None, landing=None),
        motion=Motion.REST,
        corrections=memory.corrections - 1,
    ), report(stem)
