"""`positioner doctor` on a machine that has SocketCAN."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import write_configuration
from links import Program, command, until, vcan

from positioner.bus.port import BusPort

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.kernel("vcan")


def examined(path: Path) -> dict[str, tuple[str, str, str]]:
    """Return level, text and the command that fixes it, by subject."""
    text = command(sys.executable, "-m", "positioner", "doctor", "--json", "--config", str(path), check=False)
    found = json.loads(text[text.index("{") :])["findings"]
    return {finding["subject"]: (finding["level"], finding["text"], finding["mend"]) for finding in found}


@pytest.mark.slow(short="test_a_silent_bus_and_one_that_is_down_fail_with_the_command_that_mends_it")
def test_a_valve_that_speaks_on_a_bus_that_is_up_is_in_order(tmp_path: Path) -> None:
    with vcan() as bus:
        path = write_configuration(tmp_path, bus)
        words = [sys.executable, "-m", "plant_emulator.cli.main", "run", "--bus", str(bus), "--period", "0.02"]
        with Program(words, tmp_path / "plant.log"):
            listener = BusPort(bus)
            until(lambda: listener.receive(0.1))
            listener.close()
            found = examined(path)
    assert {level for level, _, _ in found.values()} <= {"OK", "WARN"}, found
    assert found["feedback"][0] == "OK"


@pytest.mark.short_form
def test_a_silent_bus_and_one_that_is_down_fail_with_the_command_that_mends_it(tmp_path: Path) -> None:
    with vcan() as bus:
        path = write_configuration(tmp_path, bus)
        assert examined(path)["feedback"][0] == "FAIL"
        command("ip", "link", "set", bus.channel, "down")
        level, _, mend = examined(path)["interface"]
        assert level == "FAIL"
        command(*mend.removeprefix("sudo ").split("  #")[0].split())
        assert examined(path)["interface"][0] == "OK"
