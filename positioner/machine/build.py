"""Which build of the positioner runs: the compiled one or the interpreted source. Shell."""

from __future__ import annotations

from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec


def is_compiled() -> bool:
    """Return whether the control cycle is native code."""
    cycle = find_spec("positioner.cycle.step")
    return cycle is not None and (cycle.origin or "").endswith(tuple(EXTENSION_SUFFIXES))


def version(program: str, number: str) -> str:
    """Return what `--version` prints."""
    return f"{program} {number} ({'compiled' if is_compiled() else 'interpreted'})"
