"""`positioner conformance` on a bus: the emulator and our own host as processes, and nodes that are not there."""

from __future__ import annotations

import json
import re
import threading
import time
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import TIMEOUT_S, own_address, write_configuration

from positioner.bench.processes import BenchProcess
from positioner.bus.port import BusPort
from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.wire.codec import make_codec
from positioner.wire.messages import CurrentCommand, Setpoint

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.bus.address import BusAddress

pytestmark = pytest.mark.bus
OF_TIME = {"period", "gaps", "cadence", "silence", "grace"}
"""Rules that a busy machine may break for an honest node."""
OF_FRAMES = {"received", "format", "crc", "values", "spare", "counter"}


def reported(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    status = main(["conformance", *arguments, "--json"])
    return status, json.loads(capsys.readouterr().out)


def verdicts(report: dict[str, Any]) -> dict[str, str]:
    return {rule["name"]: rule["verdict"] for rule in report["rules"]}


def emulator(folder: Path, bus: BusAddress, *more: str) -> BenchProcess:
    plant = folder / "plant.toml"
    plant.write_text('preset = "paper"\ndeadman_s = 0.3\n', encoding="utf-8")
    arguments = ["run", "--config", str(plant), "--bus", str(bus), "--period", "0.02", *more]
    child = BenchProcess("plant_emulator.cli.main", arguments, folder / "plant.log")
    child.wait_for("READY=1")
    return child


def await_setpoint(bus: BusAddress, child: BenchProcess) -> None:
    port, end_s = BusPort(bus, [make_codec().identifier(Setpoint)]), time.monotonic() + TIMEOUT_S
    port.open()
    while not port.receive(0.05) and time.monotonic() < end_s:
        child.check()
    port.close()


def test_the_emulator_conforms_on_a_bus(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bus = own_address()
    with emulator(tmp_path, bus, "--id-offset", "128"):
        status, report = reported(
            capsys, "plant", "--bus", str(bus), "--period", "0.02", "--deadman", "0.3", "--id-offset", "128",
            "--currents", "8:9", "--travel=-10:150",
        )  # fmt: skip
    found = verdicts(report)
    assert {found[name] for name in OF_FRAMES | {"travel"}} == {"pass"}
    assert "not seen" not in {found[name] for name in found if name not in OF_TIME}, report
    if found["gaps"] == "pass":  # an emulator that gets no processor reacts late, too
        assert {name for name, verdict in found.items() if verdict == "fail"} <= OF_TIME, report
    assert (status == ExitCode.OK) is report["conforms"]


def test_our_own_host_conforms_on_a_bus(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bus = own_address()
    config = write_configuration(tmp_path, bus)
    arguments = ["host", "--config", str(config), "set", "80"]
    with emulator(tmp_path, bus), BenchProcess("positioner", arguments, tmp_path / "host.log") as child:
        await_setpoint(bus, child)
        status, report = reported(capsys, "host", "--bus", str(bus), "--listen", "3", "--travel", "0:139.7")
        child.check()
    found = verdicts(report)
    assert {name for name, verdict in found.items() if verdict == "fail"} <= OF_TIME, report
    assert {found[name] for name in OF_FRAMES | {"travel"}} == {"pass"}
    assert (status == ExitCode.OK) is report["conforms"]


def test_a_missing_node_fails_with_one_line_and_a_fix(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for node, message in (("plant", "STEM_POSITION"), ("host", "SETPOINT")):
        assert main(["conformance", node, "--bus", str(own_address()), "--listen", "0.1"]) == ExitCode.FAILURE
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].startswith(f"the {node} breaks the rules: 0 pass, 1 fail")
        assert any(re.fullmatch(rf"FAIL +received +it sends {message}", line) for line in lines)
        assert lines[-2].startswith(f"- received, first: no {message} came")
        assert "id_offset" in lines[-1]


def test_a_plant_that_somebody_else_commands_is_left_alone(capsys: pytest.CaptureFixture[str]) -> None:
    bus = own_address()
    stop = threading.Event()
    other = threading.Thread(target=command_until, args=(bus, stop))
    other.start()
    try:
        status = main(["conformance", "plant", "--bus", str(bus), "--currents", "8:9", "--listen", "60"])
    finally:
        stop.set()
        other.join()
    assert status == ExitCode.UNAVAILABLE
    assert re.search("another controller commands the plant on .*: stop it first", capsys.readouterr().err)


def command_until(bus: BusAddress, stop: threading.Event) -> None:
    port, counter = BusPort(bus), 0
    port.open()
    while not stop.wait(0.02):
        port.send(make_codec().encode(CurrentCommand(8.0), counter))
        counter += 1
    port.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--currents", "8"], "'8' is not LOW:HIGH within 3.8 and 20.5 mA"),
        (["--currents", "9:8"], "'9:8' is not LOW:HIGH"),
        (["--currents", "3:8"], "'3:8' is not LOW:HIGH"),
        (["--travel", "a:b"], "'a:b' is not LOW:HIGH within -1000 and 1000 mm"),
        (["--period", "0"], "'0' is not a time from 0.0001 to 3600 s"),
        (["--deadman", "x"], "'x' is not a time"),
    ],
)
def test_a_wrong_argument_is_a_wrong_command_line(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["conformance", "plant", "--bus", "virtual:0", *arguments])
    assert ended.value.code == ExitCode.USAGE
    assert message in capsys.readouterr().err


def test_a_wrong_id_offset_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["conformance", "host", "--bus", "virtual:0", "--id-offset", "100"]) == ExitCode.CONFIG
    assert "id_offset = 100: must be a multiple of 128" in capsys.readouterr().err
