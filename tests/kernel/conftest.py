"""Tests that need SocketCAN, systemd or a CAN controller; `make test-kernel` runs them on any machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from harness.dispatch import Dispatcher
from harness.plan import kind_inside
from links import vcan
from rig import Rig

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that chooses the short form, even where user-mode Linux can run."""
    parser.addoption(
        "--kernel",
        choices=["auto", "qemu"],
        default="auto",
        help="qemu: the short form, with QEMU for every test (default: QEMU only where user-mode Linux cannot run)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """On the host, send the tests into kernels; inside a kernel, run them as any test."""
    if kind_inside() is None:
        config.pluginmanager.register(Dispatcher(only_qemu=config.getoption("--kernel") == "qemu"), "kernel-dispatcher")


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    """A valve that is controlled, and rests near 80 mm."""
    with vcan() as bus, Rig(tmp_path, bus) as running:
        running.arm()
        running.go_to(0.080)
        yield running
