"""What a key means in a session: a step of the setpoint, a verb, or a letter of a line that is typed. Pure.

While a line is empty, arrows step, and m, a and q are verbs. Any other letter, or a colon, begins a line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from positioner.host import keys
from positioner.host.verbs import Verb, Word

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

STEPS_PERCENT: Final = {
    keys.UP: 1.0,
    keys.DOWN: -1.0,
    keys.RIGHT: 10.0,
    keys.LEFT: -10.0,
    keys.SHIFT_UP: 0.1,
    keys.SHIFT_DOWN: -0.1,
    "+": 0.1,
    "-": -0.1,
}
_VERBS: Final = {"m": Word.MANUAL, "a": Word.AUTO, "q": Word.QUIT}
_LONGEST = 4000


@dataclass(slots=True)
class KeyControl:
    """The line that is typed: empty while keys act at once. `complete` returns what may follow an unfinished line."""

    complete: Callable[[str], Sequence[str]]
    line: str = ""
    is_typing: bool = False
    _is_pasting: bool = False

    def key(self, key: str) -> tuple[list[Verb | str], list[str]]:
        """Return what begins now, a verb or a typed line, and lines to show."""
        if key in {keys.PASTE, keys.PASTED}:
            self._is_pasting = key == keys.PASTE
            return [], []
        if self.is_typing or self._is_pasting:
            return self._typed(key)
        if key in STEPS_PERCENT:
            return [Verb(Word.SET, step_percent=STEPS_PERCENT[key])], []
        if key in _VERBS or key == keys.END_OF_INPUT:
            return [Verb(_VERBS.get(key, Word.QUIT))], []
        if len(key) == 1 and key != " ":
            self.is_typing, self.line = True, "" if key == ":" else key
        return [], []

    def _typed(self, key: str) -> tuple[list[Verb | str], list[str]]:
        line, shown = self.line, list[str]()
        begun: list[Verb | str] = []
        if key == keys.ENTER and self._is_pasting:  # nothing begins before a person has seen it
            self.line = f"{line} "
        elif key == keys.ENTER:
            self.line, self.is_typing = "", False
            begun = [line] if line.strip() else []
        elif key == keys.TAB:
            shown = self._completed()
        elif key == keys.BACKSPACE:
            self.line, self.is_typing = line[:-1], line != ""
        elif key in {keys.ESCAPE, keys.CLEAR}:
            self.line, self.is_typing = "", False
        elif len(key) == 1 and len(line) < _LONGEST:
            self.line, self.is_typing = line + key, True
        return begun, shown

    def _completed(self) -> list[str]:
        """Complete the last word as far as it is certain; return the choices where there are several."""
        word = self.line[self.line.rfind(" ") + 1 :]
        choices = [choice for choice in self.complete(self.line) if choice.startswith(word)]
        if not choices:
            return []
        common = choices[0]
        while not all(choice.startswith(common) for choice in choices):
            common = common[:-1]
        self.line = self.line[: len(self.line) - len(word)] + common
        if len(choices) == 1 and not common.endswith("/"):
            self.line += " "
        return ["  ".join(choices)] if len(choices) > 1 and common == word else []
