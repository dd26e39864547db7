"""Stalls: what a gap in the loop means for what was received meanwhile. Pure.

A process that stood still has not seen what happened: readings that waited describe a stem that has moved on. The guard
sees the gap first. Longer than `feedback_hold_periods`, the turn after it holds, whatever is in the queue; longer than
`feedback_failsafe_periods`, it fails safe, and no request to arm that waited undoes that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Freshness:
    """What counts as fresh at `now_ns`: readings and requests to arm that arrived at these instants or later."""

    now_ns: int = 0
    readings_since_ns: float = 0.0
    arms_since_ns: float = 0.0

    def arrived_ns(self, frame: CanFrame) -> int:
        """Return the instant at which `frame` arrived; one that was never on a bus arrives when it is handled."""
        return frame.received_ns or self.now_ns


def hold_ns(settings: GuardSettings, period_s: float) -> float:
    """Return the age in ns from which on feedback is too old to act on."""
    return settings.feedback_hold_periods * period_s * _NS


def failsafe_ns(settings: GuardSettings, period_s: float) -> float:
    """Return the age in ns from which on feedback is lost."""
    return settings.feedback_failsafe_periods * period_s * _NS


def stall_of(settings: GuardSettings, period_s: float, gap_ns: int, *, armed: bool) -> int:
    """Return the gap if it is a stall, in ns, else 0: while nothing is commanded, nothing old can be acted on."""
    return gap_ns if armed and gap_ns > hold_ns(settings, period_s) else 0


def freshness(settings: GuardSettings, period_s: float, now_ns: int, *, armed: bool, stalled: bool) -> Freshness:
    """Return what counts as fresh: nothing of what waited during a stall; an ARM ages only where it would rearm."""
    if stalled:
        return Freshness(now_ns, now_ns + 1, now_ns + 1)
    arms_since_ns = now_ns - failsafe_ns(settings, period_s) if armed else -float("inf")
    return Freshness(now_ns, now_ns - hold_ns(settings, period_s), arms_since_ns)
