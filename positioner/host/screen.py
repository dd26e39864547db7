"""A terminal whose last lines show the status while the lines of the session scroll above them. Shell.

Keys come one by one and unseen. Ctrl-Z and Ctrl-S do nothing: a host that stands still sends no setpoints. However the
session ends, the terminal is given back as it was.
"""

from __future__ import annotations

import os
import select
import sys
import termios
import textwrap
from collections import deque
from typing import TYPE_CHECKING

from positioner.errors import in_one_line
from positioner.machine.plain_text import showable

if TYPE_CHECKING:
    from collections.abc import Sequence

_KEPT = 200
"""Lines that are shown again after the terminal has changed its size."""
_PASTE_ON, _PASTE_OFF = "\x1b[?2004h", "\x1b[?2004l"
_CLEAR_BELOW, _CLEAR_ALL = "\r\x1b[J", "\x1b[H\x1b[2J"
_IXON, _LOCAL, _CONTROL = 0, 3, 6
"""Places of the flags in what tcgetattr returns: input, local, control characters."""


def is_usable() -> bool:
    """Return whether both standard streams are one terminal that moves its cursor."""
    if sys.stdin is None or not (sys.stdin.isatty() and sys.stdout.isatty()):  # None: the shell's `<&-`
        return False
    return os.environ.get("TERM", "") not in {"", "dumb", "unknown"}


class Screen:
    """The terminal of the standard streams."""

    def __init__(self) -> None:
        """Take the terminal; `close` gives it back."""
        self._file = sys.stdin.fileno()
        self._saved = termios.tcgetattr(self._file)
        self._lines: deque[str] = deque(maxlen=_KEPT)
        self._block: list[str] = []
        self._new: list[str] = []
        self._size = self.size
        mode = termios.tcgetattr(self._file)
        mode[_IXON] &= ~termios.IXON
        mode[_LOCAL] &= ~(termios.ICANON | termios.ECHO)
        off = bytes([os.fpathconf(self._file, "PC_VDISABLE") & 0xFF])
        for control in (termios.VSUSP, termios.VQUIT):
            mode[_CONTROL][control] = off
        termios.tcsetattr(self._file, termios.TCSADRAIN, mode)
        self._write(_PASTE_ON)

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        found = os.get_terminal_size(self._file)
        return found.columns or 80, found.lines or 24

    def keys(self, timeout_s: float) -> bytes | None:
        """Return what was typed within a time, None at the end of the input."""
        if not select.select([self._file], [], [], timeout_s)[0]:
            return b""
        try:
            return os.read(self._file, 4096) or None
        except OSError:  # the terminal has gone
            return None

    def show(self, lines: Sequence[str], block: Sequence[str]) -> None:
        """Add `lines` to those of the session, and show `block` below them; a stopped terminal is left alone."""
        size = self.size
        width = max(size[0] - 1, 1)
        found = [showable(in_one_line(line), sys.stdout)[:width] for line in block]
        self._new += [showable(in_one_line(line), sys.stdout) for line in lines]
        if (not self._new and found == self._block and size == self._size) or not self._takes_text():
            return
        self._lines.extend(self._new)
        text, shown = self._to_top(), self._new
        if size != self._size:  # the terminal has wrapped its lines anew
            room = max(size[1] - len(found), 1)
            text, shown = _CLEAR_ALL, list(self._lines)[-room:]
        above = "".join(f"{part}\n" for line in shown for part in textwrap.wrap(line, width) or [""])
        self._block, self._size, self._new = found, size, []
        self._write(text + above + "\n".join(found))

    def close(self) -> None:
        """Give the terminal back as it was."""
        try:
            self._write(self._to_top() + _PASTE_OFF)
        finally:
            termios.tcsetattr(self._file, termios.TCSADRAIN, self._saved)

    def _to_top(self) -> str:
        up = len(self._block) - 1
        return (f"\x1b[{up}A" if up > 0 else "") + _CLEAR_BELOW

    def _takes_text(self) -> bool:
        return bool(select.select([], [sys.stdout.fileno()], [], 0.0)[1])

    def _write(self, text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()
