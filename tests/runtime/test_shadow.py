"""A second law beside the acting one: what it would do is told, and nothing of it is sent."""

from __future__ import annotations

import logging
import re
from typing import TYPE_CHECKING, NoReturn

import pytest
from several_loop import SeveralLoop

from positioner.cli.main import main
from positioner.machine.journal import logger
from positioner.runtime import shadow

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.wire.messages import CanFrame

SAMPLES = 800
WRONG_LAW = """
class Wrong:
    def __init__(self, parts):
        pass

    def begin(self, measured_m):
        return None

    def decide(self, memory, stem, observation, table):
        raise ArithmeticError("no")
"""


def played(folder: Path, **control: str) -> tuple[list[CanFrame], list[str]]:
    """Return the frames of 0.8 s, and the lines about the shadow."""
    before = logger.level
    logger.setLevel(logging.INFO)  # as the daemon has it
    try:
        with SeveralLoop(folder, ["FV-1"], control=dict(control)) as loop:
            loop.run_to(SAMPLES)
    finally:
        logger.setLevel(before)
    return loop.plants["FV-1"].sent, loop.logged("shadow")


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> list[CanFrame]:
    """The frames of the acting law without a shadow."""
    frames, lines = played(tmp_path_factory.mktemp("alone"))
    assert lines == []
    return frames


def test_the_acting_law_as_its_own_shadow_would_send_the_same(tmp_path: Path, alone: list[CanFrame]) -> None:
    frames, (begun, line) = played(tmp_path, shadow="nmpc")
    assert frames == alone
    assert begun == "shadow nmpc: runs beside nmpc, and sends nothing"
    found = re.search(r"shadow nmpc: (\d+) commands, (\d+) moves where the acting law began (\d+); no current", line)
    assert found, line
    commands, own, acting = map(int, found.groups())
    assert commands > SAMPLES // 2
    assert own == acting > 2


def test_another_law_is_told_to_differ_and_changes_no_frame(tmp_path: Path, alone: list[CanFrame]) -> None:
    frames, (_, line) = played(tmp_path, shadow="pi")
    assert frames == alone
    found = re.search(
        r"shadow pi: .* current (\d\.\d+) mA off in the mean, most ([+-]\d+\.\d+) mA, with the stem", line
    )
    assert found, line
    assert 0.0 < float(found[1]) < abs(float(found[2]))


def test_a_line_comes_from_time_to_time_and_counts_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shadow, "TOLD_EVERY_NS", 200_000_000)
    _, (_, *lines) = played(tmp_path, shadow="pi")
    commands = [int(line.split("commands")[0].split()[-1]) for line in lines]
    assert len(commands) in {3, 4}
    assert max(commands) <= 201


def test_a_shadow_that_fails_is_counted_and_the_valve_is_controlled_as_before(
    tmp_path: Path, alone: list[CanFrame]
) -> None:
    (tmp_path / "wrong.py").write_text(WRONG_LAW, encoding="utf-8")
    frames, (_, line) = played(tmp_path, shadow="wrong.py:Wrong")
    assert frames == alone
    assert re.search(r"shadow .*: 0 commands, .*, \d+ fallbacks \(the last: .*ArithmeticError: no.*\)$", line), line


def test_a_defect_of_the_shadow_ends_it_with_one_line(
    tmp_path: Path, alone: list[CanFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> NoReturn:
        raise LookupError("a defect")

    monkeypatch.setattr(shadow, "step", broken)
    frames, (_, *lines) = played(tmp_path, shadow="pi")
    assert frames == alone
    assert lines == ["shadow pi: ended: LookupError: a defect"]


def test_check_names_the_shadow_and_refuses_one_that_is_no_law(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "valve.toml"
    text = '[valve]\nid = "v"\npreset = "paper"\n[bus]\ninterface = "virtual"\nchannel = "v"\n[control]\n'
    path.write_text(f'{text}shadow = "quasi-static"\n', encoding="utf-8")
    assert main(["check", str(path)]) == 0
    assert re.search(r"^ *shadow +quasi-static, which sends nothing$", capsys.readouterr().out, re.MULTILINE)
    path.write_text(f'{text}shadow = "quasi"\n', encoding="utf-8")
    assert main(["check", str(path)]) == 78
    assert "line 8: control.shadow = 'quasi': is no law" in capsys.readouterr().err
