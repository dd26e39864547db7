"""A duration as people write it: in ms or s, with the digits that say something, and never as 1e+03. Pure."""

from __future__ import annotations


def duration(seconds: float, digits: int = 6) -> str:
    """Return a duration with its unit, rounded to `digits` digits: 1.5 s, 120 ms, 0.05 ms."""
    milliseconds = float(f"{1e3 * seconds:.{digits}g}")
    if 0.0 < abs(milliseconds) < 1000.0:  # noqa: PLR2004 - ms in a second
        return f"{milliseconds:.15g} ms"
    return f"{float(f'{seconds:.{digits}g}'):.15g} s"
