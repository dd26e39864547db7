"""A question at the terminal, before a command does what cannot be undone. Shell."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from positioner.errors import visible

if TYPE_CHECKING:
    from positioner.errors import PositionerError


def agreed(question: str, nobody: PositionerError) -> bool:
    """Return whether the person at the terminal answers yes; the question is on stderr, beside what is printed.

    Raises:
        PositionerError: `nobody`, where there is no terminal.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        raise nobody
    sys.stderr.write(f"{visible(question)} [y/N] ")
    sys.stderr.flush()
    try:
        answer = input("")
    except EOFError:
        sys.stderr.write("\n")
        return False
    return answer.strip().lower() in {"y", "yes"}
