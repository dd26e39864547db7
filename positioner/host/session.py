"""The verbs at work: what each one sends, and which answer of the positioner completes it. Pure.

A session sends nothing before the first verb that needs it. Then it sends setpoints at their period until it ends or
disarms: the positioner goes to HOLD when they stay away. Time is an argument.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.errors import HostError
from positioner.host.schedule import FrameSchedule
from positioner.host.valve_view import SILENT_S, ValveView
from positioner.host.verbs import HELP, Verb, Word
from positioner.host.words import in_mm, state_in_words
from positioner.wire.messages import (
    CurrentCommand,
    HostRequest,
    ManualCurrent,
    ManualRequest,
    Mode,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.config.schema import Configuration
    from positioner.wire.messages import CanFrame

RELEASED_S = 0.1
"""How long another request is sent before ARM: an ARM counts only if it follows another request."""
ANSWER_S = 3.0
"""Allowed time for the positioner to do what a verb asks for."""
STATUS_S = 1.0
"""Allowed time for a status, which is sent ten times a second."""
_NS = 1_000_000_000
_PASSIVE = frozenset({Word.STATUS, Word.HELP, Word.QUIT})
"""Verbs that send nothing."""


class HostSession:
    """One person at one valve. The terminal prints `lines` and empties it."""

    def __init__(self, configuration: Configuration) -> None:
        """Begin with nothing received and nothing to send."""
        codec = configuration.make_codec()
        self._valve = configuration.valve
        self._schedule = FrameSchedule(codec, configuration.guard.setpoint_hold_s)
        self._verb: Verb | None = None
        self._began_ns = 0
        self._was_controlled = False
        self._setpoint_m: float | None = None
        self._manual_ma: float | None = None
        self._state_line = ""
        self._has_reported_other_host = False
        self.view = ValveView(codec, configuration.valve.span_m)
        self.is_sending = False
        self.lines: list[str] = []

    @property
    def is_busy(self) -> bool:
        """Whether a verb is not done yet."""
        return self._verb is not None

    def receive(self, frames: Iterable[CanFrame], now_ns: int) -> None:
        """Take in `frames`, and report what has changed."""
        view = self.view
        view.receive(frames, now_ns)
        if view.status is not None:
            there = view.is_received(PositionerStatus, now_ns)
            line = state_in_words(view.status) if there else "the positioner is silent"
            if line != self._state_line:
                self._state_line = line
                self.lines.append(line)
        if self.is_sending and not self._has_reported_other_host and view.is_received(Setpoint, now_ns):
            self._has_reported_other_host = True
            self.lines.append("another host sends setpoints to this valve, too: stop one of them")

    def begin(self, verb: Verb, now_ns: int) -> None:
        """Begin `verb`; `advance` completes it.

        Raises:
            HostError: the verb cannot be done now.
        """
        view = self.view
        sends = verb.word not in _PASSIVE and verb.word is not Word.DISARM
        if sends:
            self._check_possible(verb, now_ns)
        self._was_controlled = view.is_controlled(now_ns)
        unarmed = "" if self._was_controlled else "; it acts as soon as the positioner is armed: `arm`"
        match verb.word:
            case Word.SET:
                self._setpoint_m = verb.setpoint_m
                self.lines.append(f"setpoint {in_mm(verb.setpoint_m, self._valve.span_m)}{unarmed}")
            case Word.MANUAL:
                self._manual_ma = self._manual_current_ma(verb, now_ns)
                self._schedule.at_once(ManualCurrent)
                self.lines.append(f"manual current {self._manual_ma:.3f} mA{unarmed}")
            case Word.AUTO:
                if self._manual_ma is None:
                    self._setpoint_m = self._here_m()
                # a setpoint that comes after AUTO counts as a new one and moves the stem: send it before
                self._schedule.at_once(Setpoint)
                self._schedule.at_once(ManualCurrent)
            case Word.HELP:
                self.lines += HELP.splitlines()
            case Word.STATUS:
                self.lines[:] = [line for line in self.lines if line != self._state_line]  # the status begins with it
            case _:
                pass
        if self._setpoint_m is None:
            self._setpoint_m = self._here_m()
        self.is_sending |= sends  # not before the verb is accepted: a refused one sends nothing
        self._verb, self._began_ns = verb, now_ns

    def advance(self, now_ns: int) -> tuple[CanFrame, ...]:
        """Return the frames that are due, and complete the verb where the positioner has answered.

        Raises:
            HostError: the verb was not done in time; the message says why.
        """
        verb = self._verb
        if verb is not None:
            elapsed_s = (now_ns - self._began_ns) / _NS
            if self._is_done(verb, elapsed_s, now_ns):
                self._end(verb, now_ns)
            elif elapsed_s > (STATUS_S if verb.word is Word.STATUS else ANSWER_S):
                self._verb = None
                raise HostError(f"{verb.word}: {self._why_not(now_ns)}")
        return self._frames(now_ns)

    def _check_possible(self, verb: Verb, now_ns: int) -> None:
        view = self.view
        if not self.is_sending and view.is_received(Setpoint, now_ns):
            raise HostError(f"{verb.word}: another host sends setpoints to this valve: stop it first")
        by_hand = verb.word is Word.MANUAL or self._manual_ma is not None
        if not by_hand and not view.is_received(StemPosition, now_ns):
            raise HostError(f"{verb.word}: no position frames come: is this the right bus, and is the plant on?")
        if verb.word is Word.SET and self._manual_ma is not None:
            raise HostError("set: the valve is in manual mode: use `auto` first")
        if verb.word is Word.AUTO and self._manual_ma is None and view.mode(now_ns) is not Mode.MANUAL:
            raise HostError("auto: the valve is in automatic mode already")

    def _manual_current_ma(self, verb: Verb, now_ns: int) -> float:
        command = self.view.command
        if verb.current_ma is not None:
            return verb.current_ma
        if command is None or not self.view.is_received(CurrentCommand, now_ns):
            raise HostError("manual: there is no present current to keep: give one, as in `manual 9.5mA`")
        return command.current_ma

    def _here_m(self) -> float | None:
        here_m = self.view.position_m
        return None if here_m is None else min(max(here_m, self._valve.travel_min_m), self._valve.travel_max_m)

    def _is_done(self, verb: Verb, elapsed_s: float, now_ns: int) -> bool:
        view = self.view
        answered = view.received_since(PositionerStatus, self._began_ns)
        mode = view.mode(now_ns)
        match verb.word:
            case Word.ARM:
                return answered and view.is_controlled(now_ns)
            case Word.MANUAL:
                return not self._was_controlled or (answered and mode is Mode.MANUAL)
            case Word.AUTO:
                return not self._was_controlled or (answered and mode is not Mode.MANUAL)
            case Word.DISARM:
                silenced = elapsed_s > SILENT_S and not view.is_received(CurrentCommand, now_ns)
                return silenced or (answered and mode in {Mode.INIT, Mode.READY})
            case Word.STATUS:
                return answered
            case _:
                return True

    def _end(self, verb: Verb, now_ns: int) -> None:
        self._verb = None
        match verb.word:
            case Word.ARM if self._was_controlled:
                self.lines.append("the positioner was armed already")
            case Word.AUTO:
                self._manual_ma = None
            case Word.DISARM:
                self.is_sending, self._setpoint_m, self._manual_ma = False, None, None
                self.lines.append("disarmed: the positioner commands nothing")
            case Word.STATUS:
                self.lines += self.view.lines(self._setpoint_m if self.is_sending else None, now_ns)
            case _:
                pass

    def _why_not(self, now_ns: int) -> str:
        status = self.view.status
        if status is None or not self.view.is_received(PositionerStatus, now_ns):
            return self.view.silence(now_ns)
        return f"not done within {ANSWER_S:g} s: {state_in_words(status)}"

    def _frames(self, now_ns: int) -> tuple[CanFrame, ...]:
        word = self._verb.word if self._verb else None
        if not self.is_sending and word is not Word.DISARM:
            return ()
        request = HostRequest.NONE
        if word is Word.DISARM:
            request = HostRequest.DISARM
        elif word is Word.ARM and now_ns - self._began_ns >= RELEASED_S * _NS:
            request = HostRequest.ARM
        if self._manual_ma is not None and word is not Word.AUTO:
            self._setpoint_m = self._here_m()  # automatic mode begins where the stem is
        setpoint_m = self._valve.travel_min_m if self._setpoint_m is None else self._setpoint_m
        frames = self._schedule.frame(Setpoint(setpoint_m, request), now_ns)
        if word is Word.AUTO:
            return frames + self._schedule.frame(ManualCurrent(self._manual_ma or 0.0, ManualRequest.AUTO), now_ns)
        if self._manual_ma is not None:
            return frames + self._schedule.frame(ManualCurrent(self._manual_ma), now_ns)
        return frames
