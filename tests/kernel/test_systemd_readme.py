""" "A real positioner in five steps" of docs/install.md, with its own commands, in its order, on a new machine."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import TYPE_CHECKING

import printed
import pytest
from harness.plan import PROJECT
from links import TIMEOUT_S, Program, add_vcan, command, until
from machine import Valve, journal, show
from rig import LOW_M, PERIOD_S
from serial_adapter import SerialAdapter

from positioner.wire.messages import HostRequest, Mode, PositionerStatus

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = [pytest.mark.kernel("systemd"), pytest.mark.slow(short="project/test_readme_steps.py")]
WIRE = "vcan9"
EDIT = f"""#!/bin/sh
# what a user types into the editor: the period of the sensor, and limits that a busy machine does not reach
exec sed -i -e 's/^sample_period_s = .*/sample_period_s = {PERIOD_S}/' \\
    -e 's/^feedback_hold_periods = .*/feedback_hold_periods = 50/' \\
    -e 's/^feedback_failsafe_periods = .*/feedback_failsafe_periods = 500/' \\
    -e 's/^setpoint_hold_s = .*/setpoint_hold_s = 20.0/' \\
    -e 's/^setpoint_failsafe_s = .*/setpoint_failsafe_s = 60.0/' "$1"
"""
PLANT = 'preset = "paper"\ndeadman_s = 5.0\n'


def steps() -> list[str]:
    """Return the commands of each step, as they stand on the page."""
    text = (PROJECT / "docs" / "install.md").read_text(encoding="utf-8")
    section = text.split("## A real positioner in five steps", 1)[1].split("\n## ", 1)[0]
    return re.findall(r"```sh\n(.*?)```", section, re.DOTALL)


@pytest.fixture
def adapter(tmp_path: Path) -> Iterator[None]:
    """Plug a CAN adapter in, with a valve and its sensor on the other side."""
    plant = tmp_path / "plant.toml"
    plant.write_text(PLANT, encoding="utf-8")
    add_vcan(WIRE)
    words = ["-m", "plant_emulator.cli.main", "run", "--config", str(plant), "--bus", f"socketcan:{WIRE}"]
    with (
        Program([sys.executable, *words, "--period", str(PERIOD_S)], tmp_path / "plant.log"),
        SerialAdapter(WIRE),
    ):
        yield


def walk(step: str, tmp_path: Path) -> str:
    """Do a step as root, who needs no sudo, with an editor that types by itself."""
    editor = tmp_path / "editor"
    editor.write_text(EDIT, encoding="utf-8")
    editor.chmod(0o755)
    # a C compiler wants more memory than this machine has
    script = f'set -e\nsudo() {{ "$@"; }}\nexport EDITOR={editor} POSITIONER_BUILD=pure\ncd {PROJECT}\n{step}'
    done = subprocess.run(["bash", "-c", script], check=False, capture_output=True, text=True, timeout=600.0)
    assert done.returncode == 0, (
        f"{step}\n{done.stdout[-3000:]}{done.stderr[-3000:]}\n{journal('positioner@fv101')[-2000:]}"
    )
    return done.stdout + done.stderr


def can0() -> str:
    return command("ip", "-details", "link", "show", "can0")


@pytest.mark.usefixtures("adapter")
def test_the_five_steps_lead_to_a_valve_under_control(tmp_path: Path) -> None:
    install, bus, describe, examine, run = steps()

    walk(install, tmp_path)
    assert command("/usr/local/bin/positioner", "--version").startswith("positioner ")

    # what the page tells the owner of a serial adapter to delete
    walk("sed -i '/^RestartSec=/d' /opt/positioner/share/positioner/80-can.network", tmp_path)
    walk(bus, tmp_path)
    until(
        lambda: printed.STATE_UP in command("ip", "link", "show", "can0"),
        lambda: command("ip", "-d", "link", "show", "can0"),
    )
    shown = command("ip", "-details", "link", "show", "can0")
    assert printed.BITRATE_1M in shown
    assert printed.QUEUE_128 in shown

    output = walk(describe, tmp_path)
    assert "fv101.toml" in output

    output = walk(examine, tmp_path)
    assert re.search(rf"^{printed.NOTHING_FAILS}", output, re.MULTILINE), output
    assert f"can0 {printed.UP_AT_1000}" in output

    walk(run, tmp_path)
    assert show("positioner@fv101", "ActiveState") == "active"
    valve = Valve("fv101", WIRE)
    requests = iter([HostRequest.NONE, HostRequest.ARM] * 1000)

    def is_active() -> bool:
        valve.request = next(requests)
        status = valve.newest.get(PositionerStatus)
        return isinstance(status, PositionerStatus) and status.mode is Mode.ACTIVE

    valve.until(is_active)
    valve.go_to(LOW_M)
    walk("sudo systemctl stop positioner@fv101", tmp_path)
    assert printed.STOPPED_AND_SAVED in journal("positioner@fv101")
    valve.port.close()
    until(lambda: not show("positioner@fv101", "MainPID").strip("0"), timeout_s=TIMEOUT_S)
