"""QEMU with two SJA1000 CAN controllers on one bus, on the host's own file tree, which it can only read."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from harness.plan import Kind


def command(kind_name: str, kind: Kind, out: Path, tests: Sequence[str]) -> list[str]:
    """Write what the machine runs into `out`, and return the command that starts it."""
    raise NotImplementedError
