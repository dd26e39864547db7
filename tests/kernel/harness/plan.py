"""The kinds of kernel for the tests, and the properties of each kind."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[3]
CACHE = PROJECT / "build" / "kernel"
INSIDE = "POSITIONER_KERNEL"
"""Set inside a kernel of ours, to the name of its kind."""
RESULTS = "POSITIONER_KERNEL_RESULTS"
TIME_FACTOR = "POSITIONER_KERNEL_TIME_FACTOR"
"""Set inside a kernel of ours, to how many times longer than usual anything may take."""
BEGAN = "began"
"""A kernel that comes as far as its tests writes its version into the file of this name."""
WHEELS = CACHE / "wheels"

CAN_MODULES = ("can", "can-raw", "can-bcm", "can-gw", "can-dev", "vcan", "slcan", "sch_netem", "sch_tbf")
"""In the order of their needs."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of kernel.

    emulated: QEMU with its CAN controllers instead of user-mode Linux.
    booted: systemd is process 1, instead of a script.
    vcan_echo: vcan loops frames back through the queueing discipline, which netem and tbf need.
    boot_s: how long the way to the first test may take, on a busy machine.
    timeout_s: how long all tests of a file may take together, on a busy machine.
    time_factor: how many times longer than usual anything may take inside.
    """

    emulated: bool = False
    booted: bool = False
    vcan_echo: bool = False
    boot_s: float = 300.0
    timeout_s: float = 2700.0
    time_factor: float = 1.0

    def in_qemu(self) -> Kind:
        """Return this kind on an emulated processor, which is slow."""
        return self if self.emulated else replace(self, emulated=True, boot_s=900.0, timeout_s=3600.0, time_factor=10.0)


KINDS = {
    "vcan": Kind(),
    "faults": Kind(vcan_echo=True),
    "systemd": Kind(booted=True),
    "controller": Kind(emulated=True, boot_s=900.0, timeout_s=1800.0),
}


def kind_inside() -> str | None:
    """Return the kind of kernel that this process runs in, None on the host."""
    return os.environ.get(INSIDE)


def time_factor() -> float:
    """Return how many times longer than usual anything may take here."""
    return float(os.environ.get(TIME_FACTOR, "1"))
