"""The reference of the Python API: every name that `from positioner import …` gives. Pure."""

from __future__ import annotations

import positioner

_INTRODUCTION = """\
# Python API

Every name that `from positioner import …` gives, from its docstring. [Python](../python-api.md) shows how to use them.
"""


def page() -> str:
    """Return the reference in Markdown, in which mkdocstrings replaces each name by its documentation."""
    places = (f"{getattr(positioner, name).__module__}.{name}" for name in sorted(positioner.__all__, key=str.lower))
    return _INTRODUCTION + "".join(f"\n::: {place}\n" for place in places)
