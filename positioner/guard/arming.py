"""Arming, by the host's requests or automatically. Pure.

An ARM counts when it follows another request. A held ARM therefore arms once; one that was held already when this
positioner started does not arm it, or a restart would end a latched FAILSAFE.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.guard.manual import AUTOMATIC, is_fresh
from positioner.guard.state import Arming, GuardState
from positioner.values import replace
from positioner.wire.messages import HostRequest, Mode

DOUBLE_ARMING_NS = 1_000_000_000
"""A foreign command so soon after the arming, or after a command like ours, is a second daemon's; both disarm."""

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.guard.settings import GuardSettings
    from positioner.guard.state import GuardInput


def arm(settings: GuardSettings, state: GuardState, guard_input: GuardInput, hold_ns: float, now_ns: int) -> GuardState:
    """Return the state after the requests of a batch, in their order, and the automatic arming, which happens once."""
    arming, last = state.arming, state.last
    disarmed = HostRequest.DISARM in guard_input.requests
    if disarmed or guard_input.stray_disarm:
        # a DISARM out of sequence may be an old frame: it disarms, but a held ARM does not count as new after it
        return _disarmed(state, request=HostRequest.DISARM if disarmed else arming.request)
    if arming.armed and guard_input.foreign_command and now_ns - arming.armed_or_returned_ns <= DOUBLE_ARMING_NS:
        return _disarmed(state, request=arming.request)
    fresh = last.feedback_ns is not None and now_ns - last.feedback_ns <= hold_ns
    by_hand = is_fresh(settings, state.manual, now_ns)
    fresh = fresh or (by_hand and last.feedback_ns is not None)  # a valve whose sensor has died can be moved by hand
    request = arming.request if guard_input.waiting_request is None else guard_input.waiting_request
    request, asked = _latest_request(request, guard_input.requests, fresh=fresh)
    if request is not arming.request:
        state = replace(state, arming=replace(arming, request=request))
    wanted = asked or (settings.auto_arm and not arming.ever_armed and request is not HostRequest.DISARM)
    if not wanted or not fresh or last.foreign_ns is not None:
        return state
    if arming.armed and state.mode is not Mode.FAILSAFE:
        return state
    return GuardState(
        mode=Mode.HOLD,  # pragma: no mutate - anything but FAILSAFE: the transition table decides
        arming=Arming(armed=True, ever_armed=True, request=request, armed_or_returned_ns=now_ns),
        last=replace(last, setpoint_ns=now_ns),  # the host has `setpoint_hold_s` from now on to send a setpoint
        law=replace(state.law, failures=0, late_answers=0),
        manual=state.manual if by_hand else AUTOMATIC,
        conditions=state.conditions,
    )


def _disarmed(state: GuardState, *, request: HostRequest | None) -> GuardState:
    return replace(
        state,
        arming=replace(state.arming, armed=False, request=request),
        mode=Mode.READY,  # pragma: no mutate - anything but FAILSAFE: the transition table decides
    )


def _latest_request(
    before: HostRequest | None, requests: Iterable[HostRequest], *, fresh: bool
) -> tuple[HostRequest | None, bool]:
    """Return the request in force after `requests`, and whether one of them was a new request to arm.

    An ARM that comes before the feedback is not used up: its repetition counts.
    """
    asked = False
    for request in requests:
        if request is not HostRequest.ARM:
            before = request
        elif fresh and before is not None and before is not request:
            before, asked = request, True
    return before, asked
