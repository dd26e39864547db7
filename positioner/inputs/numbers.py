"""Numbers on a command line, each with its limits: the `type` of an argument of argparse. Pure."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def number(lowest: float, highest: float, wanted: str) -> Callable[[str], float]:
    """Return the function that reads a number from `lowest` to `highest`; `wanted` describes it in the message."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not lowest <= value <= highest:
            raise argparse.ArgumentTypeError(f"{text!r} is not {wanted}")
        return value

    return read


def whole(text: str) -> int:
    """Return a whole number of 0 or more, such as a seed."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number of 0 or more")
    return int(text)
