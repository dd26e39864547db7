"""The bench between two CAN controllers: SJA1000s of a PCI card, with their driver, at 1 Mbit/s on one bus."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import printed
import pytest
from daemon_helpers import write_configuration
from links import command

from positioner.bench import host, processes
from positioner.bench.configure import configuration_text
from positioner.bench.inprocess import run_in_process
from positioner.bench.play import BenchOptions, play
from positioner.bench.scenario import load_scenario
from positioner.bus.address import BusAddress
from positioner.config.reader import parse_config

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = [pytest.mark.kernel("controller"), pytest.mark.slow(short="doctor/test_doctor_link.py")]
SCENARIO = """
name = "controllers"
title = "two setpoints, a twentieth of a second each"
law = "nmpc"
setpoints_mm = [73.0, 80.0]
dwell_s = 0.05
seed = 7
"""


_LONG_S = 900.0
"""How long a process may take to start, and a frame to be answered: Python is some 25 times slower here."""


@pytest.fixture(scope="module", autouse=True)
def controllers() -> Iterator[None]:
    """Bring both interfaces up, as in docs/install.md."""
    for name in ("can0", "can1"):
        command("ip", "link", "set", name, "up", "type", "can", "bitrate", "1000000", "restart-ms", "100")
    yield
    for name in ("can0", "can1"):
        command("ip", "link", "set", name, "down")


def test_lockstep_between_two_controllers_gives_the_numbers_of_no_bus_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "_START_S", _LONG_S)
    monkeypatch.setattr(host, "_TIMEOUT_S", _LONG_S)
    (tmp_path / "scenario.toml").write_text(SCENARIO, encoding="utf-8")
    scenario = load_scenario(str(tmp_path / "scenario.toml"))
    text = configuration_text(scenario, BusAddress(channel="can0"), Path("state"))
    (tmp_path / "valve.toml").write_text(text, encoding="utf-8")
    (tmp_path / "plant.toml").write_text('preset = "paper"\n', encoding="utf-8")
    # not by the command, whose pictures take most of the time on this emulated processor
    options = BenchOptions(bus=None, lockstep=True, out=tmp_path, state=None, plant_bus=BusAddress(channel="can1"))
    recording, _ = play(scenario, options, parse_config(text, "valve.toml", tmp_path), tmp_path / "state")
    recording.write_log(tmp_path / "bus.log")
    run_in_process(scenario).recording.write_log(tmp_path / "no-bus.log")
    assert (tmp_path / "bus.log").read_bytes() == (tmp_path / "no-bus.log").read_bytes()
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
    for word in (printed.UP_AT_1000, printed.RESTARTS, f"can1 {printed.ERROR_ACTIVE}"):
        assert word in text, text
    assert found["feedback"]["level"] == "FAIL"  # no node sends now, and the doctor reports it
