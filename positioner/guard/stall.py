"""Stalls: which frames still count after the process stood still. Pure.

Readings that waited during a stall describe a stem that has moved on since. After a stall longer than
`feedback_hold_periods` the guard holds for a cycle, whatever has waited; after one longer than
`feedback_failsafe_periods` it fails safe, and no request to arm that waited ends that. While no command is sent there
is nothing to hold, and the age of each frame alone decides: an order that waited for as long does not count, either.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Freshness:
    """Which frames count at `now_ns`: readings, orders to arm and by hand that arrived then or later."""

    now_ns: int = 0
    readings_since_ns: float = 0.0
    orders_since_ns: float = 0.0

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
    """Return the gap in ns if it is a stall, else 0; there is none while no command is sent."""
    return gap_ns if armed and gap_ns > hold_ns(settings, period_s) else 0


def freshness(settings: GuardSettings, period_s: float, now_ns: int, *, stalled: bool) -> Freshness:
    """Return which frames count: none that waited during a stall, and armed or not, none that has become too old."""
    if stalled:
        return Freshness(now_ns, now_ns + 1, now_ns + 1)
    return Freshness(now_ns, now_ns - hold_ns(settings, period_s), now_ns - failsafe_ns(settings, period_s))
