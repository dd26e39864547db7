"""A serial adapter and the sandbox of the unit: the drop-in serial.conf lets serial ports through, and nothing else."""

from __future__ import annotations

import os
import select
import shutil
import stat
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from harness.plan import PROJECT
from links import command

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.kernel("systemd")
UNITS = Path("/etc/systemd/system")
UNIT = "positioner@serial.service"
KIND, PORT = "ttyp", Path("/dev/ttyp7")
"""A serial port that this kernel has: the follower of a pseudo-terminal of the old kind."""
OTHER = Path("/dev/tty9")
TRIAL = """\
[Service]
Type=oneshot
Restart=no
WatchdogSec=0
ExecStart=
ExecStart=/bin/sh -c 'exec 3<>{port}; echo V >&3'
"""


@pytest.fixture
def far_end() -> Iterator[int]:
    """The other side of the serial port, whose group is that of all serial ports."""
    for name, major in (("/dev/ptyp7", 2), (str(PORT), 3)):
        if not Path(name).exists():
            os.mknod(name, 0o660 | stat.S_IFCHR, os.makedev(major, 7))
    shutil.chown(PORT, "root", "dialout")
    PORT.chmod(0o660)
    leader = os.open("/dev/ptyp7", os.O_RDWR | os.O_NOCTTY)
    yield leader
    os.close(leader)


def start(port: Path, *, dropped_in: bool) -> int:
    """Start the unit with a command that only writes to `port`; return the exit status of systemctl."""
    shutil.copy(PROJECT / "systemd" / "positioner@.service", UNITS)
    folder = UNITS / f"{UNIT}.d"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "trial.conf").write_text(TRIAL.format(port=port), encoding="utf-8")
    if dropped_in:
        text = (PROJECT / "systemd" / "serial.conf").read_text(encoding="utf-8")
        assert text.count("char-ttyACM") == 1
        (folder / "serial.conf").write_text(text.replace("char-ttyACM", f"char-{KIND}"), encoding="utf-8")
    command("systemctl", "daemon-reload")
    return subprocess.run(["systemctl", "start", UNIT], check=False, capture_output=True, timeout=120).returncode


def test_without_the_drop_in_the_service_reaches_no_serial_port(far_end: int) -> None:
    assert start(PORT, dropped_in=False) != 0
    assert select.select([far_end], [], [], 0.5)[0] == []


def test_with_the_drop_in_it_reaches_the_serial_port(far_end: int) -> None:
    story = command("cat", "/proc/devices")
    assert start(PORT, dropped_in=True) == 0, story + command("journalctl", "--unit", UNIT, "--no-pager")
    assert os.read(far_end, 16).startswith(b"V")


def test_with_the_drop_in_it_reaches_no_other_device(far_end: int) -> None:
    assert OTHER.exists()
    assert start(OTHER, dropped_in=True) != 0
    assert select.select([far_end], [], [], 0.5)[0] == []
