"""Arming: what the host's request, or the automatic arming, makes of the guard's state. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.wire.messages import HostRequest, Mode

if TYPE_CHECKING:
    from positioner.guard_settings import GuardSettings
    from positioner.guard_state import GuardState, Sighting


def arm(settings: GuardSettings, state: GuardState, seen: Sighting, hold_ns: float, now_ns: int) -> GuardState:
    """Apply a request of the host, which counts when it changes, and the automatic arming, which happens once."""
    asked = seen.request if seen.request is not state.request else None
    fresh = state.feedback_ns is not None and now_ns - state.feedback_ns <= hold_ns
    if asked is not None and (fresh or asked is not HostRequest.ARM):
        # an ARM that comes before the feedback is not used up: its repetition will be heard
        state = replace(state, request=asked)
    if asked is HostRequest.DISARM:
        return replace(
            state,
            armed=False,
            mode=Mode.READY,  # pragma: no mutate - anything but FAILSAFE: the table decides
        )
    wanted = asked is HostRequest.ARM or (settings.auto_arm and not state.ever_armed)
    if not wanted or not fresh or state.foreign_ns is not None:
        return state
    if state.armed and state.mode is not Mode.FAILSAFE:
        return state
    # arming starts the setpoint's age anew: the host has this long to send one
    return replace(
        state,
        armed=True,
        ever_armed=True,
        mode=Mode.HOLD,  # pragma: no mutate - anything but FAILSAFE: the table decides
        setpoint_ns=now_ns,
        law_failures=0,
    )
