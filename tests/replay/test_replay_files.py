"""The files that replay reads: all formats, cut or damaged logs, other files; and tables, which it only reads."""

from __future__ import annotations

import gzip
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import can
import pytest
import replay_helpers as runs

from positioner.bench.inprocess import run_in_process
from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.replay.log import LogError, read_log
from positioner.store import access
from positioner.store.content import StoredTable
from positioner.valve.stiction import Direction, LearnedSample, Quantity, StictionTable

if TYPE_CHECKING:
    Output = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return runs.write_bench_log(tmp_path_factory.mktemp("bench"), runs.scenario("pi", seconds=0.15))


def replay(log: Path, config: Path, *more: str) -> int:
    return main(["replay", str(log), "--config", str(config), *more])


def converted(log: Path, path: Path, *, begin_s: float) -> Path:
    """Write the frames of `log` to `path`, in the format that its suffix names, starting at `begin_s`."""
    with can.Logger(path) as writer:
        for message in can.LogReader(log):
            message.timestamp += begin_s
            message.channel = 0
            writer.on_message_received(message)
    return path


DATED = (".asc", ".blf", ".csv", ".log", ".log.gz", ".asc.gz")


@pytest.mark.parametrize(
    ("suffix", "begin_s"),
    [*((suffix, begin_s) for suffix in DATED for begin_s in (0.0, 1.7e9 + 0.1234)), (".trc", 0.0)],
)
def test_every_format_that_python_can_writes_is_identical(
    suffix: str, begin_s: float, bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    log, config = bench
    assert replay(converted(log, tmp_path / f"bus{suffix}", begin_s=begin_s), config) == 0
    assert "CURRENT_COMMAND: 150 recorded, 150 computed, 150 equal to the bit\n" in capsys.readouterr().out


@pytest.mark.parametrize("end", [6, 30])
def test_a_log_that_ends_within_a_line_counts_up_to_there(
    end: int, bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    log, config = bench
    lines = log.read_bytes().splitlines(keepends=True)
    assert lines[300].split()[2].startswith(b"110#")
    cut = tmp_path / "cut.log"
    cut.write_bytes(b"".join(lines[:300]) + lines[300][:end])
    assert replay(cut, config) == 0
    output = capsys.readouterr().out.splitlines()
    assert output[0].startswith(f"{cut}: the log of a lockstep bench, 300 frames, 96 position frames")
    assert output[1].startswith(f"{cut}: cut at 0.096000 s: ")
    assert output[1].endswith("; the frames before it are replayed")
    assert output[2] == "CURRENT_COMMAND: 96 recorded, 96 computed, 96 equal to the bit"


def test_a_damaged_line_ends_the_log(bench: tuple[Path, Path], tmp_path: Path, capsys: Output) -> None:
    log, config = bench
    lines = log.read_bytes().splitlines(keepends=True)
    damaged = tmp_path / "damaged.log"
    damaged.write_bytes(b"".join(lines[:300]) + b"(nonsense\n" + b"".join(lines[301:]))
    assert replay(damaged, config) == 0
    output = capsys.readouterr().out
    assert f"{damaged}: cut at 0.096000 s: line 301: the part after frame 300 cannot be read (ValueError: " in output


@pytest.mark.parametrize("suffix", [".blf", ".log.gz"])
def test_a_binary_log_that_is_cut_counts_up_to_there(suffix: str, tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario("pi", seconds=3.0))
    complete = converted(log, tmp_path / f"bus{suffix}", begin_s=0.0)
    data = complete.read_bytes()
    complete.write_bytes(data[: len(data) * 3 // 4])
    assert replay(complete, config) == 0
    output = capsys.readouterr().out.splitlines()
    assert ": cut at " in output[1]
    assert "the frames before it are replayed" in output[1]
    recorded = int(output[2].split()[1])
    assert 300 < recorded < 2900


@pytest.mark.parametrize("size", [0, 15])
def test_an_object_of_a_binary_log_that_is_smaller_than_its_header_ends_the_log(size: int, tmp_path: Path) -> None:
    complete, damaged = tmp_path / "whole.blf", tmp_path / "damaged.blf"
    with can.BLFWriter(complete, compression_level=0) as writer:
        for number in range(20):
            writer(can.Message(timestamp=1.0 + number, arbitration_id=0x110, data=bytes(8)))
    data = bytearray(complete.read_bytes())
    at = [found.start() for found in re.finditer(b"LOBJ", data)][11]  # the first is the container
    data[at + 8 : at + 12] = size.to_bytes(4, "little")
    damaged.write_bytes(data)
    assert [read_log(path).count for path in (complete, damaged)] == [20, 10]
    assert read_log(damaged).cut == f"the part after frame 10 cannot be read (ValueError: an object of {size} bytes)"


def test_a_file_that_is_no_log_is_one_line(bench: tuple[Path, Path], tmp_path: Path, capsys: Output) -> None:
    log, config = bench
    files = {
        "picture.png": (b"\x89PNG\r\n", "cannot be read: nobody knows the format '.png'; known formats: "),
        "empty.log": (b"", "holds no frame"),
        "words.log": (b"these are\nno frames\n", "holds no frame: line 1: the part after frame 0 cannot be read"),
        "bytes.log": (bytes(range(128, 256)), "holds no frame"),
        "words.asc": (b"these are\nno frames\n", "holds no frame"),
        "words.blf": (b"these are\nno frames\n", "cannot be read: it is not a BLF file"),
        "words.db": (b"these are\nno frames\n", "cannot be read: it is not an SQLite database"),
        "words.log.gz": (
            b"these are\nno frames\n",
            "holds no frame: line 1: the part after frame 0 cannot be read (BadGzip",
        ),
        "header.csv": (b"timestamp,arbitration_id,extended,remote,error,dlc,data\n", "holds no frame"),
        "other.log": (b"(0.0) can0 123#00 R\n", "holds 1 frames, and no position frame among them"),
    }
    for name, (content, expected) in files.items():
        path = tmp_path / name
        path.write_bytes(content)
        assert replay(path, config) == 74, name
        output = capsys.readouterr().err
        assert output.count("\n") == 1, output
        assert f"{path}: {expected}" in output, output
    assert replay(tmp_path / "absent.log", config) == 74
    assert (
        capsys.readouterr().err == f"positioner: {tmp_path / 'absent.log'}: cannot be read: No such file or directory\n"
    )
    assert replay(tmp_path, config) == 74
    assert "Is a directory" in capsys.readouterr().err
    assert log.exists()


def test_a_log_without_commands_has_nothing_to_compare(
    bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    log, config = bench
    silent = tmp_path / "silent.log"
    lines = log.read_text(encoding="ascii").splitlines(keepends=True)
    silent.write_text("".join(line for line in lines if " 100#" not in line and " 140#" not in line), encoding="ascii")
    assert replay(silent, config) == 74
    assert "no command to compare with" in capsys.readouterr().err
    assert replay(silent, config, "--law", "paper") == 0
    assert "commands: 0 in both, 0 recorded only, 150 computed only" in capsys.readouterr().out


def test_a_wrong_configuration_ends_with_78(bench: tuple[Path, Path], tmp_path: Path, capsys: Output) -> None:
    log, config = bench
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(config.read_text(encoding="utf-8").replace("law = ", "lew = "), encoding="utf-8")
    assert replay(log, wrong) == 78
    assert "control.lew: unknown key; did you mean 'law'?" in capsys.readouterr().err
    assert replay(log, tmp_path / "absent.toml") == 78
    for change, expected in (
        ("guard.auto_arm", "--set: guard.auto_arm: is no KEY=VALUE; write it like control.table_from_s=2"),
        ("guard.current_low_ma=2", "with --set: guard.current_low_ma = 2"),
        ("guard.courage=2", "with --set: guard.courage: unknown key"),
    ):
        capsys.readouterr()
        assert replay(log, config, "--set", change) == 78
        assert expected in capsys.readouterr().err


def taught(valve_id: str = "bench", cell_width_m: float = 0.005) -> StoredTable:
    """Return a table with landings in it."""
    stored = StoredTable(valve_id, StictionTable(cell_width_m=cell_width_m))
    for sample in range(40):
        where_m, value = 0.070 + 0.005 * (sample % 4), 2e-3 + 1e-5 * sample
        learned = LearnedSample(Quantity.LANDING_BIAS, where_m, Direction.OPENING, value)
        stored = stored.learned(learned, 1_700_000_000)
    return stored


def test_a_run_that_began_with_a_table_is_identical_from_that_table_only(tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario(seconds=0.6), taught().table)
    state = tmp_path / "state"
    state.mkdir()
    access.replace(state, taught(), force=True)
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in state.rglob("*") if path.is_file()}
    assert before
    assert replay(log, config) == 1
    assert replay(log, config, "--state", str(state)) == 0
    assert {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in state.rglob("*") if path.is_file()} == before
    assert "identical" in capsys.readouterr().out


def test_a_table_that_does_not_fit_is_refused(bench: tuple[Path, Path], tmp_path: Path, capsys: Output) -> None:
    log, config = bench
    assert replay(log, config, "--state", str(tmp_path / "absent")) == 74
    state = tmp_path / "state"
    state.mkdir()
    assert replay(log, config, "--state", str(state)) == 74
    for stored, expected in (
        (taught("FV-7"), "the table belongs to 'FV-7'"),
        (taught(cell_width_m=0.01), "the table has cells of 0.01 m, the configuration 0.005 m"),
    ):
        state = tmp_path / expected[-4:].strip("'")
        state.mkdir()
        access.replace(state, stored, force=True)
        capsys.readouterr()
        assert replay(log, config, "--state", str(state)) == 74
        assert expected in capsys.readouterr().err


def test_frames_keep_their_order_and_their_time(bench: tuple[Path, Path]) -> None:
    log, _ = bench
    read = read_log(log)
    expected = run_in_process(runs.scenario("pi", seconds=0.15)).recording.frames
    assert [frame.number for frame in read.frames()] == list(range(1, len(expected) + 1))
    assert [frame.frame.data for frame in read.frames()] == [frame.data for _, _, frame in expected]
    assert [frame.time_ns for frame in read.frames()] == [round(stamp_s * 1e9) for stamp_s, _, _ in expected]
    assert not read.cut


def test_an_unreadable_log_names_its_formats(tmp_path: Path) -> None:
    shutil.copyfile(Path(__file__), tmp_path / "bus.txt")
    with pytest.raises(LogError, match=r"known formats: \.asc, \.blf, \.csv, \.db, \.log, \.trc$"):
        read_log(tmp_path / "bus.txt")
    shutil.copyfile(Path(__file__), tmp_path / "bus.MF4")
    with pytest.raises(LogError, match=r"bus\.MF4: cannot be read: convert it to \.blf or \.asc; known"):
        read_log(tmp_path / "bus.MF4")
    (tmp_path / "cut.log.gz").write_bytes(gzip.compress(b"(0.0) can0 123#00 R\n" * 9999)[:-9])
    assert "cannot be read (EOFError" in read_log(tmp_path / "cut.log.gz").cut


@pytest.mark.parametrize("sample", [1, 40, 149])
@pytest.mark.parametrize("snap", [True, False])
def test_a_log_that_starts_late_is_refused_and_not_called_different(
    sample: int, snap: bool, bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    log, config = bench
    lines = log.read_text(encoding="ascii").splitlines(keepends=True)
    late = [line for line in lines if float(line[1 : line.index(")")]) >= sample * 1e-3 - 1e-9]
    # without the plant's time it is a log that another node wrote
    path = tmp_path / "late.log"
    path.write_text("".join(late), encoding="ascii")
    if not snap:
        apart = ((float(line[1 : line.index(")")]) + 1e-4 * (n % 3), line.split(")")[1]) for n, line in enumerate(late))
        path.write_text("".join(f"({stamp_s:.6f}){rest}" for stamp_s, rest in apart), encoding="ascii")
    assert replay(path, config) == ExitCode.IO
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.startswith(f"positioner: {path}: starts late: frame ")
    assert f"has the counter {sample}, and a positioner begins with 0" in line
    # with --law the replay still shows the commands of another law
    assert replay(path, config, "--law", "pi-deadband") == ExitCode.OK
    assert "starts late" in capsys.readouterr().out


def test_a_command_before_any_reading_is_a_late_start_though_its_counter_is_0(
    bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    log, config = bench
    lines = [line for line in log.read_text(encoding="ascii").splitlines(keepends=True) if " 170#" not in line]
    first = next(index for index, line in enumerate(lines) if " 110#" in line)
    path = tmp_path / "late.log"
    path.write_text("".join(lines[:first] + lines[first + 1 :]), encoding="ascii")
    assert replay(path, config) == ExitCode.IO
    assert "comes before the first position frame" in capsys.readouterr().err


@pytest.mark.parametrize("stamp", ["nan", "inf", "-inf", "1e300", "-1e300"])
def test_a_log_is_read_up_to_a_time_stamp_that_is_no_time(stamp: str, tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text(f"(1.0) vcan0 110#00 R\n(1.5) vcan0 110#00 R\n({stamp}) vcan0 110#00 R\n(2.0) vcan0 110#00 R\n")
    log = read_log(path)
    assert [frame.time_ns for frame in log.frames()] == [0, 500_000_000]
    assert log.cut.startswith("line 3: the part after frame 2 cannot be read (ValueError: ")
    assert log.cut.endswith(" s is no time stamp)")
