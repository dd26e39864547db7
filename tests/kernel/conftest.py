"""Tests that need SocketCAN, systemd or a CAN controller; `make test-kernel` runs them, wherever it is run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.dispatch import Dispatcher
from harness.plan import kind_inside

if TYPE_CHECKING:
    import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Outside, send the tests into kernels; inside, run them as any test."""
    if kind_inside() is None:
        config.pluginmanager.register(Dispatcher(), "kernel-dispatcher")
