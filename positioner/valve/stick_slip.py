"""Edges between sticking and sliding, and what each teaches (paper §5.1). Pure.

"Every moment a valve stop is detected, the algorithm records the position and speed of the valve stem (at the moment
before [its] speed becomes null)"; "whenever a slip occurs, the control action Γ applied at the moment [...] is stored".
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.valve.stiction import LearnedSample, Quantity, direction_of

if TYPE_CHECKING:
    from positioner.valve.state import StemState


def edge_lessons(before: StemState, after: StemState, applied_ma: float) -> tuple[LearnedSample, ...]:
    """Return what the step from `before` to `after` under `applied_ma` teaches; nothing between edges.

    A stop teaches the speed just before it, at the place where the stem came to rest. A slip teaches the current that
    caused it, at the place where the stem rested. A stop without a speed before it teaches nothing.
    """
    if after.stuck and not before.stuck and before.velocity_m_per_s:
        direction = direction_of(before.velocity_m_per_s)
        return (LearnedSample(Quantity.STICK_SPEED, after.position_m, direction, abs(before.velocity_m_per_s)),)
    if before.stuck and not after.stuck:
        direction = direction_of(after.direction)
        return (LearnedSample(Quantity.BREAKAWAY_CURRENT, before.position_m, direction, applied_ma),)
    return ()
