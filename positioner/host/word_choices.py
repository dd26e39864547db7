"""The words that may stand next in a line of verbs: verbs, units, files, `repeat`. Pure."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from positioner.host.verbs import Word

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")
_UNITS = {Word.SET: ("mm", "%"), Word.MANUAL: ("mA",)}


def choices(line: str, files: Callable[[str], Sequence[str]]) -> list[str]:
    """Return what the last word of `line` may become; `files` returns the CSV files that begin like a text."""
    *before, last = line.split(" ")
    words = [word.lower() for word in before if word]
    previous = words[-1] if words else ""
    if previous in _UNITS and (number := _NUMBER.match(last)):
        return [number[0] + unit for unit in _UNITS[Word(previous)]]
    if len(words) > 1 and words[-2] in _UNITS and _NUMBER.fullmatch(previous):
        return [*_UNITS[Word(words[-2])], *Word]
    if previous == Word.PROFILE:
        return list(files(last))
    if previous == "repeat":
        return ["forever"]
    if len(words) > 1 and words[-2] == Word.PROFILE:
        return ["repeat", *Word]
    return list(Word)
