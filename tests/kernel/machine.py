"""A machine under systemd with the product installed as in docs/install.md, and its services for a test."""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from typing import TYPE_CHECKING

from links import TIMEOUT_S, command, until
from rig import CLOSED_M, HIGH_M, LOW_M, NEAR_M, PERIOD_S

from positioner.bus.address import BusAddress
from positioner.bus.port import BusPort
from positioner.wire.codec import make_codec
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import HostRequest, Message, PlantTruth, Setpoint

if TYPE_CHECKING:
    from collections.abc import Callable

CONFIGURATIONS = Path("/etc/positioner")
UNITS = Path("/etc/systemd/system")
_VALVE = """[valve]
id = "{valve}"
preset = "paper"
[bus]
channel = "{bus}"
[control]
sample_period_s = 0.02
[guard]
auto_arm = true
feedback_hold_periods = 50
feedback_failsafe_periods = 400
setpoint_hold_s = 0
setpoint_failsafe_s = 0
"""
_PLANT = """preset = "paper"
deadman_s = 1.0
"""


def systemctl(*words: str, check: bool = True) -> str:
    return command("systemctl", *words, check=check)


def show(unit: str, name: str) -> str:
    """Return one property of a unit."""
    return systemctl("show", "--value", "-p", name, unit).strip()


def journal(unit: str) -> str:
    return command("journalctl", "--no-pager", "-q", "-u", unit)


def configure(valve: str, bus: str) -> None:
    """Write a valve's configuration, its emulator's, and the drop-in that binds it to its bus."""
    (CONFIGURATIONS / f"{valve}.toml").write_text(_VALVE.format(valve=valve, bus=bus), encoding="utf-8")
    (CONFIGURATIONS / f"plant-{valve}.toml").write_text(_PLANT, encoding="utf-8")
    environment = f"BUS=socketcan:{bus}\nPERIOD={PERIOD_S}\n"
    (CONFIGURATIONS / f"plant-{valve}.env").write_text(environment, encoding="utf-8")
    folder = UNITS / f"positioner@{valve}.service.d"
    folder.mkdir(exist_ok=True)
    example = Path("/opt/positioner/share/positioner/bus.conf").read_text(encoding="utf-8")
    (folder / "bus.conf").write_text(example.replace("-can0.device", f"-{bus}.device"), encoding="utf-8")
    systemctl("daemon-reload")


class Valve:
    """The two services of one valve, and the host on their bus."""

    def __init__(self, name: str, bus: str) -> None:
        self.unit, self.plant = f"positioner@{name}.service", f"plant-emulator@{name}.service"
        self.state = Path("/var/lib/positioner") / name
        self.port = BusPort(BusAddress(channel=bus))
        self.codec = make_codec()
        self.newest: dict[type[Message], Message] = {}
        self.setpoint_m = 0.08
        self.request = HostRequest.NONE
        self._numbers = itertools.count()

    def step(self) -> None:
        """Run one period of the host: send a setpoint, and receive the frames of the others."""
        self.port.send(self.codec.encode(Setpoint(self.setpoint_m, self.request), next(self._numbers)))
        end_s = time.monotonic() + PERIOD_S
        while (left_s := end_s - time.monotonic()) > 0.0:
            for frame in self.port.receive(left_s):
                try:
                    message, _ = self.codec.decode(frame)
                except FrameRejectedError:
                    continue
                self.newest[type(message)] = message

    def until(self, holds: Callable[[], object], timeout_s: float = TIMEOUT_S * 2) -> None:
        """Play the host until `holds`."""
        deadline_s = time.monotonic() + timeout_s
        while not holds():
            assert time.monotonic() < deadline_s, f"{self.newest}\n{self.story()}"
            self.step()

    def next(self, kind: type[Message]) -> Message:
        """Return the next message of that kind."""
        self.newest.pop(kind, None)
        self.until(lambda: kind in self.newest)
        return self.newest[kind]

    def is_at(self, position_m: float, within_m: float = NEAR_M) -> bool:
        truth = self.newest.get(PlantTruth)
        return isinstance(truth, PlantTruth) and abs(truth.position_m - position_m) < within_m

    def go_to(self, position_m: float) -> None:
        """Send the setpoint `position_m` until the stem is there."""
        self.setpoint_m = position_m
        self.newest.pop(PlantTruth, None)
        self.until(lambda: self.is_at(position_m))

    def start(self) -> None:
        """Start both services and return when they are ready."""
        systemctl("reset-failed", self.unit, self.plant, check=False)
        systemctl("start", "--no-block", self.plant, self.unit)
        until(lambda: self.is_active, self.story, TIMEOUT_S * 2)

    @property
    def is_active(self) -> bool:
        return show(self.unit, "ActiveState") == "active"

    @property
    def pid(self) -> int:
        return int(show(self.unit, "MainPID"))

    def stop(self) -> None:
        systemctl("stop", self.unit, self.plant)

    def story(self) -> str:
        """Return state and journal of both services, for the message of a failed test."""
        status = command("systemctl", "--no-pager", "status", self.unit, self.plant, check=False)
        return f"{status}\n{journal(self.unit)[-3000:]}\n{journal(self.plant)[-1500:]}"


__all__ = ["CLOSED_M", "CONFIGURATIONS", "HIGH_M", "LOW_M", "Valve", "configure", "journal", "show", "systemctl"]
