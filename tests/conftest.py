"""Options and environment of the test run, and the profiles of its property tests."""

from __future__ import annotations

import os
import signal
import tempfile

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from left_out import LeftOut

import positioner.machine.can_libraries  # noqa: F401 - before a test loads python-can, which would load asammdf and pandas
from positioner.start import TRACEBACK

os.environ.setdefault(TRACEBACK, "1")  # an unforeseen error shows its whole traceback in a test

settings.register_profile("explore", deadline=None, print_blob=True)
settings.register_profile(
    "repeatable", derandomize=True, deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    """Accept SIGINT, let the processes that tests start share their compiled modules, and make examples repeatable."""
    config.pluginmanager.register(LeftOut(config))
    if not config.getoption("--hypothesis-profile"):
        # else examples would depend on which modules of ours a worker has loaded: their constants are among them
        providers.is_local_module_file = lambda _path: False  # type: ignore[assignment,attr-defined]
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as it is in the background of a script, and in every child
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):  # it would double the time that each of them takes to start
        folder = tempfile.TemporaryDirectory(prefix="positioner-bytecode-")
        os.environ["PYTHONPYCACHEPREFIX"] = folder.name
        config.add_cleanup(folder.cleanup)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give tests in real time two more tries; those inside kernels get theirs from `kernel/harness/dispatch.py`."""
    for item in items:
        if item.get_closest_marker("bus") is not None and item.get_closest_marker("kernel") is None:
            item.add_marker(pytest.mark.flaky(reruns=2))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print each try that failed and was followed by another one, with its reason: nothing is hidden."""
    tries = terminalreporter.getreports("rerun")
    if tries:
        terminalreporter.section(f"more tries: {len(tries)} in tests in real time, which a busy machine may fail")
        for report in tries:
            terminalreporter.line(f"{report.nodeid}\n{report.longreprtext}")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that accepts a change of the stored logs."""
    parser.addoption(
        "--accept-logs", action="store_true", help="record the stored bus logs anew instead of comparing with them"
    )
