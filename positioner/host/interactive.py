"""A session by keys: each acts at once, and the status stands live below. Shell."""

from __future__ import annotations

import glob
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.errors import PositionerError
from positioner.host.key_control import KeyControl
from positioner.host.keys import KeyReader
from positioner.host.screen import Screen
from positioner.host.status_block import status_block
from positioner.host.terminal import CYCLE_S, Terminal
from positioner.host.verbs import Verb, Word
from positioner.host.word_choices import choices

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.config.schema import Configuration

_SHOWN_EVERY_S = 0.1
_TOLD_AT_ONCE = {Word.HELP, Word.STATUS}
"""These verbs do not end a profile."""


class Interactive(Terminal):
    """A session with a person at a terminal."""

    def __init__(self, configuration: Configuration) -> None:
        """Begin; `run` takes the terminal, and gives it back."""
        super().__init__(configuration, ())
        self._session.arm_as = "`:arm`"
        self._is_prompting = False
        self._screen: Screen | None = None
        self._keys, self._control = KeyReader(), KeyControl(lambda line: choices(line, _csv_files))
        self._due_s = 0.0

    def _begin(self) -> None:
        for number in (signal.SIGHUP, signal.SIGQUIT):
            signal.signal(number, self._stop)
        self._screen = Screen()
        self._print([f"{self._configuration.valve.id} on {self._configuration.bus}; :help shows the verbs"])

    def _end(self) -> None:
        if self._screen is not None:
            screen, self._screen = self._screen, None
            screen.close()

    def _show_progress(self, now_ns: int) -> None:
        """Show nothing more: the status has it."""

    def _wait(self) -> None:
        data = self._screen.keys(CYCLE_S) if self._screen else b""
        if data is None:
            self._stopping = True
            return
        for key in self._keys.feed(data) if data else self._keys.flush():
            begun, lines = self._control.key(key)
            self._session.lines += lines
            for each in begun:
                self._take(each)
            self._due_s = 0.0

    def _take(self, begun: Verb | str) -> None:
        """Begin a verb or a typed line in place of what is played or waits."""
        try:
            found: Sequence[Verb] = (begun,) if isinstance(begun, Verb) else self._read([begun])
        except PositionerError as error:
            self._session.lines += [f"> {begun}", *str(error).splitlines()]
            return
        now_ns = time.monotonic_ns()
        playing = bool(self._session.progress(now_ns))
        if playing and all(verb.word in _TOLD_AT_ONCE for verb in found):
            for verb in found:
                self._session.tell(verb.word, now_ns)
            return
        if playing:
            self._session.stop_profile(now_ns)
            self._verbs.clear()
        self._verbs.extend(found)

    def _print(self, lines: Sequence[str]) -> None:
        if self._screen is None:
            super()._print(lines)
            return
        now_s = time.monotonic()
        if not lines and now_s < self._due_s:
            return
        self._due_s = now_s + _SHOWN_EVERY_S
        session, now_ns = self._session, time.monotonic_ns()
        typed = self._control.line if self._control.is_typing else None
        found, silence = session.snapshot(now_ns), session.view.silence(now_ns)
        block = status_block(found, silence, session.progress(now_ns), typed, self._screen.size)
        self._screen.show(lines, block)


def _csv_files(begin: str) -> list[str]:
    """Return the CSV files and folders whose names begin so."""
    found = sorted(glob.glob(glob.escape(begin) + "*"))  # noqa: PTH207 - the text that is typed stays as it is
    folders = {each for each in found if Path(each).is_dir()}
    return [f"{each}/" if each in folders else each for each in found if each in folders or each.endswith(".csv")]
