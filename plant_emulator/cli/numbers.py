"""Numbers on the command line, each with its limits. Shell."""

from __future__ import annotations

import argparse
import math


def seconds(text: str) -> float:
    """Return a time in s."""
    return in_range(text, 1e-6, 1e6, "seconds from 1e-6 to 1e6")


def whole(text: str) -> int:
    """Return a whole number of 0 or more, such as a seed."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number of 0 or more")
    return int(text)


def in_range(text: str, lowest: float, highest: float, wanted: str) -> float:
    """Return a number from `lowest` to `highest`, which `wanted` describes."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not lowest <= value <= highest:
        raise argparse.ArgumentTypeError(f"{text!r} is not {wanted}")
    return value
