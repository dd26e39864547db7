"""The nearest of the names that there are, for one that is none of them. Pure."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


def nearest(name: str, known: Iterable[str]) -> str:
    """Return what to do about a `name` that is none of `known`: the nearest one, if there is one, and all of them."""
    names = tuple(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
    return f"{f'did you mean {close[0]!r}? ' if close else ''}known: {', '.join(names)}"
