"""Keeping the process's memory in RAM: a page that must first be read from a disk makes a command late. Shell."""

from __future__ import annotations

import ctypes
import resource
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4
"""MCL_CURRENT, MCL_FUTURE and MCL_ONFAULT of mlockall(2): the pages in use, and those touched later."""


def lock_memory(mlockall: Callable[[int], int] | None = None) -> bool:
    """Return whether every page that is touched from now on stays in RAM.

    It is locked only where there is no limit (RLIMIT_MEMLOCK; `LimitMEMLOCK=infinity` in the unit): with a limit a
    later allocation would fail.
    """
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != resource.RLIM_INFINITY:
        return False
    lock = mlockall or ctypes.CDLL(None).mlockall
    return bool(lock(_CURRENT | _FUTURE | _ON_FAULT) == 0)
