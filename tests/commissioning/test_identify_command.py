"""`positioner identify` from its question to its exit status: what it writes, keeps, and leaves when it is ended."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import write_configuration
from plant_world import PlantWorld
from test_report import FOUND

from positioner.bus.address import BusAddress
from positioner.bus.port import Ports
from positioner.cli.main import main
from positioner.commissioning.explained import SLIPPING, STEPS, STROKES, Part
from positioner.config.reader import load_config
from positioner.errors import ExitCode
from positioner.machine.console import INTERRUPTED
from positioner.runtime import daemon

if TYPE_CHECKING:
    from pathlib import Path

PERIOD_S = 0.02
CURVE = ((0.05, 0.004), (0.06, -0.004))
GOOD = Part(STROKES, "", -1.0, 0.0001, 0.0014, CURVE)
BAD = Part(STROKES, "", 1.0, 0.0041, 0.0014, CURVE)
ALSO_BAD = Part(STEPS, SLIPPING, 1.0, 0.0035, 0.0014, CURVE)


class Commanded:
    """The command on an emulated valve in virtual time; its evaluation is replaced, since a real one takes minutes."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, capture: pytest.CaptureFixture[str]) -> None:
        address = BusAddress(interface="virtual", channel="none")
        self.path = write_configuration(folder, address, control={"sample_period_s": PERIOD_S})
        self.state, self._capture, self._patch = folder / "state", capture, patch
        patch.setattr("positioner.cli.procedure.lock_memory", lambda: None)
        self.found: Any = FOUND
        self.evaluated: list[Any] = []
        patch.setattr("positioner.cli.identify.identify", self._evaluate)

    def _evaluate(self, stretches: Any, *_: Any) -> Any:
        self.evaluated.append(stretches)
        if self.found is None:
            raise KeyboardInterrupt
        return self.found

    def typed(self, *words: str) -> tuple[int, str, str]:
        """Return the exit status, and what was printed on both streams."""
        world = PlantWorld(round(PERIOD_S * 1e9), load_config(self.path).make_codec())
        self._patch.setattr(daemon, "Ports", lambda: Ports(world, world.open))
        code = main(["identify", "--config", str(self.path), *words])
        return code, *self._capture.readouterr()

    @property
    def log(self) -> Path:
        """The record that the command makes by itself."""
        return self.state / "identify.log"

    @property
    def results(self) -> list[Path]:
        return list((self.state / "results").glob("identify*"))


@pytest.fixture
def commanded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Commanded:
    return Commanded(tmp_path, monkeypatch, capsys)


def test_a_fit_that_does_not_explain_its_record_is_shown_but_neither_written_nor_kept(
    commanded: Commanded, tmp_path: Path
) -> None:
    before = commanded.path.read_text(encoding="utf-8")
    commanded.found = replace(FOUND, parts=(GOOD, BAD, ALSO_BAD))
    page = tmp_path / "identify.html"
    code, out, error = commanded.typed("--yes", "--write", "--report", str(page))
    assert code == ExitCode.DATA
    assert (
        "not explained: strokes, opening: the readings are 4.10 mm off the fitted valve (RMS), at most 1.40 mm" in out
    )
    assert "strokes, closing" not in out
    assert "(strokes, opening; steps, in the slip, opening): nothing was written or kept" in error.splitlines()[-1]
    assert commanded.path.read_text(encoding="utf-8") == before
    assert commanded.results == []
    html = page.read_text(encoding="utf-8")
    assert "The fitted valve does not explain its record: strokes, opening; steps, in the slip, opening." in html
    assert html.count("Readings beside the fitted valve") >= 2
    assert f"the record of this test: {commanded.log}; --from evaluates it" in error
    code, out, _ = commanded.typed("--from", str(commanded.log), "--write", "--force", "--json")
    assert code == ExitCode.OK
    assert json.loads(out)["explained"] is False
    assert load_config(commanded.path).valve.actuator.fill_time_constant_s == 0.05
    assert commanded.evaluated[1] == commanded.evaluated[0]


def test_a_fit_that_explains_its_record_is_written_and_kept_and_leaves_no_record(commanded: Commanded) -> None:
    commanded.found = replace(FOUND, parts=(GOOD,))
    code, _, error = commanded.typed("--yes", "--write")
    assert code == ExitCode.OK, error
    assert load_config(commanded.path).valve.actuator.fill_time_constant_s == 0.05
    assert len(commanded.results) == 1
    assert not commanded.log.exists()


def test_an_evaluation_that_is_ended_by_ctrl_c_leaves_the_record_which_gives_the_same_readings(
    commanded: Commanded,
) -> None:
    commanded.found = None
    code, out, error = commanded.typed("--yes", "--write")
    assert code == INTERRUPTED
    assert out == ""
    assert f"the record of this test: {commanded.log}; --from evaluates it" in error
    assert commanded.results == []
    commanded.found = replace(FOUND, parts=(GOOD,))
    code, _, error = commanded.typed("--from", str(commanded.log), "--write")
    assert code == ExitCode.OK, error
    assert commanded.evaluated[1] == commanded.evaluated[0]
    assert commanded.log.exists()  # it was not this command that made it
