"""A second law beside the acting one: what it would do is told, and nothing of it is sent."""

from __future__ import annotations

import json
import logging
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import pytest
from several_loop import PERIOD_S, SeveralLoop

from positioner.cli.main import main
from positioner.machine.journal import logger
from positioner.runtime import shadow as runtime_shadow
from positioner.shadow import law as shadow_law
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.cycle.input import CycleInput
    from positioner.runtime.session import Session
    from positioner.wire.messages import CanFrame

SAMPLES = 800
LAWS = """
from positioner.laws.registry import make_law


def same(parts):
    return make_law("nmpc", parts)


class Raises:
    def __init__(self, parts):
        pass

    def begin(self, measured_m):
        return 0

    def decide(self, memory, stem, observation, table):
        if memory == 300:
            raise SystemExit("no")
        return memory + 1, 12.0


class Stumbles:
    def __init__(self, parts):
        self.calls = 0

    def begin(self, measured_m):
        return 0

    def decide(self, memory, stem, observation, table):
        self.calls += 1
        if self.calls == 200:
            raise ArithmeticError("once")
        return memory, 12.0


class Begins:
    def __init__(self, parts):
        self.begun = 0

    def begin(self, measured_m):
        self.begun += 1
        return self.begun

    def decide(self, memory, stem, observation, table):
        return memory, 10.0 + memory


class Wild:
    def __init__(self, parts):
        pass

    def begin(self, measured_m):
        return 4.0

    def decide(self, memory, stem, observation, table):
        return 24.0 - memory, 24.0 - memory
"""


@dataclass
class Played:
    """The frames that were sent, the lines about the shadow, the log that was recorded, and the session."""

    frames: list[CanFrame]
    lines: list[str]
    record: Path
    config: Path
    session: Session


def played(folder: Path, **control: str) -> Played:
    """Return what 0.8 s have brought: five dwells of 0.15 s, and a rest."""
    before = logger.level
    logger.setLevel(logging.INFO)  # as the daemon has it
    folder.mkdir(exist_ok=True)
    (folder / "laws.py").write_text(LAWS, encoding="utf-8")
    record = folder / "record.log"
    try:
        with SeveralLoop(folder, ["FV-1"], control=dict(control), record=record) as loop:
            loop.run_to(SAMPLES)
    finally:
        logger.setLevel(before)
    return Played(loop.plants["FV-1"].sent, loop.logged("shadow"), record, folder / "plant.toml", loop.sessions["FV-1"])


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Played:
    """The run of the acting law without a shadow."""
    found = played(tmp_path_factory.mktemp("alone"))
    assert found.lines == []
    assert found.session.shadow is None
    return found


def test_the_acting_law_as_its_own_shadow_would_send_the_same(tmp_path: Path, alone: Played) -> None:
    run = played(tmp_path, shadow="laws.py:same")
    assert run.frames == alone.frames
    assert run.record.read_bytes() == alone.record.read_bytes()
    assert run.lines[0] == "shadow laws.py:same: runs beside nmpc, and sends nothing"
    pattern = (
        r"shadow laws.py:same: in all: (\d+) commands, began (\d+) moves where the acting law began (\d+); no current"
    )
    found = re.search(pattern, run.lines[-1])
    assert found, run.lines
    commands, own, acting = map(int, found.groups())
    assert commands > SAMPLES // 2
    assert own == acting > 2


@pytest.mark.parametrize("shadow", ["pi", "quasi-static", "laws.py:Wild"])
def test_another_law_changes_no_frame_no_line_of_the_record_and_no_sample_of_the_table(
    shadow: str, tmp_path: Path, alone: Played
) -> None:
    run = played(tmp_path, shadow=shadow)
    assert run.frames == alone.frames
    assert run.record.read_bytes() == alone.record.read_bytes()
    assert list(run.session.state.table) == list(alone.session.state.table)


def test_what_the_shadow_learns_is_its_own(tmp_path: Path) -> None:
    run = played(tmp_path, law="pi", shadow="paper")
    assert run.session.shadow is not None
    state = run.session.shadow._law._state
    assert state is not None
    assert state.table.sequence > 0
    assert run.session.state.table == StictionTable()


def test_the_shadow_begins_anew_where_the_acting_law_does(tmp_path: Path) -> None:
    run = played(tmp_path, law="laws.py:Stumbles", shadow="laws.py:Begins")
    assert "most -1.000 mA" in run.lines[-1]  # 11 instead of 12 mA at first, then 12
    assert run.lines[-1].startswith("shadow laws.py:Begins: in all: 798 commands, ")
    assert "24.9 % of them by more than 0.1 mA" in run.lines[-1]  # 199 of 798


def test_the_log_tells_what_a_replay_of_the_record_tells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = played(tmp_path, shadow="pi")
    _, first, worst, total = run.lines
    assert main(["replay", str(run.record), "--config", str(run.config), "--shadow", "pi", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    dwells = found["dwells"]
    assert [dwell["setpoint_m"] for dwell in dwells] == pytest.approx([0.08, 0.087, 0.073] * 2)
    assert first.startswith(f"shadow pi: at 80.000 mm for 0.1 s: {dwells[0]['cycles']} commands, ")
    most = max(dwells[1:], key=lambda dwell: abs(dwell["largest_difference_ma"]))
    assert f"at {1e3 * most['setpoint_m']:.3f} mm for" in worst
    assert worst.endswith(" (the worst; 4 more like it since the last line)")
    for line, told in ((first, dwells[0]), (worst, most), (total, found["total"])):
        assert f"current {told['mean_difference_ma']:.3f} mA off in the mean, " in line
        assert f", {100 * told['share_apart']:.1f} % of them by more than 0.1 mA, " in line
        assert f"most {told['largest_difference_ma']:+.3f} mA, with the stem at " in line
    assert total.startswith(f"shadow pi: in all: {sum(dwell['cycles'] for dwell in dwells)} commands, ")


def test_a_dwell_that_is_held_back_is_told_when_that_is_due(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime_shadow, "TOLD_EVERY_S", 0.2)
    before = logger.level
    logger.setLevel(logging.INFO)
    try:
        with SeveralLoop(tmp_path, ["FV-1"], control={"shadow": "pi"}, lockstep=False) as loop:
            loop.run_to(SAMPLES)
    finally:
        logger.setLevel(before)
    told = [
        (now_ns, line) for now_ns, line in zip(loop.logged_ns, loop.lines, strict=True) if " mm for 0.1 s: " in line
    ]
    # dwells end after 0.15, 0.3, 0.45, 0.6 and 0.75 s: the second is told when the third has not ended yet
    assert [line.split()[3] for _, line in told[:2]] == ["80.000", "87.000"]
    assert told[1][0] - told[0][0] == pytest.approx(0.2e9, abs=0.025e9)
    assert "more like it" not in told[1][1]


def test_a_shadow_that_raises_is_dropped_with_one_line_and_the_valve_is_controlled_as_before(
    tmp_path: Path, alone: Played
) -> None:
    run = played(tmp_path, shadow="laws.py:Raises")
    assert run.frames == alone.frames
    dropped = [line for line in run.lines if "dropped" in line]
    assert len(dropped) == 1
    assert dropped[0].startswith("shadow laws.py:Raises: dropped, and the valve is controlled as before: ")
    assert re.search(r"SystemExit: no \(laws\.py, line \d+\)$", dropped[0])
    assert run.lines[-1].startswith("shadow laws.py:Raises: in all: 300 commands, ")


def test_a_defect_of_the_shadow_ends_it_with_one_line(
    tmp_path: Path, alone: Played, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> NoReturn:
        raise LookupError("a defect")

    monkeypatch.setattr(shadow_law, "step", broken)
    run = played(tmp_path, shadow="pi")
    assert run.frames == alone.frames
    assert run.lines[1:] == ["shadow pi: dropped, and the valve is controlled as before: LookupError: a defect"]


@pytest.mark.parametrize(("every", "dropped"), [(1, 1), (3, 0)])
def test_a_shadow_that_makes_cycles_late_again_and_again_is_dropped(
    every: int, dropped: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []
    with SeveralLoop(tmp_path, ["FV-1"], control={"shadow": "pi"}, lockstep=False) as loop:

        def slow(_: object, cycle_input: CycleInput, *__: object) -> None:
            calls.append(cycle_input.late_ns)
            if len(calls) % every == 0:
                loop.time.sleep(1.5 * PERIOD_S)

        monkeypatch.setattr(shadow_law.ShadowLaw, "cycle", slow)
        loop.run_to(100)
        lines = [line for line in loop.logged("shadow") if "dropped" in line]
    assert len(lines) == dropped
    if dropped:
        told = "10 cycles in a row were late, and both laws share their time"
        assert lines == [f"shadow pi: dropped, and the valve is controlled as before: {told}"]
        assert len(calls) < 20
    else:
        assert sum(late_ns > 0 for late_ns in calls) > 10


CONFIGURATION = '[valve]\nid = "v"\npreset = "paper"\n[bus]\ninterface = "virtual"\nchannel = "v"\n[control]\n'


@pytest.mark.parametrize(
    ("control", "told"),
    [
        ('shadow = "quasi"', "line 8: control.shadow = 'quasi': is no law; "),
        ('shadow = "nmpc"', "line 8: control.shadow = 'nmpc': is the law that controls the valve; a shadow is another"),
        ('law = "pi"\nshadow = "pi"', "line 9: control.shadow = 'pi': is the law that controls the valve; "),
        ("shadow = 1", "control.shadow"),
    ],
)
def test_check_refuses_a_shadow_that_is_no_other_law_in_one_line(
    control: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(f"{CONFIGURATION}{control}\n", encoding="utf-8")
    assert main(["check", str(path)]) == 78
    error = capsys.readouterr().err
    assert told in error
    assert error.count("control.shadow") == 1


def test_check_names_the_shadow_and_an_empty_one_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(f'{CONFIGURATION}shadow = "quasi-static"\n', encoding="utf-8")
    assert main(["check", str(path)]) == 0
    assert re.search(r"^ *shadow +quasi-static, which sends nothing$", capsys.readouterr().out, re.MULTILINE)
    path.write_text(f'{CONFIGURATION}shadow = ""\n', encoding="utf-8")
    assert main(["check", str(path)]) == 0
    output = capsys.readouterr().out
    assert "sends nothing" not in output
    assert "plug-in" not in output
