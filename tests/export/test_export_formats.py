"""Parquet and MDF 4: what pandas, pyarrow and asammdf read is what the CSV holds, to the bit."""

from __future__ import annotations

import math
import struct
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import asammdf
import numpy as np
import pandas as pd
import pytest
import replay_helpers as runs
from pyarrow import parquet

from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.export import chunks as chunk_sizes

if TYPE_CHECKING:
    Output = pytest.CaptureFixture[str]

AXES = ("time_axis", "prevTimestamp")
"""What the loaders of PlotJuggler for CSV and for Parquet call the column with the time."""
DBC = """VERSION ""
NS_ :
BS_:
BU_: PLC VALVE
BO_ 512 Wide: 8 PLC
 SG_ All : 0|64@1+ (1,0) [0|0] "" VALVE
BO_ 513 Signed: 8 PLC
 SG_ All : 0|64@1- (1,0) [0|0] "" VALVE
BO_ 514 Real: 8 PLC
 SG_ Flow : 7|64@0- (1,0) [0|0] "m³/h" VALVE
BO_ 515 Pages: 8 PLC
 SG_ Page M : 0|8@1+ (1,0) [0|3] "" VALVE
 SG_ Supply m0 : 8|16@1+ (0.01,0) [0|100] "bar" VALVE
 SG_ Ramp m1 : 8|16@1- (0.5,-1) [-100|100] "mm" VALVE
CM_ BO_ 515 "Two pages";
CM_ SG_ 515 Supply "Supply of the actuator, 'dry'";
SIG_VALTYPE_ 514 Flow : 1;
"""
WIRE = '[valve]\nid = "FV-101"\npreset = "paper"\n[wire]\ndbc = "odd.dbc"\n'


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return runs.write_bench_log(tmp_path_factory.mktemp("bench"), runs.scenario("pi", seconds=0.3))[0]


@pytest.fixture
def odd(tmp_path: Path) -> list[str]:
    """A log with 64-bit integers, a big-endian double and multiplexed signals, and its configuration."""
    (tmp_path / "odd.dbc").write_text(DBC, encoding="cp1252")
    (tmp_path / "odd.toml").write_text(WIRE, encoding="utf-8")
    frames = [
        (512, (2**64 - 1).to_bytes(8, "little")),
        (513, (2**64 - 2).to_bytes(8, "little")),
        (514, struct.pack(">d", math.nextafter(0.1, 1.0))),
        (515, bytes([0, 100, 0]) + bytes(5)),
        (515, bytes([1, 0xFF, 0xFF]) + bytes(5)),
        (515, bytes([2]) + bytes(7)),
        (514, struct.pack(">d", math.nan)),
        (512, (2**53 + 1).to_bytes(8, "little")),
    ]
    lines = [f"({1700000000 + 0.001 * n:.6f}) can0 {i:03X}#{data.hex()}\n" for n, (i, data) in enumerate(frames)]
    (tmp_path / "odd.log").write_text("".join(lines), "ascii")
    return [str(tmp_path / "odd.log"), "--config", str(tmp_path / "odd.toml")]


def export(*words: object) -> int:
    return main(["export", *map(str, words)])


def csv_columns(path: Path) -> dict[str, dict[float, str]]:
    """Return the cells of each column by row."""
    header, *lines = path.read_text("utf-8").splitlines()
    rows = [line.split(",") for line in lines]
    return {
        name: {row: cells[index] for row, cells in enumerate(rows) if cells[index]}
        for index, name in enumerate(header.split(","))
    }


def test_pandas_reads_from_csv_and_parquet_the_same_bits(bench: Path, tmp_path: Path) -> None:
    csv, parquet_file = tmp_path / "bus.csv", tmp_path / "bus.parquet"
    assert [export(bench, "--out", out) for out in (csv, parquet_file)] == [ExitCode.OK, ExitCode.OK]
    expected = csv_columns(csv)
    frames = [pd.read_csv(csv), pd.read_parquet(parquet_file)]
    for frame in frames:
        assert list(frame.columns) == list(expected)
        for name, cells in expected.items():
            known = frame[name].dropna()
            assert list(known.index) == list(cells)
            assert known.astype(np.float64).tolist() == [float(text) for text in cells.values()]
    assert sum(map(len, expected.values())) > 4000


def test_parquet_keeps_integers_nan_and_null_apart(odd: list[str], tmp_path: Path) -> None:
    assert export(*odd, "--to", "parquet") == ExitCode.OK
    table = parquet.read_table(tmp_path / "odd.parquet")
    found = {name: [value for value in table[name].to_pylist() if value is not None] for name in table.column_names}
    assert found["Wide/All"] == [2**64 - 1, 2**53 + 1]
    assert found["Signed/All"] == [-2]
    assert found["Real/Flow_m3_per_h"][0] == math.nextafter(0.1, 1.0)
    assert math.isnan(found["Real/Flow_m3_per_h"][1])
    assert found["Pages/Page"] == [0, 1, 2]
    assert found["Pages/Supply_Pa"] == [pytest.approx(1e5)]
    assert found["Pages/Ramp_m"] == [pytest.approx(-1.5e-3)]
    assert table["time_s"].to_pylist() == [round(1700000000 + 0.001 * number, 6) for number in range(8)]


def test_parquet_has_unit_comment_and_source_of_each_column(odd: list[str], tmp_path: Path) -> None:
    assert export(*odd, "--to", "parquet") == ExitCode.OK
    about = parquet.read_schema(tmp_path / "odd.parquet").field("Pages/Supply_Pa").metadata
    expected = {"unit": "Pa", "comment": "Supply of the actuator, 'dry'", "message": "Pages", "signal": "Supply"}
    assert {key: about[key.encode()].decode() for key in expected} == expected


def test_parquet_and_mdf_are_written_in_parts_that_join(
    bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = [tmp_path / "whole.parquet", tmp_path / "whole.mf4"]
    parts = [tmp_path / "parts.parquet", tmp_path / "parts.mf4"]
    assert all(export(bench, "--out", out) == ExitCode.OK for out in whole)
    monkeypatch.setattr(chunk_sizes, "_MOST_ROWS", 100)
    assert all(export(bench, "--out", out) == ExitCode.OK for out in parts)
    assert parquet.ParquetFile(parts[0]).num_row_groups > 5
    assert parquet.read_table(parts[0]).equals(parquet.read_table(whole[0]))
    with asammdf.MDF(whole[1]) as first, asammdf.MDF(parts[1]) as second:
        for name in ("STEM_POSITION/Position_m", "CURRENT_COMMAND/Mode", "POSITIONER_STATUS/Cause"):
            one, other = first.get(name), second.get(name)
            assert one.samples.tolist() == other.samples.tolist()
            assert one.timestamps.tolist() == other.timestamps.tolist()


def test_asammdf_reads_every_channel_to_the_bit_with_unit_and_comment(bench: Path, tmp_path: Path) -> None:
    csv, mf4 = tmp_path / "bus.csv", tmp_path / "bus.mf4"
    assert [export(bench, "--out", out) for out in (csv, mf4)] == [ExitCode.OK, ExitCode.OK]
    expected = csv_columns(csv)
    times = [float(text) for text in expected["time_s"].values()]
    with asammdf.MDF(mf4) as mdf:
        names = [group.channel_group.acq_name for group in mdf.groups]
        assert sorted(names) == sorted({name.partition("/")[0] for name in expected} - {"time_s"})
        for name, cells in expected.items():
            if name == "time_s":
                continue
            channel: Any = mdf.get(name)
            assert channel.samples.astype(np.float64).tolist() == [float(text) for text in cells.values()]
            assert channel.timestamps.tolist() == [times[int(row)] for row in cells]
        position: Any = mdf.get("STEM_POSITION/Position_m")
        assert (position.unit, position.comment) == ("m", "Measured stem position.")
        assert position.samples.dtype == np.float64
        assert mdf.get("CURRENT_COMMAND/Counter").samples.dtype.kind in "iu"


def test_asammdf_reads_odd_signals_and_the_start_of_the_log(odd: list[str], tmp_path: Path) -> None:
    assert export(*odd, "--to", "mf4") == ExitCode.OK
    with asammdf.MDF(tmp_path / "odd.mf4") as mdf:
        assert mdf.header.start_time.timestamp() == 1700000000.0
        assert mdf.get("Wide/All").samples.tolist() == [2**64 - 1, 2**53 + 1]
        assert mdf.get("Wide/All").timestamps.tolist() == [0.0, 0.007]
        assert mdf.get("Signed/All").samples.tolist() == [-2]
        flow = mdf.get("Real/Flow_m3_per_h")
        assert (flow.samples[0], flow.unit) == (math.nextafter(0.1, 1.0), "m³/h")
        assert math.isnan(flow.samples[1])
        supply, ramp = mdf.get("Pages/Supply_Pa"), mdf.get("Pages/Ramp_m")
        assert supply.samples.tolist() == [pytest.approx(1e5)]
        assert (ramp.samples.tolist(), ramp.timestamps.tolist()) == ([pytest.approx(-1.5e-3)], [0.004])
        assert supply.comment == "Supply of the actuator, 'dry'"
        pages = next(group for group in mdf.groups if group.channel_group.acq_name == "Pages")
        assert "Two pages" in pages.channel_group.comment


@pytest.mark.parametrize(("kind", "module"), [("parquet", "pyarrow"), ("mf4", "asammdf")])
def test_without_its_library_a_format_says_what_brings_it(
    kind: str, module: str, bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert export(bench, "--to", kind, "--out", tmp_path / f"bus.{kind}") == ExitCode.USAGE
    error = capsys.readouterr().err
    assert error == f"positioner: {module} is not installed: pip install 'sticking-valve-positioner[export]'\n"
    assert not list(tmp_path.iterdir())


def test_the_command_loads_no_library_that_it_does_not_need(bench: Path, tmp_path: Path) -> None:
    code = "import sys; from positioner.cli.main import main; main(sys.argv[1:]); print(*sys.modules)"
    words = [sys.executable, "-c", code, "export", str(bench), "--out", str(tmp_path / "bus.csv")]
    loaded = subprocess.run(words, check=True, capture_output=True, text=True, timeout=300.0).stdout.split()
    assert not {"pyarrow", "asammdf", "pandas", "matplotlib", "osqp"} & set(loaded)


def test_every_curve_of_the_plotjuggler_layout_is_a_column(bench: Path, tmp_path: Path) -> None:
    layout = ET.parse(Path(__file__).parents[2] / "examples" / "plotjuggler.xml").getroot()  # noqa: S314 - our own file
    curves = {curve.attrib["name"] for curve in layout.iter("curve")}
    assert export(bench, "--out", tmp_path / "bus.parquet") == ExitCode.OK
    columns = set(parquet.read_schema(tmp_path / "bus.parquet").names)
    assert len(curves) == 9
    assert curves <= columns
    axes = {value for each in layout.iter("default") for key, value in each.attrib.items() if key in AXES}
    assert axes == {"time_s"} <= columns
