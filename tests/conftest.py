"""Options of the test run, and of its property tests: the same examples in every run, unless others are asked for."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

from hypothesis import HealthCheck, settings

from positioner.start import TRACEBACK

if TYPE_CHECKING:
    import pytest

os.environ.setdefault(TRACEBACK, "1")  # what nobody has foreseen is to be seen whole in a test

settings.register_profile("explore", deadline=None, print_blob=True)
settings.register_profile(
    "repeatable", derandomize=True, deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("repeatable")


def pytest_configure() -> None:
    """Take Ctrl-C again where a script started the suite in the background: it would be ignored, in every child too."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the explicit way to accept a change of what the stored logs hold."""
    parser.addoption(
        "--accept-logs", action="store_true", help="record the stored bus logs anew instead of comparing with them"
    )
