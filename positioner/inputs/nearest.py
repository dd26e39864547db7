"""Names on a command line: an unknown name is answered with the nearest known one. Pure."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

from positioner.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable


_NEAR = 0.6
"""Least similarity, twice the common letters over all letters: most of a name is right, as where one is mistyped."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return advice for a `name` that is none of `known`: the nearest one, if there is one, and all of them."""
    names = tuple(map(str, known))
    return f"{did_you_mean(name, names)}known: {', '.join(names)}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the question whether the nearest of `known` is meant, with a blank behind it; empty where none is near."""
    close = difflib.get_close_matches(name, tuple(known), n=1, cutoff=_NEAR)
    return f"did you mean {close[0]!r}? " if close else ""


def check_name(what: str, name: str, known: tuple[str, ...], otherwise: str = "") -> None:
    """Refuse a `name` that is none of `known`; `otherwise` is another way to give it, for the message.

    Raises:
        UsageError: it is none.
    """
    if name not in known:
        raise UsageError(f"{what} {name!r} is unknown; {nearest(name, known)}{f'; {otherwise}' if otherwise else ''}")


def names_in(what: str, given: str, known: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names in a list with commas, each once; blanks beside them do not count.

    Raises:
        UsageError: a name is unknown; the nearest is named.
    """
    names = tuple(dict.fromkeys(name.strip() for name in given.split(",")))
    for name in names:
        check_name(what, name, known)
    return names
