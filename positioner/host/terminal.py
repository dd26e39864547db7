"""`positioner host` at work: verbs from the command line or a script, frames from and to the bus. Shell."""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NoReturn

from tqdm import tqdm

from positioner.bus.port import BusPort
from positioner.errors import ExitCode, HostError, PositionerError, UsageError, in_one_line
from positioner.host.profile_file import read_profile
from positioner.host.session import HostSession
from positioner.host.valve_view import RECEIVED
from positioner.host.verbs import HELP_INTERACTIVE, Verb, Word, read_verbs
from positioner.inputs.durations import duration
from positioner.machine.plain_text import showable

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

    from positioner.config.schema import Configuration

CYCLE_S = 0.005
_PROMPT = "> "
_LONG_S = 2.0
"""A profile that lasts longer has a progress bar."""
_LISTEN_FIRST_S = 0.6
"""Longer than the time after which a sender counts as silent."""


class Terminal:
    """A session whose verbs are given, or read from the standard input, a line each."""

    def __init__(self, configuration: Configuration, words: Sequence[str]) -> None:
        """Read the verbs in `words`; if there are none, verbs are read from the standard input.

        Raises:
            UsageError: a word is no verb, or a number is outside what the valve and the guard allow.
            ConfigurationError: the file of a profile has mistakes.
        """
        self._configuration = configuration
        self._verbs = deque(self._read(words))
        if self._verbs and self._verbs[-1].word is Word.PROFILE:
            self._verbs.append(Verb(Word.QUIT))
        self._is_asking = not words
        if self._is_asking and sys.stdin is None:  # the shell's `<&-`
            raise UsageError("there is no standard input to read verbs from: give them on the command line")
        self._is_prompting = self._is_asking and sys.stdin.isatty()
        self._typed = b""
        self._bar: tqdm[NoReturn] | None = None
        self._stopping = False
        self._session = HostSession(configuration)
        if words:  # when this session has nothing more to send, it ends
            self._session.arm_as = "a new `positioner host` with `arm`"
        codec = configuration.make_codec()
        identifiers = [codec.identifier(kind) for kind in RECEIVED]
        self._bus = BusPort(configuration.bus, identifiers, lambda event: self._session.lines.append(str(event)))

    def run(self) -> ExitCode:
        """Run until the verbs are done and no setpoint is to be sent, or until SIGTERM, SIGINT or the end of the input.

        Raises:
            HostError: a verb of the command line could not be done.
            BusError: the bus cannot be opened.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        self._bus.open()
        try:
            self._listen_for(_LISTEN_FIRST_S)
            self._begin()
            while not self._stopping and not self._is_finished:
                self._cycle()
        finally:
            self._end()
            if self._bar is not None:
                self._bar.close()
            self._print_new_lines()
            self._bus.close()
        if self._session.is_sending:
            self._print([self._session.end_line(time.monotonic_ns())])
        return ExitCode.OK

    def status(self) -> dict[str, Any]:
        """Return the status of the valve for a program.

        Raises:
            HostError: none comes.
            BusError: the bus cannot be opened.
        """
        self._bus.open()
        try:
            self._listen_for(_LISTEN_FIRST_S)
        finally:
            self._bus.close()
        now_ns = time.monotonic_ns()
        found = self._session.snapshot(now_ns)
        if found.status is None:
            raise HostError(f"status: {self._session.view.silence(now_ns)}")
        return found.as_json(found.status)

    @property
    def _is_finished(self) -> bool:
        session = self._session
        return not (self._verbs or self._is_asking or session.is_busy or session.is_sending)

    def _begin(self) -> None:
        """Say what may be typed."""
        if self._is_prompting:
            self._print(HELP_INTERACTIVE.splitlines())

    def _end(self) -> None:
        """Read nothing more."""
        self._is_prompting = False

    def _listen_for(self, duration_s: float) -> None:
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s and not self._stopping:
            time.sleep(CYCLE_S)
            self._session.receive(self._bus.receive(0.0), time.monotonic_ns())

    def _cycle(self) -> None:
        """Receive, begin the next verb when the last one is done, and send the frames that are due."""
        session = self._session
        self._wait()
        now_ns = time.monotonic_ns()
        session.receive(self._bus.receive(0.0), now_ns)
        try:
            if self._verbs and not session.is_busy:
                verb = self._verbs.popleft()
                if verb.word is Word.QUIT:
                    self._stopping = True
                    return
                session.begin(session.stepped(verb, now_ns) if verb.step_percent else verb, now_ns)
            for frame in session.advance(now_ns):
                self._bus.send(frame)
        except PositionerError as error:
            if not self._is_asking:
                raise
            session.lines += str(error).splitlines()
        self._show_progress(now_ns)
        self._print_new_lines()

    def _show_progress(self, now_ns: int) -> None:
        """Show a person at a terminal how far a profile is."""
        played = self._session.played(now_ns)
        if played is None:
            if self._bar is not None:
                self._bar.close()
                self._bar = None
            return
        profile, elapsed_s = played
        if self._bar is None:
            total_s = profile.duration_s if profile.repeats else None
            of = f"of {duration(profile.duration_s)} |{{bar}}|" if profile.repeats else "s"
            shape = f"{{desc}}: {{n:.0f}} {of}"
            off = None if profile.duration_s > _LONG_S else True
            self._bar = tqdm(total=total_s, desc=profile.name, bar_format=shape, leave=False, disable=off)
        self._bar.n = elapsed_s
        self._bar.update(0)

    def _wait(self) -> None:
        """Wait for the next cycle, and take what was typed meanwhile."""
        if not self._is_asking:
            time.sleep(CYCLE_S)
        elif select.select([sys.stdin], [], [], CYCLE_S)[0]:
            self._take_input()

    def _take_input(self) -> None:
        """Read the lines that were typed; the end of the input ends the session after the verbs before it."""
        read = os.read(sys.stdin.fileno(), 4096)
        lines = (self._typed + read).split(b"\n")
        self._typed = lines.pop()
        if not read:
            lines = [self._typed]
        for line in lines:
            try:
                found = self._read([line.decode("utf-8", errors="replace")])
            except PositionerError as error:
                self._print(str(error).splitlines())
            else:
                self._verbs.extend(found)
        if self._is_prompting and lines:
            sys.stdout.write(_PROMPT)
            sys.stdout.flush()
        if not read:
            self._is_asking = self._is_prompting = False
            self._verbs.append(Verb(Word.QUIT))

    def _read(self, words: Sequence[str]) -> tuple[Verb, ...]:
        """Return the verbs in `words`, the files of profiles read and checked.

        Raises:
            UsageError: a word is no verb, or a number is outside what the valve and the guard allow.
            ConfigurationError: the file of a profile has mistakes.
        """
        valve, guard = self._configuration.valve, self._configuration.guard
        verbs = read_verbs(words, valve, guard)
        return tuple(
            replace(verb, profile=read_profile(verb, valve, guard)) if verb.word is Word.PROFILE else verb
            for verb in verbs
        )

    def _print_new_lines(self) -> None:
        lines, self._session.lines[:] = [*self._session.lines], []
        self._print(lines)

    def _print(self, lines: Sequence[str]) -> None:
        if lines:
            if self._bar is not None:
                self._bar.clear()
            text = "".join(f"{showable(in_one_line(line), sys.stdout)}\n" for line in lines)
            sys.stdout.write(f"\r{text}{_PROMPT}" if self._is_prompting else text)
            sys.stdout.flush()

    def _stop(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._stopping = True
