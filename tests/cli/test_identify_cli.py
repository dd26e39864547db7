"""`positioner identify` on the command line: what it refuses before a valve can move, and workshop units."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import write_configuration

from positioner.bus.address import BusAddress
from positioner.cli.main import main
from positioner.cli.procedure import keep_result, procedure_configuration, reference_of
from positioner.commissioning.units import area_m2, pressure_gain
from positioner.errors import ExitCode, UsageError
from positioner.store import lock

if TYPE_CHECKING:
    from pathlib import Path


def test_it_is_refused_while_the_daemon_runs_and_names_the_command_that_stops_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_configuration(tmp_path, BusAddress(interface="virtual", channel="none"))
    (tmp_path / "state").mkdir()
    with lock.held(tmp_path / "state", timeout_s=0.0):
        assert main(["identify", "--config", str(path), "--yes"]) == ExitCode.TEMPORARY
    error = capsys.readouterr().err
    assert "the positioner of FV-101 runs" in error
    assert "kill " in error


def test_without_a_person_and_without_yes_nothing_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_configuration(tmp_path, BusAddress(interface="virtual", channel="none"), guard={"current_low_ma": 6.0})
    monkeypatch.setattr("sys.stdin", None)
    assert main(["identify", "--config", str(path)]) == ExitCode.USAGE
    error = capsys.readouterr().err
    assert "6 to 20 mA, rate free" in error
    assert "add --yes" in error


@pytest.mark.parametrize("command", ["identify", "signature", "step-test", "stroke-test"])
@pytest.mark.parametrize(("name", "why"), [("nowhere/a.png", "there is no folder"), ("fv101.2", "is no picture")])
def test_a_picture_that_cannot_be_written_is_refused_before_the_valve_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, name: str, why: str
) -> None:
    path = write_configuration(tmp_path, BusAddress(interface="virtual", channel="none"))
    arguments = [command, "--config", str(path), "--yes", "--picture", str(tmp_path / name)]
    assert main(arguments) == ExitCode.USAGE
    assert why in capsys.readouterr().err


def test_a_report_that_cannot_be_written_is_refused_before_the_valve_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_configuration(tmp_path, BusAddress(interface="virtual", channel="none"))
    arguments = ["signature", "--config", str(path), "--yes", "--report", str(tmp_path / "nowhere" / "a.html")]
    assert main(arguments) == ExitCode.USAGE
    assert "there is no folder" in capsys.readouterr().err


def test_workshop_units_are_read_exactly() -> None:
    assert pressure_gain("3-15psi") == pytest.approx(0.75 * 6894.757293168, rel=1e-12)
    assert pressure_gain("0.2 - 1 bar") == pytest.approx(5000.0, rel=1e-12)
    assert area_m2("100in2") == pytest.approx(0.064516, rel=1e-12)
    assert pressure_gain("0,2-1 BAR") == pytest.approx(5000.0, rel=1e-12)
    assert area_m2("645,16 CM2") == pytest.approx(0.064516, rel=1e-12)
    for text in ("15-3psi", "3psi", "3-15 furlongs"):
        with pytest.raises(UsageError, match="write it like 3-15psi"):
            pressure_gain(text)
    with pytest.raises(UsageError, match="write it like 100in2"):
        area_m2("0in2")


def test_a_result_is_kept_but_not_that_of_an_older_record_unless_it_is_to_be_the_reference(tmp_path: Path) -> None:
    path = write_configuration(tmp_path, BusAddress(interface="virtual", channel="none"))
    report = tmp_path / "report.html"
    given = {"config": path, "valve": None, "bus": None, "state": None, "record": None, "report": report}
    live, older, named = (
        Namespace(**given, log=log, as_reference=as_reference)
        for log, as_reference in ((None, False), (path, False), (path, True))
    )
    configuration = procedure_configuration(live)
    for number, arguments in enumerate((older, live, live, older)):
        keep_result(arguments, configuration, "trial", {"valve": "FV-101", "number": number})

    def reference() -> object:
        kept = reference_of(live, configuration, "trial")
        return kept and kept.document["number"]

    assert reference() == 1
    assert len(list((tmp_path / "state" / "results").iterdir())) == 2
    assert "<h2>Trial <small>measured" in report.read_text(encoding="utf-8")
    keep_result(named, configuration, "trial", {"valve": "FV-101", "number": 4})
    assert reference() == 4
