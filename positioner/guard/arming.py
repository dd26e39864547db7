"""Arming: what the host's requests, or the automatic arming, make of the guard's state. Pure.

A request to arm counts when it follows another request: an ARM that is held arms once, and one that was already held
when this positioner started does not arm it, or a restart would undo the latch of FAILSAFE.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.guard.manual import AUTOMATIC, is_fresh
from positioner.wire.messages import HostRequest, Mode

DOUBLE_ARMING_NS = 1_000_000_000
"""Another's command within this time after the arming, or after one like ours, is a twin's; both fall silent."""

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.guard.settings import GuardSettings
    from positioner.guard.state import GuardInput, GuardState


def arm(settings: GuardSettings, state: GuardState, guard_input: GuardInput, hold_ns: float, now_ns: int) -> GuardState:
    """Return the state after the requests of a batch, in their order, and the automatic arming, which happens once."""
    disarmed = HostRequest.DISARM in guard_input.requests
    if disarmed or guard_input.stray_disarm:
        # a stray one disarms, and is no request that an ARM could follow: it may be as old as the bus can be
        return replace(
            state,
            armed=False,
            request=HostRequest.DISARM if disarmed else state.request,
            mode=Mode.READY,  # pragma: no mutate - anything but FAILSAFE: the table decides
        )
    if state.armed and guard_input.foreign_command and now_ns - state.armed_or_returned_ns <= DOUBLE_ARMING_NS:
        return replace(state, armed=False, mode=Mode.READY)
    fresh = state.feedback_ns is not None and now_ns - state.feedback_ns <= hold_ns
    by_hand = is_fresh(settings, state.manual, now_ns)
    fresh = fresh or (by_hand and state.feedback_ns is not None)  # a valve whose sensor has died can be moved by hand
    request, asked = _follow(
        state.request if guard_input.waited is None else guard_input.waited, guard_input.requests, fresh=fresh
    )
    if request is not state.request:
        state = replace(state, request=request)
    wanted = asked or (settings.auto_arm and not state.ever_armed and request is not HostRequest.DISARM)
    if not wanted or not fresh or state.foreign_ns is not None:
        return state
    if state.armed and state.mode is not Mode.FAILSAFE:
        return state
    # arming starts the setpoint's age anew: the host has this long to send one
    return replace(
        state,
        armed=True,
        ever_armed=True,
        armed_or_returned_ns=now_ns,
        mode=Mode.HOLD,  # pragma: no mutate - anything but FAILSAFE: the table decides
        setpoint_ns=now_ns,
        law_failures=0,
        late_answers=0,
        manual=state.manual if by_hand else AUTOMATIC,
    )


def _follow(
    before: HostRequest | None, requests: Iterable[HostRequest], *, fresh: bool
) -> tuple[HostRequest | None, bool]:
    """Return the request in force after `requests`, and whether one of them was a new request to arm.

    An ARM that comes before the feedback is not used up: its repetition will be heard.
    """
    asked = False
    for request in requests:
        if request is not HostRequest.ARM:
            before = request
        elif fresh and before is not None and before is not request:
            before, asked = request, True
    return before, asked
