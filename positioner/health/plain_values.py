"""Counts, numbers and rows of them as plain values, and back from what was written. Pure."""

from __future__ import annotations

import math
from typing import Any

_MOST = 1 << 63
"""Above every count: of microseconds it would be 292,000 years."""


def plain(value: Any) -> Any:
    """Return a value as `json.dumps` takes it."""
    return list(value) if isinstance(value, tuple) else value


def value_like(name: str, example: Any, given: Any) -> Any:
    """Return what was written as `given`: of the type of `example`, a row with as many numbers; counts are not below 0.

    Raises:
        ValueError: it is something else.
    """
    if isinstance(example, tuple):
        if not isinstance(given, list) or len(given) != len(example):
            raise ValueError(f"{name} is no row of {len(example)} numbers")
        return tuple([value_like(name, *each) for each in zip(example, given, strict=True)])
    if type(given) is not type(example) or (type(given) is int and not 0 <= given < _MOST):
        raise ValueError(f"{name} is no number")
    if type(given) is float and not math.isfinite(given):
        raise ValueError(f"{name} is no number")
    return given
