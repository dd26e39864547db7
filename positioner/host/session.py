"""The verbs at work: what each one sends, and which answer of the positioner completes it. Pure.

A session sends nothing before the first verb that needs it. Then it sends setpoints at their period until it ends or
disarms: the positioner goes to HOLD when they stay away. Time is an argument.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.errors import HostError
from positioner.host.acceptance import accepted, check_possible, check_request, manual_current_ma, stepped
from positioner.host.schedule import FrameSchedule
from positioner.host.valve_view import SILENT_S, ValveView
from positioner.host.verbs import HELP, Verb, Word
from positioner.host.words import DISARMED_BY, end_line, state_in_words
from positioner.wire.messages import (
    CurrentCommand,
    HostRequest,
    ManualCurrent,
    ManualRequest,
    Mode,
    PositionerStatus,
    Setpoint,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.config.schema import Configuration
    from positioner.host.profile import Profile
    from positioner.host.snapshot import Snapshot
    from positioner.wire.messages import CanFrame

RELEASED_S = 0.1
"""How long another request is sent before ARM: an ARM counts only if it follows another request."""
ANSWER_S = 3.0
"""Allowed time for the positioner to do what a verb asks for."""
STATUS_S = 1.0
"""Allowed time for a status, which is sent ten times a second."""
_FIRST_FRAMES = 2
"""Where the positioner is not armed a host begins with so many DISARMs: only with them is a new sequence no fault."""
_NS = 1_000_000_000
_PASSIVE = frozenset({Word.STATUS, Word.HELP, Word.QUIT})
"""Verbs that send nothing."""


class HostSession:
    """One person at one valve. The terminal prints `lines` and empties it."""

    def __init__(self, configuration: Configuration) -> None:
        """Begin with nothing received and nothing to send."""
        codec = configuration.make_codec()
        self._valve, self._guard = configuration.valve, configuration.guard
        self._schedule = FrameSchedule(codec, configuration.guard.setpoint_hold_s)
        self._verb: Verb | None = None
        self._began_ns = 0
        self._was_controlled = False
        self._setpoint_m: float | None = None
        self._manual_ma: float | None = None
        self._state_line = ""
        self._has_reported_other_host = self._was_armed = False
        self.arm_as = "`arm`"  # how a person arms here
        self.view = ValveView(codec, configuration.valve)
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
                if there and self.is_sending and view.status.mode is Mode.FAILSAFE:
                    self.lines.append(f"FAILSAFE stays until the positioner is armed again: {self.arm_as}")
            if there and self.is_sending:
                self._follow_arming(view.status)
        if self.is_sending and not self._has_reported_other_host and view.is_received(Setpoint, now_ns):
            self._has_reported_other_host = True
            self.lines.append("another host sends setpoints to this valve, too: stop one of them")

    def _follow_arming(self, status: PositionerStatus) -> None:
        """End the setpoints where the positioner has been disarmed, and not by a verb of this host."""
        own = self._verb is not None and self._verb.word is Word.DISARM
        if self._was_armed and not status.armed and not own:
            self._stop_sending()
            why = DISARMED_BY.get(status.cause, "the positioner is not armed any more")
            self.lines.append(f"{why}: no more setpoints are sent; {self.arm_as} arms it again")
        elif status.armed:
            self._was_armed = True

    def _stop_sending(self) -> None:
        self.is_sending = self._was_armed = False
        self._setpoint_m = self._manual_ma = None

    def begin(self, verb: Verb, now_ns: int) -> None:
        """Begin `verb`; `advance` completes it.

        Raises:
            HostError: the verb cannot be done now.
        """
        view = self.view
        check_request(verb, view)
        sends = verb.word not in _PASSIVE and verb.word is not Word.DISARM
        if sends:
            by_hand = self._manual_ma is not None
            check_possible(verb, view, now_ns, is_sending=self.is_sending, is_by_hand=by_hand)
        self._was_controlled = view.is_controlled(now_ns)
        match verb.word:
            case Word.SET:
                self._setpoint_m = verb.setpoint_m
            case Word.MANUAL:
                self._manual_ma = manual_current_ma(verb, view, now_ns)
                self._schedule.at_once(ManualCurrent)
            case Word.AUTO:
                if self._manual_ma is None:
                    self._setpoint_m = self._here_m()
                # a setpoint that comes after AUTO counts as a new one and moves the stem: send it before
                self._schedule.at_once(Setpoint)
                self._schedule.at_once(ManualCurrent)
            case Word.HELP:
                self.tell(verb.word, now_ns)
            case Word.STATUS:
                self.lines[:] = [line for line in self.lines if line != self._state_line]  # the status begins with it
        self.lines += accepted(verb, self._manual_ma, self._valve.span_m, is_controlled=self._was_controlled)
        if self._setpoint_m is None:
            self._setpoint_m = self._here_m()
        if view.command is not None and view.is_received(CurrentCommand, now_ns):
            self._schedule.follow(view.command.setpoint_counter)
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
            if verb.profile is not None:
                self._follow(verb.profile, elapsed_s, now_ns)
            elif self._is_done(verb, elapsed_s, now_ns):
                self._end(verb, now_ns)
            elif elapsed_s > (STATUS_S if verb.word is Word.STATUS else ANSWER_S):
                self._verb = None
                raise HostError(f"{verb.word}: {self._state(now_ns, f'not done within {ANSWER_S:g} s: ')}")
        return self._frames(now_ns)

    def stepped(self, verb: Verb, now_ns: int) -> Verb:
        """Return the verb for a step of the setpoint, in manual mode of the current, in percent of its range.

        Raises:
            HostError: the positioner would not obey, there is nothing to step from, or the end is reached.
        """
        if not self.view.is_controlled(now_ns):
            arms = "" if self.view.mode(now_ns) is None else f"; {self.arm_as} arms it"
            raise HostError(f"no step: {self._state(now_ns)}{arms}")
        from_m = self._here_m() if self._setpoint_m is None else self._setpoint_m
        return stepped(verb, self._manual_ma, from_m, self._valve, self._guard)

    def progress(self, now_ns: int) -> str:
        """Return how far the profile is, nothing where none is played."""
        played = self.played(now_ns)
        return played[0].progress(played[1]) if played else ""

    def played(self, now_ns: int) -> tuple[Profile, float] | None:
        """Return the profile that is played, and for how long so far in s; None where none is."""
        verb = self._verb
        return (verb.profile, (now_ns - self._began_ns) / _NS) if verb and verb.profile else None

    def stop_profile(self, now_ns: int) -> None:
        """End the profile that is played, if one is; the setpoint stays."""
        if told := self.progress(now_ns):
            self._verb = None
            self.lines.append(f"profile {told}: stopped, the setpoint stays")

    def _follow(self, profile: Profile, elapsed_s: float, now_ns: int) -> None:
        """Set the setpoint of this instant, or end the profile.

        Raises:
            HostError: the positioner does not control the valve any more.
        """
        row = profile.row_at(min(elapsed_s, math.nextafter(profile.duration_s, 0.0)))
        if not self.view.is_controlled(now_ns) or self.view.mode(now_ns) is Mode.MANUAL:
            self._verb = None
            where = f"ended after {elapsed_s:.1f} s, in line {row.line}"
            raise HostError(f"profile {profile.name}: {where}: {self._state(now_ns)}")
        if row.setpoint_m != self._setpoint_m:
            self._setpoint_m = row.setpoint_m
            self._schedule.at_once(Setpoint)
        if elapsed_s >= profile.duration_s:
            self._verb = None
            self.lines.append(f"profile {profile.name}: done")

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
                self._stop_sending()
                self.lines.append("disarmed: the positioner commands nothing")
            case Word.STATUS:
                self.tell(verb.word, now_ns)

    def end_line(self, now_ns: int) -> str:
        """Return what becomes of the valve when this host ends."""
        status = self.view.status if self.view.is_received(PositionerStatus, now_ns) else None
        return end_line(status, self._guard)

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return what is known of the valve now."""
        return self.view.snapshot(self._setpoint_m if self.is_sending else None, now_ns)

    def tell(self, word: Word, now_ns: int) -> None:
        """Add the lines of HELP or STATUS."""
        found = self.snapshot(now_ns)
        told = [self.view.silence(now_ns)] if found.status is None else found.lines(found.status)
        self.lines += HELP.splitlines() if word is Word.HELP else told

    def _state(self, now_ns: int, before: str = "") -> str:
        status = self.snapshot(now_ns).status
        return self.view.silence(now_ns) if status is None else before + state_in_words(status)

    def _frames(self, now_ns: int) -> tuple[CanFrame, ...]:
        word = self._verb.word if self._verb else None
        if not self.is_sending and word is not Word.DISARM:
            return ()
        request = HostRequest.NONE
        unarmed = self.view.mode(now_ns) in {Mode.INIT, Mode.READY}
        begins = unarmed and self._schedule.setpoints_sent() < _FIRST_FRAMES
        if word is Word.DISARM or begins:
            request = HostRequest.DISARM
        elif word is Word.ARM and now_ns - self._began_ns >= RELEASED_S * _NS:
            request = HostRequest.ARM
        if self._manual_ma is not None and word is not Word.AUTO:
            self._setpoint_m = self._here_m()  # automatic mode begins where the stem is
        setpoint_m = self._valve.travel_min_m if self._setpoint_m is None else self._setpoint_m
        joins = not self.is_sending and self.view.is_received(Setpoint, now_ns)
        # a DISARM beside another host has the counter of its newest frame: it can never be taken for one of its next
        counter = self.view.other_counter if joins else None
        frames = self._schedule.frame(Setpoint(setpoint_m, request), now_ns, counter)
        if word is Word.AUTO:
            return frames + self._schedule.frame(ManualCurrent(self._manual_ma or 0.0, ManualRequest.AUTO), now_ns)
        if self._manual_ma is not None:
            return frames + self._schedule.frame(ManualCurrent(self._manual_ma), now_ns)
        return frames
