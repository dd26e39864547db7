"""The line of a TOML text on which a key stands, for messages about the key. Pure."""

from __future__ import annotations

import re
from collections import Counter
from functools import lru_cache
from itertools import takewhile

from positioner.errors import Problem

_KEY = r"(?:[A-Za-z0-9_\-]+|\"[^\"]*\"|'[^']*')"
_KEYS = rf"({_KEY}(?:\s*\.\s*{_KEY})*)"
_HEADER = re.compile(rf"\s*\[\[?\s*{_KEYS}\s*\]")
_EQUATION = re.compile(rf"\s*{_KEYS}\s*=")


def problem_at(text: str, where: str, message: str) -> Problem:
    """Return the mistake at `where`, a dotted key (and ` = ` its value, if given), with its line in the TOML `text`."""
    key, _, _ = where.partition(" = ")
    return Problem(where, line_of(text, tuple(key.split("."))), message)


def line_of(text: str, path: tuple[str, ...], element: int | None = None) -> int | None:
    """Return the 1-based line in the TOML `text` that comes nearest to setting the key `path`, or None.

    That is the key's own line, dotted or not; inside an inline table the line of that table; for a table its header.
    In an array of tables `element` is the number of the table, from 0; without it the first one that fits is meant.
    """
    nearest: int | None = None
    most_shared = 0
    for number, key, found_element in keys_in(text):
        if element is not None and found_element != element:
            continue
        shared = len(tuple(takewhile(lambda pair: pair[0] == pair[1], zip(key, path, strict=False))))
        if shared > most_shared:
            nearest, most_shared = number, shared
    return nearest


@lru_cache(maxsize=2)
def keys_in(text: str) -> tuple[tuple[int, tuple[str, ...], int | None], ...]:
    """Return the keys and the headers in `text`, each with its line, and its element where it is in an array."""
    table: tuple[str, ...] = ()
    elements: Counter[str] = Counter()
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _parts(header.group(1))
            if line.lstrip().startswith("[[") and len(table) == 1:
                elements[table[0]] += 1
            keys = table
        elif equation := _EQUATION.match(line):
            keys = (*table, *_parts(equation.group(1)))
        else:
            continue
        found.append((number, keys, elements[table[0]] - 1 if table and table[0] in elements else None))
    return tuple(found)


def _parts(keys: str) -> tuple[str, ...]:
    return tuple(part.strip("\"'") for part in re.findall(_KEY, keys))
