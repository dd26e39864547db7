"""Commands that act late: the echo in the reading names the one that acted, so those sent since then are yet to act.

A valve that acts one sample late or two is planned for from where its stem will be when this cycle's command acts: the
pending commands act until then, each for one sample. A single command that misses its instant is another matter: the
next one takes its place. So a number of pending commands counts once it has been the same for some cycles.

A push that has not acted yet has not freed the stem. While it is pending, the stem rests; a push that was lost begins
again, and nothing is learned from it. Pure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.filter import average
from positioner.laws.nmpc.memory import report
from positioner.values import replace
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.law import Estimate, Observation
    from positioner.laws.nmpc.filter import AdaptiveFilter, Sliding
    from positioner.laws.nmpc.memory import NmpcMemory

_SAME_MA = 2e-3
"""Currents that differ by less are the same one, after the rounding of a frame."""


def with_lateness(memory: NmpcMemory, observation: Observation) -> NmpcMemory:
    """Return the memory with what this reading tells of how late commands act."""
    late = len(observation.pending_ma)
    if memory.lateness.is_just(late):
        return memory
    return replace(memory, lateness=memory.lateness.followed_by(late))


def pending_ma(memory: NmpcMemory, observation: Observation) -> tuple[float, ...]:
    """Return the currents in mA that act before this cycle's command, each for one sample."""
    return observation.pending_ma[: memory.lateness.samples]


def with_current_of_rest(memory: NmpcMemory, observation: Observation) -> NmpcMemory:
    """Return the memory with the current under which the stem rests; before the first command of all, what acts."""
    return replace(memory, hold_ma=observation.applied_ma) if memory.hold_ma is None else memory


def is_push_late(memory: NmpcMemory, stem: Sliding, observation: Observation) -> bool:
    """Return whether the move of `stem` has begun for the law alone: what acted is the current of the rest before."""
    begins = memory.monitor.verification is not None and stem.v == 0.0
    return begins and memory.hold_ma is not None and abs(observation.applied_ma - memory.hold_ma) < _SAME_MA


def still_resting(
    filtered: AdaptiveFilter, memory: NmpcMemory, stem: Sliding, observation: Observation, variance_m2: float
) -> tuple[NmpcMemory, Estimate]:
    """Return memory and estimate of a stem that still rests where the move is to begin, after this cycle's reading.

    Where the push is pending, the move has begun; else it begins again.
    """
    verification, monitor = memory.monitor.verification, memory.monitor
    assert verification is not None  # noqa: S101 - of the push that is late
    rest = average(verification.origin, observation.measured_m, variance_m2)
    pending, hold_ma = pending_ma(memory, observation), memory.hold_ma
    assert hold_ma is not None  # noqa: S101 - of the push that is late
    if pending and abs(pending[-1] - hold_ma) >= _SAME_MA:
        begun = replace(filtered.depart(rest, stem.direction, stem.unforeseen), load=stem.load)
        monitor = replace(monitor, verification=replace(verification, origin=rest))
        return replace(memory, stem=begun, monitor=monitor), report(begun)
    monitor = replace(monitor, verification=None, landing=None)
    corrections = memory.corrections - 1
    return replace(memory, stem=rest, monitor=monitor, motion=Motion.REST, corrections=corrections), report(rest)


def ahead(
    filtered: AdaptiveFilter, memory: NmpcMemory, stem: Sliding, observation: Observation, period_s: float
) -> Sliding:
    """Return the stem when this cycle's command begins to act; its covariance is that of now."""
    x, v, load, s = stem.x, stem.v, stem.load, stem.direction
    pending, is_stopped = pending_ma(memory, observation), False
    if not pending:
        return stem
    for current_ma in pending:
        end = filtered.model.step(x, v, current_ma, load, s, period_s)
        is_stopped = end.stopped and (is_stopped or v != 0.0)
        x, v = end.x, end.v
    return replace(stem, x=x, v=v, stopped=is_stopped)
