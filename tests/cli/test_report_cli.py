"""`positioner report` on the command line: what it finds in the state directory, and where the page goes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from daemon_helpers import write_configuration
from report_samples import signature, stroke_test
from several_loop import SeveralLoop

from positioner.bus.address import BusAddress
from positioner.cli.main import main
from positioner.commissioning import results
from positioner.errors import ExitCode

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def configuration(tmp_path: Path) -> Path:
    return write_configuration(tmp_path, BusAddress(interface="virtual", channel="none"))


def test_without_anything_measured_it_says_what_to_run(
    configuration: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(configuration.parent)
    assert main(["report", "--config", str(configuration)]) == ExitCode.OK
    assert capsys.readouterr().out == "FV-101.html\n"
    text = (configuration.parent / "FV-101.html").read_text(encoding="utf-8")
    for command in ("identify", "signature", "step-test", "stroke-test"):
        assert f"positioner {command} --config {configuration}" in text
    assert "Not judged yet" in text


def test_the_newest_result_stands_over_the_reference_and_another_valve_is_left_out(
    configuration: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state, page = tmp_path / "state", tmp_path / "page.html"
    for document in (signature(), signature(1.1), signature(1.27), signature() | {"valve": "FV-102"}):
        results.keep(state, "signature", document)
    results.keep(state, "stroke-test", stroke_test("failed", "stuck", "no motion", 1.3))
    assert main(["report", "--config", str(configuration), "--out", str(page)]) == ExitCode.OK
    assert f"{state}: signature of valve FV-102 is left out" in capsys.readouterr().err
    text = page.read_text(encoding="utf-8")
    assert "+27.0" in text
    assert "+10.0" not in text
    assert "<h2>Failure</h2>" in text


def test_a_page_that_cannot_be_written_is_one_line(
    configuration: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "nowhere" / "page.html"
    assert main(["report", "--config", str(configuration), "--out", str(missing)]) == ExitCode.IO
    assert capsys.readouterr().err.endswith(f"{missing}: cannot be written: No such file or directory\n")


def test_the_use_in_the_state_and_in_the_record_of_the_run_are_the_same(tmp_path: Path) -> None:
    with SeveralLoop(tmp_path, ["FV-1"], record=tmp_path / "bus.log") as loop:
        loop.run_to(1500)
    shown = []
    for more in ([], ["--from", str(tmp_path / "bus.log")]):
        page = tmp_path / "page.html"
        arguments = ["report", "--config", str(tmp_path / "plant.toml"), "--out", str(page), *more]
        assert main(arguments) == ExitCode.OK
        text = page.read_text(encoding="utf-8")
        shown.append([line for line in text.splitlines() if line.startswith(("<rect", "<div><dt>"))])
    assert len(shown[0]) > 60
    assert shown[0] == shown[1]


def test_a_damaged_health_is_told_and_the_report_goes_without_it(
    configuration: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "health.json").write_text("{", encoding="utf-8")
    page = tmp_path / "page.html"
    assert main(["report", "--config", str(configuration), "--out", str(page)]) == ExitCode.OK
    assert "the report goes without it" in capsys.readouterr().err
    assert "Nothing was counted yet" in page.read_text(encoding="utf-8")
