"""The export of a log as users walk it: every signal to the bit, in SI units, from our DBC and from their own."""

from __future__ import annotations

import csv
import json
import os
import shutil
import stat
from typing import TYPE_CHECKING, Any

import can
import cantools.database
import pytest
import replay_helpers as runs
from cantools.database.can import Database
from user_dbc import USER_DBC

from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.export.signals import Messages
from positioner.export.units import column_name
from positioner.export.whole_file import whole_file
from positioner.machine.console import INTERRUPTED
from positioner.replay.log import read_log
from positioner.wire.codec import make_codec, packaged_dbc_text
from positioner.wire.messages import CanFrame, CurrentCommand, PlantTruth, StemPosition

if TYPE_CHECKING:
    from pathlib import Path

    Output = pytest.CaptureFixture[str]

USER_WIRE = """
[valve]
id = "FV-101"
preset = "paper"

[wire]
dbc = "user.dbc"
stem_position = { message = "Travel", signals = { position_m = "Travel", quality = "Health" }, counter = "Alive" }
current_command = { message = "Drive", signals = { current_ma = "Demand" }, counter = "Alive" }
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return runs.write_bench_log(tmp_path_factory.mktemp("bench"), runs.scenario("pi", seconds=0.3))


@pytest.fixture
def user(tmp_path: Path) -> tuple[Path, Path]:
    """A log of a bus of the user's, two frames a message, and the configuration that names them."""
    (tmp_path / "user.dbc").write_text(USER_DBC, encoding="cp1252")
    (tmp_path / "valve.toml").write_text(USER_WIRE, encoding="utf-8")
    lines = [
        f"(10.000000) can0 {2566834688 - (1 << 31):08X}#0D1B5800FF9C",
        "(10.000500) can0 200#09C40500",
        "(10.001000) can0 204#0064006400000000",
        "(10.001250) can0 204#0100640000000000",
        "(10.002000) can0 7FF#00",
        "(10.003000) can0 205#0A",
        "(10.004000) can0 205#0A00FF0055",
    ]
    (tmp_path / "bus.log").write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    return tmp_path / "bus.log", tmp_path / "valve.toml"


def export(*words: object) -> int:
    return main(["export", *map(str, words)])


def database(text: str) -> Database:
    dbc = cantools.database.load_string(text, "dbc")
    assert isinstance(dbc, Database)
    return dbc


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_signal_of_every_frame_is_in_the_csv_to_the_bit(bench: tuple[Path, Path], tmp_path: Path) -> None:
    log, config = bench
    out = tmp_path / "bus.csv"
    assert export(log, "--config", config, "--out", out) == ExitCode.OK
    rows, recorded = rows_of(out), list(can.LogReader(log))
    assert len(rows) == len(recorded)
    dbc = database(packaged_dbc_text())
    codec, units = make_codec(), {"mm": 1e-3, "mm/s": 1e-3, "kPa": 1e3}
    numbers = 0
    for row, frame in zip(rows, recorded, strict=True):
        assert float(row["time_s"]) == frame.timestamp
        message = dbc.get_message_by_frame_id(frame.arbitration_id)
        raws: Any = message.decode(bytes(frame.data), decode_choices=False, scaling=False)
        cells = {name: text for name, text in row.items() if text and name != "time_s"}
        assert len(cells) == len(raws)
        for (name, text), signal in zip(cells.items(), message.signals, strict=True):
            factor = units.get(signal.unit or "", 1.0)
            scale, offset = float(signal.scale) * factor, float(signal.offset) * factor
            assert name.startswith(f"{message.name}/")
            assert round((float(text) - offset) / scale) == raws[signal.name]
            assert float(text) == pytest.approx(float(raws[signal.name]) * scale + offset, rel=1e-12)
            numbers += 1
        decoded, _ = codec.decode(CanFrame(frame.arbitration_id, bytes(frame.data)))
        match decoded:  # what the positioner reads, equal to the bit
            case StemPosition():
                assert float(cells["STEM_POSITION/Position_m"]) == decoded.position_m
            case CurrentCommand():
                assert float(cells["CURRENT_COMMAND/Current_mA"]) == decoded.current_ma
            case PlantTruth():
                assert float(cells["PLANT_TRUTH/TruePosition_m"]) == decoded.position_m
    assert numbers > 4000


def test_the_description_beside_the_csv_has_unit_and_comment_of_each_column(
    bench: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "bus.csv"
    assert export(bench[0], "--out", out) == ExitCode.OK
    document = json.loads((tmp_path / "bus.csv-metadata.json").read_text("utf-8"))
    assert document["url"] == "bus.csv"
    columns = {each["titles"]: each for each in document["tableSchema"]["columns"]}
    assert list(columns) == list(rows_of(out)[0])
    position, mode = columns["STEM_POSITION/Position_m"], columns["CURRENT_COMMAND/Mode"]
    assert (position["schema:unitText"], position["dc:description"]) == ("m", "Measured stem position.")
    assert (position["datatype"], mode["datatype"]) == ("double", "integer")
    assert mode["dc:description"].startswith("Mode of the positioner.; 0 INIT, 1 READY, 2 ACTIVE, 3 HOLD")
    assert all(each["dc:description"] for each in columns.values())


def test_a_foreign_dbc_gives_mapped_and_unmapped_signals(user: tuple[Path, Path], capsys: Output) -> None:
    log, config = user
    assert export(log, "--config", config, "--to", "csv") == ExitCode.OK
    rows = rows_of(log.with_suffix(".csv"))
    assert [float(row["time_s"]) for row in rows] == [10.0, 10.0005, 10.001, 10.00125, 10.004]
    travel, drive, first, second, tail = ({key: text for key, text in row.items() if text} for row in rows)
    # raw 7000: 60 % of the paper's span of 127 mm; a temperature of -100 tenths
    assert float(travel["Travel/Travel_m"]) == pytest.approx(0.6 * 0.127, rel=1e-12)
    assert travel["Travel/Alive"] == "13"
    assert float(travel["Travel/Temperature_degC"]) == pytest.approx(-10.0, rel=1e-12)
    assert float(drive["Drive/Demand_mA"]) == pytest.approx(4.0 + 0.16 * 25.0, rel=1e-12)
    # page 0 holds the travel, page 1 does not
    assert first["Mixed/Page"] == "0"
    assert float(first["Mixed/Travel_m"]) == pytest.approx(0.001, rel=1e-12)
    assert second == {"time_s": "10.00125", "Mixed/Page": "1"}
    # one byte more than the DBC says; an unmapped position is in m, too
    assert float(tail["Tail/Target_m"]) == pytest.approx(0.0001, rel=1e-12)
    assert (tail["Tail/Signed"], float(tail["Tail/Scaled"])) == ("-1", 7.5)
    errors = capsys.readouterr().err.splitlines()
    assert f"{log}: 1 frame left out: unknown identifier (7FF)" in errors
    assert f"{log}: 1 frame left out: wrong length" in errors


def test_a_frame_of_ours_with_a_wrong_checksum_is_left_out_and_counted(
    bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    lines = bench[0].read_text("ascii").splitlines()
    at = next(number for number, line in enumerate(lines) if " 110#" in line)
    lines[at] = f"{lines[at][:-3]}{int(lines[at][-3], 16) ^ 1:X} R"
    damaged = tmp_path / "damaged.log"
    damaged.write_text("\n".join(lines) + "\n", "ascii")
    assert export(damaged, "--to", "csv") == ExitCode.OK
    assert len(rows_of(tmp_path / "damaged.csv")) == len(lines) - 1
    assert capsys.readouterr().err == f"{damaged}: 1 frame left out: wrong CRC\n"


@pytest.mark.parametrize(
    ("wanted", "columns"),
    [
        ("positionc*,Position_m", ["STEM_POSITION/Position_m", "CURRENT_COMMAND/PositionCounter"]),
        ("Position*", ["STEM_POSITION/Position_m", "CURRENT_COMMAND/PositionCounter"]),
        ("STEM_POSITION/Position_m, plant_truth/true*", None),
        ("CURRENT_COMMAND", None),
    ],
)
def test_chosen_signals_alone_are_exported(
    wanted: str, columns: list[str] | None, bench: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "bus.csv"
    assert export(bench[0], "--out", out, "--signals", wanted) == ExitCode.OK
    rows = rows_of(out)
    assert columns is None or set(rows[0]) == {"time_s", *columns}
    assert all(len([text for text in row.values() if text]) > 1 for row in rows)
    identifiers = _ids({name.partition("/")[0] for name in rows[0]} - {"time_s"})
    assert len(rows) == sum(frame.arbitration_id in identifiers for frame in can.LogReader(bench[0]))


def _ids(kinds: set[str]) -> set[int]:
    dbc = database(packaged_dbc_text())
    return {dbc.get_message_by_name(kind).frame_id for kind in kinds}


def test_a_damaged_line_is_named_and_nothing_is_written(
    bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    lines = bench[0].read_text("ascii").splitlines(keepends=True)
    damaged = tmp_path / "damaged.log"
    damaged.write_text("".join(lines[:100]) + "\n(nonsense\n" + "".join(lines[100:]), "ascii")
    (tmp_path / "damaged.csv").write_text("mine", "utf-8")
    assert export(damaged, "--to", "csv") == ExitCode.IO
    error = capsys.readouterr().err
    assert error.startswith(f"positioner: {damaged}: line 102: the part after frame 100 cannot be read (ValueError")
    assert error.endswith("nothing was exported: --readable-part exports what is before it\n")
    assert error.count("\n") == 1
    assert (tmp_path / "damaged.csv").read_text("utf-8") == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["damaged.csv", "damaged.log"]

    assert export(damaged, "--to", "csv", "--readable-part") == ExitCode.OK
    assert len(rows_of(tmp_path / "damaged.csv")) == 100


def test_a_log_that_was_cut_off_is_exported_up_to_there(
    bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    cut = tmp_path / "cut.log"
    cut.write_bytes(bench[0].read_bytes()[:-5])
    assert export(cut, "--to", "csv") == ExitCode.OK
    assert len(rows_of(tmp_path / "cut.csv")) == read_log(bench[0]).count - 1
    assert "ends early: the line after frame" in capsys.readouterr().err


def test_a_failure_while_writing_leaves_what_was_there(
    bench: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "bus.csv"
    out.write_text("mine", "utf-8")

    def fail(*_: object) -> list[object]:
        raise KeyboardInterrupt

    monkeypatch.setattr("positioner.export.signals.Message.values", fail)
    assert export(bench[0], "--out", out) == INTERRUPTED
    assert [path.name for path in tmp_path.iterdir()] == ["bus.csv"]
    assert out.read_text("utf-8") == "mine"


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log.gz", ".csv"])
def test_every_format_of_the_log_gives_the_same_values(suffix: str, bench: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / f"other{suffix}"
    with can.Logger(other) as writer:
        for frame in can.LogReader(bench[0]):
            frame.timestamp += 1000.0
            frame.channel = 1
            writer(frame)
    outs = [tmp_path / "out.csv", tmp_path / "first.csv"]
    assert export(other, "--out", outs[0]) == ExitCode.OK
    assert export(bench[0], "--out", outs[1]) == ExitCode.OK
    found, expected = (rows_of(out) for out in outs)
    assert [{**row, "time_s": ""} for row in found] == [{**row, "time_s": ""} for row in expected]


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["{log}"], ExitCode.USAGE, "no format is given: give --to csv"),
        (["{log}", "--out", "bus.xlsx"], ExitCode.USAGE, "the name bus.xlsx says no format: give --to csv"),
        (["{log}", "--to", "csv", "--out", "{log}"], ExitCode.USAGE, "is the log itself: name another file with --out"),
        (["{log}", "--to", "csv", "--valve", "FV-1"], ExitCode.USAGE, "--valve needs --config"),
        (["{log}", "--to", "csv", "--signals", "Positon_m"], ExitCode.USAGE, "'Positon_m': no signal in the log has"),
        (["{log}", "--out", "absent/x.csv"], ExitCode.IO, "positioner: absent/x.csv: cannot be written: No such"),
        (["absent.log", "--to", "csv"], ExitCode.IO, "absent.log: cannot be read: No such file"),
        (["{config}", "--to", "csv"], ExitCode.IO, "cannot be read: nobody knows the format '.toml'"),
        (["{log}", "--to", "csv", "--config", "absent.toml"], ExitCode.CONFIG, "absent.toml: file: cannot be read"),
    ],
)
def test_a_mistake_is_one_line(
    words: list[str], code: ExitCode, text: str, bench: tuple[Path, Path], tmp_path: Path, capsys: Output,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    log, config = (shutil.copy(path, tmp_path / path.name) for path in bench)
    assert export(*(word.format(log=log, config=config) for word in words)) == code
    error = capsys.readouterr().err
    assert text in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("kind", ["csv", "parquet", "mf4"])
def test_planted_links_lead_an_export_to_no_other_file(kind: str, bench: tuple[Path, Path], tmp_path: Path) -> None:
    folder, secret = tmp_path / "shared", tmp_path / "victim"
    folder.mkdir()
    secret.write_text("precious", encoding="ascii")
    name = f"bus.{kind}"
    for link in (f".bus.part.{kind}", f".{name}.part", f"{name}.part", f"{name}.tmp", name, f"{name}-metadata.json"):
        (folder / link).symlink_to(secret)
    os.link(secret, folder / f".{name}-metadata.part.json")
    before = {path.name for path in folder.iterdir()}
    assert export(bench[0], "--out", folder / name) == ExitCode.OK
    assert secret.read_text(encoding="ascii") == "precious"
    assert (folder / name).is_file()
    assert not (folder / name).is_symlink(), "the link at the place itself is replaced"
    assert {path.name for path in folder.iterdir()} == before
    assert (folder / f".bus.part.{kind}").is_symlink()


def test_the_unfinished_file_lies_where_no_other_user_may_enter(tmp_path: Path) -> None:
    with whole_file(tmp_path / "bus.csv") as part:
        assert stat.S_IMODE(part.parent.stat().st_mode) == 0o700
        assert part.parent.parent == tmp_path
        part.write_text("whole", encoding="ascii")
        umask = os.umask(0o022)
        os.umask(umask)
    assert [path.name for path in tmp_path.iterdir()] == ["bus.csv"]
    assert stat.S_IMODE((tmp_path / "bus.csv").stat().st_mode) == 0o666 & ~umask


def test_a_log_without_a_known_message_says_what_is_in_it(user: tuple[Path, Path], capsys: Output) -> None:
    assert export(user[0], "--to", "csv") == ExitCode.IO
    error = capsys.readouterr().err
    assert "holds no message that [wire] or our DBC describes: 7 frames left out: unknown identifier (" in error


def test_json_lists_the_columns(user: tuple[Path, Path], capsys: Output) -> None:
    log, config = user
    assert export(log, "--config", config, "--to", "csv", "--signals", "Travel", "--json") == ExitCode.OK
    document = json.loads(capsys.readouterr().out)
    assert document["rows"] == 3
    assert document["left_out"] == {"unknown identifier": 1, "wrong length": 1}
    assert {"column": "Travel/Travel_m", "unit": "m", "comment": ""} in document["columns"]


@pytest.mark.parametrize(
    ("signal", "unit_in_dbc", "unit", "column"),
    [
        ("Position_mm", "mm", "m", "M/Position_m"),
        ("TrueVelocity_mm_per_s", "mm/s", "m/s", "M/TrueVelocity_m_per_s"),
        ("Level", "%", "%", "M/Level_percent"),
        ("Temperature", "°C", "°C", "M/Temperature_degC"),
        ("Speed", "1/min", "1/min", "M/Speed_1_per_min"),
        ("Counter", "", "", "M/Counter"),
        ("Flow", "m³/h", "m³/h", "M/Flow_m3_per_h"),
    ],
)
def test_a_column_has_the_unit_in_its_name(signal: str, unit_in_dbc: str, unit: str, column: str) -> None:
    assert column_name("M", signal, unit_in_dbc, unit) == column


def test_no_two_columns_have_one_name() -> None:
    text = USER_DBC.replace(
        'BO_ 514 Target: 2 PLC\n SG_ Target : 0|16@1- (-0.01,0) [-100|100] "mm" VALVE',
        'BO_ 514 Target: 4 PLC\n SG_ Target : 0|16@1- (1,0) [0|0] "mm" VALVE\n'
        ' SG_ Target_mm : 16|16@1- (1,0) [0|0] "mm" VALVE',
    )
    message = Messages(make_codec(), database(text).messages).by_id[514, False]
    assert [signal.column for signal in message.signals] == ["Target/Target_m", "Target/Target_m_2"]
