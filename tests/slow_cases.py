"""Cases of a parametrized test that `make test-slow` plays; those beside them are its short form, in `make test`."""

from __future__ import annotations

from typing import Any

import pytest


def slow(*cases: Any) -> list[Any]:
    """Return the cases, marked `slow`; a tuple is a case of several values."""
    return [pytest.param(*(each if isinstance(each, tuple) else (each,)), marks=pytest.mark.slow) for each in cases]
