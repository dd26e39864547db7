"""Numbers, intervals and dates as a person reads them. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datetime import datetime

NONE = "–"
NOT_MEASURED = "not measured"
_THIN = "\N{NARROW NO-BREAK SPACE}"


def decimals_of(largest: float, digits: int = 4) -> int:
    """Return how many decimals give a number so many significant digits."""
    if largest == 0.0 or not math.isfinite(largest):
        return 0
    return max(0, digits - 1 - math.floor(math.log10(abs(largest))))


def number(value: float | None, decimals: int | None = None) -> str:
    """Return a number with so many decimals, or else four significant digits; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return NONE
    text = f"{abs(value):,.{decimals_of(value) if decimals is None else decimals}f}".replace(",", _THIN)
    if not text.strip("0."):
        return "0"
    return f"\N{MINUS SIGN}{text}" if value < 0.0 else text


def signed(value: float, decimals: int) -> str:
    """Return a number with so many decimals and its sign; what is rounded to nothing has none."""
    text = number(value, decimals)
    return f"+{text}" if value > 0.0 and text != "0" else text


def interval(low: float | None, high: float | None, decimals: int | None = None) -> str:
    """Return the two ends of an interval; nothing where they are equal, so that there is none."""
    if low is None and high is None:
        return NONE
    return "" if low == high else f"{number(low, decimals)} to {number(high, decimals)}"


def change(before: float | None, now: float | None) -> str:
    """Return the change in percent of what was before."""
    if not before or now is None or not math.isfinite(before) or not math.isfinite(now):
        return NONE
    text = f"{abs(100.0 * (now / before - 1.0)):.1f}{_THIN}%"
    sign = "" if text.startswith("0.0") else "+" if now / before > 1.0 else "\N{MINUS SIGN}"
    return f"{sign}{text}"


def date(moment: datetime) -> str:
    """Return day and time, UTC."""
    return f"{moment.day} {moment:%b %Y, %H:%M} UTC"
