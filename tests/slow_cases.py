"""Cases of a parametrized test that `make test-slow` plays; those beside them are its short form, in `make test`."""

from __future__ import annotations

from typing import Any

import pytest

OTHER_CASES = "its other cases"


def slow(*cases: Any) -> list[Any]:
    """Return the cases, marked `slow`; a tuple is a case of several values."""
    mark = pytest.mark.slow(short=OTHER_CASES)
    return [pytest.param(*(each if isinstance(each, tuple) else (each,)), marks=mark) for each in cases]
