"""Whether a verb can be done now, and what is told when it can. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.errors import HostError
from positioner.host.verbs import Verb, Word, refusal
from positioner.host.words import in_mm
from positioner.inputs.durations import duration
from positioner.wire.messages import CurrentCommand, Mode, Setpoint, StemPosition

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.host.valve_view import ValveView
    from positioner.valve.parameters import ValveParameters

_SIGNAL_MA = 16.0
"""Range of the loop current: 4 to 20 mA."""
_NO_POSITION = "no position frames come: is this the right bus, and is the plant on?"


def check_possible(verb: Verb, view: ValveView, now_ns: int, *, is_sending: bool, is_by_hand: bool) -> None:
    """Refuse a verb that sends frames where it cannot be done now; `is_by_hand`: this host gives the current.

    Raises:
        HostError: it cannot be done; the message says why.
    """
    word, mode = verb.word, view.mode(now_ns)
    if not is_sending and view.is_received(Setpoint, now_ns):
        raise HostError(f"{word}: another host sends setpoints to this valve: stop it first")
    if word is not Word.MANUAL and not is_by_hand and not view.is_received(StemPosition, now_ns):
        raise HostError(f"{word}: {_NO_POSITION}")
    if word is Word.PROFILE and not view.is_controlled(now_ns):
        raise HostError("profile: the positioner is not armed: use `arm` first")
    if (word in {Word.SET, Word.PROFILE} and is_by_hand) or (word is Word.PROFILE and mode is Mode.MANUAL):
        raise HostError(f"{word}: the valve is in manual mode: use `auto` first")
    if word is Word.AUTO and not is_by_hand and mode is not Mode.MANUAL:
        raise HostError("auto: the valve is in automatic mode already")


def check_request(verb: Verb, view: ValveView) -> None:
    """Refuse to arm and disarm where the user's setpoint frame has no signal for that.

    Raises:
        HostError: it has none.
    """
    if verb.word in {Word.ARM, Word.DISARM} and not view.can_arm:
        text = "[wire.setpoint] maps no signal to `request`: map one, or set guard.auto_arm"
        raise HostError(f"{verb.word}: your setpoint message cannot ask for it: {text}")


def manual_current_ma(verb: Verb, view: ValveView, now_ns: int) -> float:
    """Return the current that MANUAL begins with: its own, or the present one.

    Raises:
        HostError: there is no present one.
    """
    if verb.current_ma is not None:
        return verb.current_ma
    if view.command is None or not view.is_received(CurrentCommand, now_ns):
        raise HostError("manual: there is no present current to keep: give one, as in `manual 9.5mA`")
    return view.command.current_ma


def stepped(
    verb: Verb, manual_ma: float | None, from_m: float | None, valve: ValveParameters, guard: GuardSettings
) -> Verb:
    """Return the verb for a step of the setpoint in m, or of the current in mA where that is given by hand.

    Raises:
        HostError: there is nothing to step from, or the end of the reach is met.
    """
    part = verb.step_percent / 100.0
    if manual_ma is not None:
        current_ma = min(max(manual_ma + part * _SIGNAL_MA, guard.current_low_ma), guard.current_high_ma)
        return replace(verb, word=Word.MANUAL, current_ma=current_ma)
    if from_m is None:
        raise HostError(_NO_POSITION)
    setpoint_m = from_m + part * valve.span_m
    if why := refusal(setpoint_m, valve, guard):
        raise HostError(f"no step: {why}")
    return replace(verb, setpoint_m=setpoint_m)


def accepted(verb: Verb, manual_ma: float | None, span_m: float, *, is_controlled: bool) -> list[str]:
    """Return the line that tells a person what will be done, none for a step or where the status tells it."""
    unarmed = "" if is_controlled else "; it acts as soon as the positioner is armed: `arm`"
    if verb.step_percent:
        return []
    if verb.word is Word.SET:
        return [f"setpoint {in_mm(verb.setpoint_m, span_m)}{unarmed}"]
    if verb.word is Word.MANUAL:
        return [f"manual current {manual_ma:.3f} mA{unarmed}"]
    if verb.profile is not None:
        rounds = {0: ", again and again", 1: ""}.get(verb.repeats, f", {verb.repeats} times")
        lasts = duration(verb.profile.round_s)
        return [f"profile {verb.profile.name}: {len(verb.profile.rows)} setpoints in {lasts}{rounds}"]
    return []
