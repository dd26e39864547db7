"""Tests that need SocketCAN, systemd or a CAN controller; `make test-kernel` runs them, wherever it is run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.dispatch import Dispatcher
from harness.plan import kind_inside

if TYPE_CHECKING:
    import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let the short form be chosen where user-mode Linux would run."""
    parser.addoption(
        "--kernel",
        choices=["auto", "qemu"],
        default="auto",
        help="qemu: the short form, with QEMU for every test (default: QEMU only where user-mode Linux cannot run)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Outside, send the tests into kernels; inside, run them as any test."""
    if kind_inside() is None:
        config.pluginmanager.register(Dispatcher(only_qemu=config.getoption("--kernel") == "qemu"), "kernel-dispatcher")
