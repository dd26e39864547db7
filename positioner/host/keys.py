"""The keys in what a terminal sends: letters, and the escape sequences of arrows and pasted text. Pure.

ECMA-48 gives the form of a sequence, and xterm's ctlseqs the codes: 1;2 before the last letter is the shift key.
"""

from __future__ import annotations

import codecs
import re
from typing import Final

UP, DOWN, LEFT, RIGHT = "up", "down", "left", "right"
SHIFT_UP, SHIFT_DOWN = "shift-up", "shift-down"
ENTER, TAB, ESCAPE, BACKSPACE, CLEAR, END_OF_INPUT = "enter", "tab", "escape", "backspace", "clear", "end of input"
PASTE, PASTED = "paste", "pasted"

_WHOLE = re.compile(rb"\x1b(?:\[([0-?]*)[ -/]*([@-~])|O([@-~]))")
_BEGUN = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*|O)?")
_ARROWS: Final = {b"A": UP, b"B": DOWN, b"C": RIGHT, b"D": LEFT}
_SHIFTED: Final = {UP: SHIFT_UP, DOWN: SHIFT_DOWN}
_CONTROLS: Final = {
    "\r": ENTER,
    "\n": ENTER,
    "\t": TAB,
    "\x7f": BACKSPACE,
    "\x08": BACKSPACE,
    "\x15": CLEAR,
    "\x04": END_OF_INPUT,
}


class KeyReader:
    """Turns bytes into keys; a sequence may come in parts."""

    def __init__(self) -> None:
        """Begin with nothing received."""
        self._pending = b""
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def feed(self, data: bytes) -> list[str]:
        """Return the keys in `data`: a name of this module, or one character."""
        data, keys = self._pending + data, list[str]()
        self._pending = b""
        while data:
            if data[:1] != b"\x1b":
                text, escape, data = data.partition(b"\x1b")
                keys += self._characters(text)
                data = escape + data
            elif found := _WHOLE.match(data):
                keys += _named(found)
                data = data[found.end() :]
            elif _BEGUN.fullmatch(data):
                self._pending, data = data, b""
            else:
                keys.append(ESCAPE)
                data = data[1:]
        return keys

    def flush(self) -> list[str]:
        """Return the escape key if it was pressed alone: nothing has followed for a time."""
        alone, self._pending = self._pending == b"\x1b", b"" if self._pending == b"\x1b" else self._pending
        return [ESCAPE] if alone else []

    def _characters(self, data: bytes) -> list[str]:
        text = self._decoder.decode(data)
        return [_CONTROLS.get(each, each) for each in text if each in _CONTROLS or each.isprintable()]


def _named(found: re.Match[bytes]) -> list[str]:
    """Return the key of a whole sequence, nothing for one without a meaning here."""
    parameters, letter = found[1] or b"", found[2] or found[3]
    if letter == b"~":
        return {b"200": [PASTE], b"201": [PASTED]}.get(parameters, [])
    key = _ARROWS.get(letter, "")
    if parameters.endswith(b";2"):
        key = _SHIFTED.get(key, "")
    return [key] if key else []
