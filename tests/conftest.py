"""Options of the test run."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the explicit way to accept a change of what the stored logs hold."""
    parser.addoption(
        "--accept-logs", action="store_true", help="record the stored bus logs anew instead of comparing with them"
    )
