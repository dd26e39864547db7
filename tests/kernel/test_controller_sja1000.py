"""The bench between two CAN controllers: SJA1000s of a PCI card, with their driver, at 1 Mbit/s on one bus."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import write_configuration
from links import command

from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import load_scenario
from positioner.bus.address import BusAddress

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.kernel("controller")
SCENARIO = """
name = "controllers"
title = "two setpoints, a twentieth of a second each"
law = "nmpc"
setpoints_mm = [73.0, 80.0]
dwell_s = 0.05
seed = 7
"""


@pytest.fixture(scope="module", autouse=True)
def controllers() -> Iterator[None]:
    """Bring both interfaces up, as in docs/install.md."""
    for name in ("can0", "can1"):
        command("ip", "link", "set", name, "up", "type", "can", "bitrate", "1000000", "restart-ms", "100")
    yield
    for name in ("can0", "can1"):
        command("ip", "link", "set", name, "down")


def test_lockstep_between_two_controllers_gives_the_numbers_of_no_bus_at_all(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(SCENARIO, encoding="utf-8")
    out = tmp_path / "out"
    words = ["bench", "--scenario", str(scenario), "--bus", "socketcan:can0", "--plant-bus", "socketcan:can1"]
    command(sys.executable, "-m", "positioner", *words, "--out", str(out))
    run_in_process(load_scenario(str(scenario))).recording.write_log(tmp_path / "bus.log")
    assert (out / "bus.log").read_bytes() == (tmp_path / "bus.log").read_bytes()
    dwells = json.loads((out / "result.json").read_text(encoding="utf-8"))["dwells"]
    assert [dwell["setpoint_mm"] for dwell in dwells] == [73.0, 80.0]
    for name in ("can0", "can1"):
        counts = Path(f"/sys/class/net/{name}/statistics")
        # what the one sends, the other receives: it really went through both controllers
        assert int((counts / "rx_packets").read_text(encoding="ascii")) >= 100
        assert int((counts / "tx_packets").read_text(encoding="ascii")) >= 100


def test_the_doctor_reads_what_the_controller_was_set_to(tmp_path: Path) -> None:
    path = write_configuration(tmp_path, BusAddress(channel="can1"))
    output = command(sys.executable, "-m", "positioner", "doctor", "--json", "--config", str(path), check=False)
    found = {finding["subject"]: finding for finding in json.loads(output[output.index("{") :])["findings"]}
    text = " ".join(finding["text"] for finding in found.values())
    (link,) = json.loads(command("ip", "-details", "-json", "link", "show", "can1"))
    data = link["linkinfo"]["info_data"]
    assert (data["bittiming"]["bitrate"], data["restart_ms"], data["state"]) == (1_000_000, 100, "ERROR-ACTIVE")
    for word in ("up at 1000 kbit/s", "100 ms after bus-off", "can1 is ERROR-ACTIVE"):
        assert word in text, text
    assert found["feedback"]["level"] == "FAIL"  # no node sends now, and the doctor reports it
