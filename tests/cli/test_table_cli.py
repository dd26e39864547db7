"""`positioner table`: its four commands, and their mistakes."""

from __future__ import annotations

import csv
import io
import json
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from store_helpers import opened, series, taught, wait_for

from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.store import access, document
from positioner.store.table_directory import TABLE

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def state(tmp_path: Path) -> Path:
    directory = tmp_path / "state"
    directory.mkdir()
    access.replace(directory, taught(series(200)), force=False)
    return directory


def test_a_dump_is_an_aligned_table_with_a_line_for_each_position_and_direction(
    state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["table", "dump", "--state", str(state)]) == ExitCode.OK
    summary, blank, names, units, rule, *lines, blank_too, legend, _ = capsys.readouterr().out.split("\n")
    assert summary == "valve FV-101: 200 samples in 30 cells of 5 mm"
    assert (blank, blank_too) == ("", "")
    assert " ".join(names.split()) == "position stick speed breakaway Γ landing bias"
    assert units.split() == ["mm", "direction", "mm/s", "n", "mA", "n", "mm", "n", "age", "newest"]
    assert legend.startswith("Mean ± spread of the last ten")
    assert len(lines) == len({(key.index, key.direction) for key, _ in taught(series(200)).table})
    assert set(rule) == {"─"}
    ends = {line.index(" ±") for line in lines if "–" not in line[:40]}
    assert len(ends) == 1
    assert {len(line) for line in lines} == {len(rule)}


def test_a_dumped_line_has_means_in_the_units_of_its_header(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["table", "dump", "--state", str(state), "--quantity", "stick_speed_m_per_s"])
    line = capsys.readouterr().out.split("\n")[6].split()  # closing comes first
    values = [0.01 + number / 102_400 for number in (0, 30, 60, 90, 120, 150, 180)]  # sample(0) and every 30th after it
    mean = sum(values) / 7
    spread = (sum((value - mean) ** 2 for value in values) / 7) ** 0.5
    assert line[:5] == ["0.0", "opening", f"{mean * 1e3:.1f}", "±", f"{spread * 1e3:.1f}"]
    assert line[5:11] == ["7", "–", "–", "–", "–", "19"]


def test_an_empty_table_is_reported_as_empty(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    access.reset(state)
    main(["table", "dump", "--state", str(state)])
    assert capsys.readouterr().out == "valve FV-101: 0 samples in 0 cells of 5 mm: the table is empty\n"


def test_a_dump_as_json_is_the_format_of_an_export(
    state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["table", "dump", "--state", str(state), "--format", "json"])
    dumped = capsys.readouterr().out
    assert main(["table", "export", str(tmp_path / "x.json"), "--state", str(state)]) == ExitCode.OK
    assert (tmp_path / "x.json").read_text(encoding="utf-8") == dumped
    assert document.loads(dumped, "x").table == taught(series(200)).table


def test_a_dump_as_csv_has_a_row_for_each_cell(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["table", "dump", "--state", str(state), "--format", "csv", "--quantity", "landing_bias_m"])
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    cells = [(key, cell) for key, cell in taught(series(200)).table if key.quantity == "landing_bias_m"]
    assert len(rows) == len(cells) == 10
    for row, (key, cell) in zip(rows, cells, strict=True):
        assert row["direction"] == key.direction
        assert float(row["position_m"]) == pytest.approx(key.index * 0.005)
        assert [float(value) for value in row["samples"].split()] == list(cell.samples)
        assert float(row["mean"]) == cell.mean
        assert int(row["age"]) == 200 - cell.sequence


def test_importing_an_export_changes_nothing(state: Path, tmp_path: Path) -> None:
    before = access.dump(state)
    file = str(tmp_path / "x.json")
    main(["table", "export", file, "--state", str(state)])
    assert main(["table", "import", file, "--state", str(state)]) == ExitCode.OK
    after = access.dump(state)
    assert (after.table, after.recorded_s, after.valve_id) == (before.table, before.recorded_s, before.valve_id)


def test_an_export_never_overwrites_a_file(state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "x.json"
    file.write_text("precious")
    assert main(["table", "export", str(file), "--state", str(state)]) == ExitCode.IO
    assert capsys.readouterr().err == f"positioner: {file}: exists already; choose another name\n"
    assert file.read_text() == "precious"


def test_a_reset_prints_a_command_that_undoes_it(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["table", "reset", "--yes", "--state", str(state)]) == ExitCode.OK
    *_, command = capsys.readouterr().out.strip().split("\n")
    assert len(access.dump(state).table) == 0
    program, *arguments = command.split()
    assert program == "positioner"
    assert main(arguments) == ExitCode.OK
    assert access.dump(state).table == taught(series(200)).table


def end_of_input(_: str) -> str:
    raise EOFError


def test_a_reset_asks_first_and_without_a_terminal_refuses(
    state: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["table", "reset", "--state", str(state)]) == ExitCode.IO
    assert "give --yes" in capsys.readouterr().err
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", end_of_input)
    assert main(["table", "reset", "--state", str(state)]) == ExitCode.USAGE
    monkeypatch.setattr("builtins.input", lambda _: "")
    assert main(["table", "reset", "--state", str(state)]) == ExitCode.USAGE
    assert access.dump(state).table.sequence == 200
    monkeypatch.setattr("builtins.input", lambda _: "Yes")
    assert main(["table", "reset", "--state", str(state)]) == ExitCode.OK
    assert len(access.dump(state).table) == 0


def test_a_reset_reaches_a_running_daemon(tmp_path: Path) -> None:
    writer, _, _ = opened(tmp_path)
    writer.record(series(30))
    wait_for(writer, lambda: writer.saved)
    assert main(["table", "reset", "--yes", "--state", str(tmp_path)]) == ExitCode.OK
    wait_for(writer, lambda: writer.saved and writer._stored.table.sequence == 0)
    assert writer.close(10.0) is None


def test_importing_a_bad_file_reports_every_mistake_and_changes_nothing(
    state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = json.loads(document.dumps(taught(series(30))))
    plain["valve"] = ""
    plain["cells"][3]["count"] = -1
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(plain))
    assert main(["table", "import", str(file), "--state", str(state)]) == ExitCode.CONFIG
    first, second = capsys.readouterr().err.strip().split("\n")
    assert first == f"positioner: {file}: valve: must be a printable text, not ''"
    assert second == f"{file}: cells[3].count: must be greater than or equal to 1, not -1"
    assert access.dump(state).table.sequence == 200


@pytest.mark.parametrize("content", [None, b"\xff\xfe"])
def test_a_file_that_cannot_be_read_is_one_clear_line(
    state: Path, tmp_path: Path, content: bytes | None, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bad.json"
    if content:
        file.write_bytes(content)
    assert main(["table", "import", str(file), "--state", str(state)]) == ExitCode.IO
    assert capsys.readouterr().err.startswith(f"positioner: {file}: {'is not UTF-8' if content else 'cannot be read'}")


def test_a_table_that_is_not_there_is_one_clear_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["table", "dump", "--state", str(tmp_path)]) == ExitCode.IO
    assert capsys.readouterr().err == f"positioner: {tmp_path / TABLE} does not exist\n"


def test_a_configuration_names_the_directory_and_checks_whose_table_is_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    state = tmp_path / "new"
    state.mkdir()
    configuration = SimpleNamespace(
        valve=SimpleNamespace(id="FV-101"), control=SimpleNamespace(table_cell_m=0.005), state_directory=state
    )
    monkeypatch.setattr("positioner.config.reader.load_config", lambda _path, **_: configuration)
    file = tmp_path / "x.json"
    command = ["table", "import", str(file), "--config", "valve.toml"]

    file.write_text(document.dumps(taught(series(7), width_m=0.004)))
    assert main([*command, "--force"]) == ExitCode.IO
    assert "has cells of 0.004 m, the configuration's are 0.005 m wide" in capsys.readouterr().err

    file.write_text(document.dumps(taught(series(7), valve_id="FV-202")))
    assert main(command) == ExitCode.IO
    assert "the table is of valve 'FV-202', the configuration's is 'FV-101'; see --force" in capsys.readouterr().err
    assert list(state.iterdir()) == []

    assert main([*command, "--force"]) == ExitCode.OK
    assert access.dump(state).valve_id == "FV-101"


@pytest.mark.parametrize("command", ["dump", "reset", "export", "import"])
def test_the_help_of_each_command_ends_with_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["table", command, "--help"])
    assert caught.value.code == 0
    assert f"example: positioner table {command} " in capsys.readouterr().out
