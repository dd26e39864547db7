"""Manual mode: the host gives the current instead of the law, within the guard's limits. Pure.

The host sends MANUAL_CURRENT as long as manual mode lasts; a frame with the request AUTO ends it. An actuator without a
sensor can still be moved by hand, so manual mode needs no feedback. Arming begins in manual mode if the host asks for
it at that time, else in automatic mode.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.wire.messages import ManualRequest

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.wire.messages import ManualCurrent

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Manual:
    """The current that the host asks for by hand, and when it last asked; both None in automatic mode."""

    current_ma: float | None = None
    received_ns: int | None = None


AUTOMATIC = Manual()


def update_manual(manual: Manual, asked: ManualCurrent | None, now_ns: int) -> Manual:
    """Return the manual request after the newest MANUAL_CURRENT, `asked`, which is None where none came."""
    if asked is None:
        return manual
    return Manual(asked.current_ma, now_ns) if asked.request is ManualRequest.MANUAL else AUTOMATIC


def is_fresh(settings: GuardSettings, manual: Manual, now_ns: int) -> bool:
    """Return whether the host asks for manual mode right now: within `setpoint_hold_s`."""
    if manual.received_ns is None:
        return False
    return settings.setpoint_hold_s == 0.0 or now_ns - manual.received_ns <= settings.setpoint_hold_s * _NS
