"""Which kernel a test needs, and what each kernel is made of."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[3]
CACHE = PROJECT / "build" / "kernel"
INSIDE = "POSITIONER_KERNEL"
"""Set inside a kernel of ours, to the name of its kind."""
RESULTS = "POSITIONER_KERNEL_RESULTS"
WHEELS = CACHE / "wheels"

VCAN_MODULES = (
    "net/can/can",
    "net/can/can-raw",
    "net/can/can-bcm",
    "net/can/can-gw",
    "drivers/net/can/dev/can-dev",
    "drivers/net/can/vcan",
    "drivers/net/can/slcan/slcan",
    "net/sched/sch_netem",
    "net/sched/sch_tbf",
)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of kernel.

    emulated: QEMU with its CAN controllers instead of user-mode Linux.
    booted: systemd is process 1, instead of a script.
    vcan_echo: vcan loops frames back through the queueing discipline, which netem and tbf need.
    patience_s: how long all tests of a file may take together, on a busy machine.
    """

    emulated: bool = False
    booted: bool = False
    vcan_echo: bool = False
    patience_s: float = 900.0


KINDS = {
    "vcan": Kind(),
    "faults": Kind(vcan_echo=True),
    "systemd": Kind(booted=True),
    "controller": Kind(emulated=True, patience_s=1200.0),
}


def kind_inside() -> str | None:
    """Return the kind of kernel that this process runs in, None on the host."""
    return os.environ.get(INSIDE)
