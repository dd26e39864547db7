"""The step response test in the daemon's own loop, and from its record on the command line."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import write_configuration
from plant_world import PlantWorld

from positioner.bus.address import BusAddress
from positioner.bus.port import Ports
from positioner.cli.main import build_parser, main
from positioner.cli.step_test import step_test_of
from positioner.commissioning.results import kept
from positioner.commissioning.step.report import as_json
from positioner.commissioning.step.result import result_of
from positioner.config.reader import load_config
from positioner.errors import ExitCode
from positioner.runtime.procedure_run import ProcedureError, ProcedureRun
from positioner.runtime.session import RunOptions
from positioner.wire.messages import Health, PositionerStatus

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

PERIOD_S = 0.01
SPAN_M = 0.127
OPTIONS = ["--sizes", "5", "--repeats", "1", "--wait", "0.6", "--ladder", "1"]
IMPOSSIBLE = (
    (["--sizes", "0"], "must be percents above 0"),
    (["--sizes", "50"], "steps of 50 % around 60 % leave the range, 45.6 to 74.4 % of span"),
    (["--repeats", "0"], "must be 1 or more"),
    (["--wait", "0.1"], "must be 0.4 s or more, 40 periods"),
    (["--ladder", "7"], "must be 0 to 5 %"),
    (["--law", "nmcp"], "did you mean 'nmpc'"),
)


def written(folder: Path, **tables: Any) -> Path:
    address = BusAddress(interface="virtual", channel="none")
    return write_configuration(folder, address, **{"control": {"sample_period_s": PERIOD_S}, **tables})


class Run:
    """One test in virtual time, with a record."""

    def __init__(self, folder: Path, words: list[str]) -> None:
        self.path, self.log = written(folder), folder / "step.log"
        configuration = load_config(self.path)
        arguments = build_parser().parse_args(["step-test", "--config", str(self.path), *words])
        self.test = step_test_of(arguments, configuration)
        self.world = PlantWorld(round(PERIOD_S * 1e9), configuration.make_codec())
        options = RunOptions(record=self.log)
        ports = Ports(self.world, self.world.open)
        self.run = ProcedureRun(configuration, options, self.test, lambda _: None, ports)

    def until_end(self, each: Callable[[int], object] = lambda _: None) -> None:
        for number in range(60_000):
            each(number)
            self.run._cycle()
            if self.run._stopping:
                break
        assert self.run._stopping
        self.run._close()


@pytest.mark.slow(short="commissioning/test_step.py::test_in_closed_loop_the_figures_are_those_of_the_true_positions")
@pytest.mark.parametrize("law", ["nmpc", "hold"])
def test_the_record_gives_the_same_figures_to_the_last_digit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], law: str
) -> None:
    words = [*OPTIONS, "--law", law] if law == "nmpc" else [*OPTIONS, "--law", law, "--sizes", "80", "--ladder", "5"]
    run = Run(tmp_path, words)
    run.until_end()
    live = as_json(result_of(run.run.result(), run.test), "FV-101", ())
    assert live["sizes"][0]["moved"] == 1
    statuses = [sent.message for sent in run.world.sent if isinstance(sent.message, PositionerStatus)]
    assert {status.health for status in statuses} == {Health.FUNCTION_CHECK}
    assert run.world.device.plant.stem.position_m == pytest.approx(0.075, abs=0.006 * SPAN_M)
    page, picture = tmp_path / "step.html", tmp_path / "step.png"
    files = ["--report", str(page), "--picture", str(picture), "--as-reference"]
    command = ["step-test", "--config", str(run.path), "--from", str(run.log), "--json", *files, *words]
    capsys.readouterr()
    assert main(command) == ExitCode.OK
    told = json.loads(capsys.readouterr().out)
    assert {key: told[key] for key in live} == live
    assert len(told["responses"]) == 2
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert "Responses to" in page.read_text(encoding="utf-8")
    (result,) = kept(tmp_path / "state", "step-test")
    assert result.document == told


def test_a_limit_that_is_broken_is_told_and_ends_with_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Run(tmp_path, OPTIONS)
    run.until_end()
    path = written(tmp_path, step_test={"gain_error": 1e-9, "t86_s": 60.0})
    capsys.readouterr()
    command = ["step-test", "--config", str(path), "--from", str(run.log), *OPTIONS]
    assert main([*command, "--picture", str(tmp_path / "step.svg")]) == ExitCode.FAILURE
    lines = capsys.readouterr().out.splitlines()
    drawn = (tmp_path / "step.svg").read_text(encoding="utf-8")
    for words in ("Responses to 5 %", "time since the step, ms", "5 % C"):
        assert words in drawn
    assert any(line.startswith("Median ± sample period (least to largest of the repeats") for line in lines)
    assert lines[0] == "FV-101: step response test, closed loop with nmpc: a limit is broken"
    assert [line.split(" at")[0] for line in lines[2:4]] == ["- limit broken: travel gain"] * 2
    assert main([*command, "--repeats", "2"]) == ExitCode.IO
    assert "not its record" in capsys.readouterr().err


def test_an_interrupt_brings_the_stem_back(tmp_path: Path) -> None:
    run = Run(tmp_path, OPTIONS)
    run.until_end(lambda number: run.run._stop(2, None) if number == 400 else None)
    with pytest.raises(ProcedureError, match="step-test: stopped by a person; at the last reading the stem was 0"):
        run.run.result()
    assert run.world.device.plant.stem.position_m == pytest.approx(0.075, abs=0.006 * SPAN_M)


def test_lost_feedback_ends_it_by_the_guard(tmp_path: Path) -> None:
    run = Run(tmp_path, OPTIONS)

    def silence(number: int) -> None:
        run.world.plant_silent = run.world.plant_silent or number == 400

    run.until_end(silence)
    with pytest.raises(ProcedureError, match="FAILSAFE, feedback stale"):
        run.run.result()


@pytest.mark.parametrize(("words", "message"), IMPOSSIBLE, ids=[words[0] for words, _ in IMPOSSIBLE])
def test_what_the_valve_cannot_do_is_refused_before_it_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert main(["step-test", "--config", str(written(tmp_path)), "--yes", *words]) == ExitCode.USAGE
    assert message in capsys.readouterr().err
