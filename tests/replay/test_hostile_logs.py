"""Logs from an attacker: what reads them touches no other file, never waits, and takes bounded memory."""

from __future__ import annotations

import gzip
import json
import os
import socket
import sqlite3
import struct
import subprocess
import sys
import zlib
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import can
import pytest
import replay_helpers as runs

from positioner.cli.main import main
from positioner.errors import PositionerError
from positioner.replay import log as log_module
from positioner.replay.log import LogError, read_log

if TYPE_CHECKING:
    from collections.abc import Callable

    Output = pytest.CaptureFixture[str]

MIB = 2**20
BOMB_MIB = 400
SPARE_MIB = 24
"""What the interpreter itself takes meanwhile: modules that are loaded late, and pages that an allocator keeps."""
TABLE = (
    "CREATE TABLE messages (ts REAL, arbitration_id INTEGER, extended INTEGER, remote INTEGER, error INTEGER, "
    "dlc INTEGER, data BLOB)"
)
ROW = (0.5, 0x110, 0, 0, 0, 8, bytes(8))


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return runs.write_bench_log(tmp_path_factory.mktemp("bench"), runs.scenario("pi", seconds=0.05))


def database(path: Path, *statements: str, rows: tuple[tuple[object, ...], ...] = (ROW,), table: str = TABLE) -> Path:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute(table)
        for row in rows:
            connection.execute("INSERT INTO messages VALUES (?, ?, ?, ?, ?, ?, ?)", row)
        for statement in statements:
            connection.execute(statement)
        connection.commit()
    return path


def commands(log: Path, config: Path, folder: Path) -> list[list[str]]:
    """Return every command that reads a log, as its user gives it."""
    given = ["--config", str(config)]
    return [
        ["export", str(log), "--out", str(folder / "out.csv")],
        ["diagnose", str(log), *given],
        ["replay", str(log), *given],
        ["explain", str(log), *given],
        ["monitor", str(log), *given, "--picture", str(folder / "out.svg")],
        ["health", *given, "--from", str(log), "--state", str(folder)],
        ["report", *given, "--from", str(log), "--state", str(folder)],
        ["identify", *given, "--from", str(log)],
        ["step-test", *given, "--from", str(log)],
        ["stroke-test", *given, "--from", str(log)],
        ["signature", *given, "--from", str(log)],
    ]


def journal_that_names(victim: Path, page: bytes) -> bytes:
    """Return a hot journal with one page, which ends with the name of a super-journal (SQLite file format, 3)."""
    head = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7" + struct.pack(">LLLLL", 1, 7, 1, 512, 4096)
    name = os.fsencode(victim)
    added = sum(page[at] for at in range(4096 - 200, 0, -200))
    record = struct.pack(">L", 1) + page + struct.pack(">L", (7 + added) & 0xFFFFFFFF)
    end = struct.pack(">L", 0x40000000 // 4096 + 1) + name + struct.pack(">LL", len(name), sum(name)) + head[:8]
    return head.ljust(512, b"\0") + record + end


def test_a_planted_journal_deletes_no_file_and_changes_no_log(
    bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    _, config = bench
    victim, folder = tmp_path / "victim", tmp_path / "logs"
    folder.mkdir()
    log = database(folder / "bus.db")
    before = log.read_bytes()
    planted = journal_that_names(victim, b"planted page".ljust(4096, b"x"))

    def plant() -> None:
        victim.write_text("precious", encoding="ascii")
        log.write_bytes(before)
        (folder / "bus.db-journal").write_bytes(planted)

    plant()
    with closing(sqlite3.connect(log)) as connection, pytest.raises(sqlite3.Error):
        connection.execute("SELECT * FROM messages").fetchall()
    assert (victim.exists(), log.read_bytes() == before) == (False, False), "the attack works where SQLite may write"
    for command in commands(log, config, tmp_path):
        plant()
        capsys.readouterr()
        main(command)
        found = capsys.readouterr()
        assert victim.exists(), command
        assert log.read_bytes() == before, command
        assert (folder / "bus.db-journal").read_bytes() == planted, command
        assert sorted(path.name for path in folder.iterdir()) == ["bus.db", "bus.db-journal"], command
        assert "Traceback" not in found.err, command
    assert read_log(log).count == 1
    assert read_log(log).cut == "bus.db-journal beside it is ignored: the newest frames may be missing"


ENDLESS = """CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)
SELECT i, 272, 0, 0, 0, 8, zeroblob(8) FROM n"""
HOSTILE = {
    "recursive view": (ENDLESS,),
    "zeroblob view": ("CREATE VIEW messages AS SELECT 0.5, 272, 0, 0, 0, 8, zeroblob(1000000000)",),
    "second view": (TABLE, "CREATE VIEW more AS SELECT * FROM messages"),
    "generated column": (TABLE.replace("data BLOB)", "data BLOB AS (zeroblob(1000000000)))"),),
    "trigger": (TABLE, "CREATE TRIGGER t AFTER INSERT ON messages BEGIN SELECT 1; END"),
    "virtual table": ("CREATE VIRTUAL TABLE messages USING fts5(ts)",),
    "other columns": ("CREATE TABLE messages (ts REAL, data BLOB)",),
    "other table": (TABLE.replace("messages", "frames"),),
    "nothing": ("CREATE TABLE a (b)", "DROP TABLE a"),
    "index": (TABLE, "CREATE INDEX i ON messages (abs(zeroblob(1000000000)))"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_database_with_anything_but_the_one_table_is_refused_with_one_line(
    name: str, tmp_path: Path, capsys: Output
) -> None:
    path = tmp_path / "bus.db"
    with closing(sqlite3.connect(path)) as connection:
        for statement in HOSTILE[name]:
            connection.execute(statement)
        connection.commit()
    assert main(["export", str(path), "--to", "csv"]) == 74
    (line,) = capsys.readouterr().err.splitlines()
    assert "cannot be read: it holds other things than the one table of frames that python-can writes" in line


@pytest.mark.parametrize(
    ("row", "why"),
    [
        ((0.5, 272, 0, 0, 0, 8, bytes(65)), "a frame of 65 bytes"),
        ((0.5, 272, 0, 0, 0, 8, bytes(1 << 20)), "string or blob too big"),
        ((0.5, 272, 0, 0, 0, 8, 4_000_000_000), "a row that is no frame"),
        ((0.5, 1 << 40, 0, 0, 0, 8, bytes(8)), "is no identifier"),
        ((0.5, -1, 0, 0, 0, 8, bytes(8)), "is no identifier"),
        (("x", 272, 0, 0, 0, 8, bytes(8)), "a row that is no frame"),
    ],
)
def test_a_row_that_is_no_frame_ends_the_log_of_a_database(row: tuple[object, ...], why: str, tmp_path: Path) -> None:
    log = read_log(database(tmp_path / "bus.db", rows=(ROW, ROW, row, ROW)))
    assert log.is_damaged
    assert log.count in {1, 2}, "sqlite3 of Python is a row ahead"
    assert why in log.cut


def test_rows_that_come_again_and_again_end_the_log_of_a_database(tmp_path: Path) -> None:
    path = database(tmp_path / "bus.db", rows=(ROW,) * 4000)
    data = bytearray(path.read_bytes())
    root = int.from_bytes(data[28:32], "big") and 4096  # page 2 is the root of the one table
    cells = int.from_bytes(data[root + 3 : root + 5], "big")
    assert (data[root], cells > 2) == (5, True)
    first = root + int.from_bytes(data[root + 12 : root + 14], "big")
    for number in range(cells):  # every branch leads to the first leaf
        at = root + int.from_bytes(data[root + 12 + 2 * number : root + 14 + 2 * number], "big")
        data[at : at + 4] = data[first : first + 4]
    path.write_bytes(data)
    log = read_log(path)
    assert 10 < log.count < 4000
    assert "the rows are not in order" in log.cut


def test_what_python_can_writes_is_read_from_a_database(bench: tuple[Path, Path], tmp_path: Path) -> None:
    path = tmp_path / "a log # 100%.db"
    with can.Logger(path) as writer:
        for message in can.LogReader(bench[0]):
            writer.on_message_received(message)
    read, expected = list(read_log(path).frames()), list(read_log(bench[0]).frames())
    assert [frame.frame for frame in read] == [frame.frame for frame in expected]
    assert main(["replay", str(path), "--config", str(bench[1])]) == 0


def container(data: bytes, *, is_packed: bool = False) -> bytes:
    """Return an object of BLF that holds `data`."""
    packed = data if is_packed else zlib.compress(data)
    size = 32 + len(packed)
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, size, 10) + struct.pack("<H6xL4x", 2, 0)
    return head + packed + bytes(size % 4)


def blf(path: Path, *objects: bytes) -> Path:
    path.write_bytes(struct.pack("<4sL", b"LOGG", 144).ljust(144, b"\0") + b"".join(objects))
    return path


def frame_object(kind: int = 1) -> bytes:
    return struct.pack("<4sHHLL", b"LOBJ", 32, 1, 48, kind) + struct.pack("<LHHQHBBL8s", 2, 0, 0, 9, 1, 0, 8, 272, b"")


def zeros_packed(count: int, wbits: int, begin: bytes = b"") -> bytes:
    """Return so many MiB of zeros behind `begin`, deflated; 31 is gzip, 15 what BLF has."""
    packer, mib = zlib.compressobj(6, zlib.DEFLATED, wbits), bytes(MIB)
    return b"".join([packer.compress(begin), *(packer.compress(mib) for _ in range(count)), packer.flush()])


def gzip_bomb(path: Path) -> Path:
    path.write_bytes(zeros_packed(BOMB_MIB, 31))
    return path


def blf_bomb(path: Path) -> Path:
    return blf(path, container(zeros_packed(BOMB_MIB, 15), is_packed=True))


def header_bomb(path: Path) -> Path:
    path.write_bytes(zeros_packed(BOMB_MIB, 31, struct.pack("<4sL", b"LOGG", 0xFFFFFFF0).ljust(144, b"\0")))
    return path


def frames_bomb(path: Path, log: Path) -> Path:
    """Write a command and very many readings of a valve into some KiB."""
    lines = log.read_bytes().splitlines(keepends=True)
    command, reading = ([line for line in lines if name in line][-1] for name in (b" 100#", b" 110#"))
    path.write_bytes(gzip.compress(command + reading * 500_000))
    return path


def small_blf_bombs(path: Path) -> Path:
    """Write containers whose unpacked objects are none of a bus: nothing but time and memory."""
    return blf(path, *[container(frame_object(77) * 80_000)] * 30)


def long_tail(path: Path) -> Path:
    """Write an object that goes on and on, from container to container."""
    begin = struct.pack("<4sHHLL", b"LOBJ", 32, 1, 4 * MIB, 77)
    return blf(path, container(begin + bytes(4 * MIB - 64)), *[container(b"x")] * 50_000)


BOMBS: dict[str, tuple[str, Callable[[Path], Path], str]] = {
    "gzip": ("bus.log.gz", gzip_bomb, "longer than 64 KiB"),
    "gzip of ASC": ("bus.asc.gz", gzip_bomb, "longer than 64 KiB"),
    "gzip of TRC": ("bus.trc.gz", gzip_bomb, "longer than 64 KiB"),
    "gzip of CSV": ("bus.csv.gz", gzip_bomb, "longer than 64 KiB"),
    "BLF": ("bus.blf", blf_bomb, "an object of "),
    "BLF in gzip": ("bus.blf.gz", header_bomb, "a header of 4294967280 bytes"),
    "objects of BLF": ("bus.blf", small_blf_bombs, "no frame in 64 MiB"),
    "tail of BLF": ("bus.blf", long_tail, "no frame in 64 MiB"),
    "MDF 4": ("bus.mf4", gzip_bomb, "convert it to .blf or .asc"),
}


def peak_of(words: list[str], folder: Path) -> tuple[float, subprocess.CompletedProcess[str]]:
    """Return the most memory that a command takes in MiB, in a process of its own, and how it ended."""
    code = (
        "import pathlib, sys; from positioner.cli.main import main; status = main(sys.argv[1:]);"
        "print('\\npeak', pathlib.Path('/proc/self/status').read_text().partition('VmHWM:')[2].split()[0]);"
        "sys.exit(status)"
    )
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300.0)
    return int(done.stdout.rpartition("peak ")[2]) / 1024, done


@pytest.fixture(scope="module")
def start_mib(bench: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> float:
    """Return what a command on a short log takes."""
    folder = tmp_path_factory.mktemp("start")
    return peak_of(["diagnose", str(bench[0]), "--config", str(bench[1])], folder)[0]


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_within_bounded_memory(
    name: str, bench: tuple[Path, Path], start_mib: float, tmp_path: Path
) -> None:
    file, make, expected = BOMBS[name]
    log = make(tmp_path / file)
    peak_mib, done = peak_of(["diagnose", str(log), "--config", str(bench[1])], tmp_path)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 74
    assert expected in line
    assert peak_mib < start_mib + 64.0, "no bomb needs the allowed memory"


def test_very_many_frames_in_some_bytes_take_the_allowed_memory_and_no_more(
    bench: tuple[Path, Path], start_mib: float, tmp_path: Path
) -> None:
    log, config = frames_bomb(tmp_path / "bus.log.gz", bench[0]), str(bench[1])
    assert log.stat().st_size < MIB
    given = [str(log), "--config", config, "--max-size", "8"]
    for words in (["diagnose", *given], ["monitor", *given, "--picture", "x.svg"]):
        peak_mib, done = peak_of(words, tmp_path)
        (line,) = done.stderr.splitlines()
        assert done.returncode == 74
        assert "more than 8 MiB" in line
        assert "--max-size" in line
        assert peak_mib < start_mib + 8.0 + SPARE_MIB
    code = "import sys; from positioner import load_log; load_log(sys.argv[1], max_size_mib=8)"
    done = subprocess.run([sys.executable, "-c", code, str(log)], capture_output=True, text=True, check=False)
    assert "LogError" in done.stderr.splitlines()[-1]
    assert "more than 8 MiB of memory" in done.stderr.splitlines()[-1]


def test_the_default_is_256_mib_and_an_option_allows_more(
    bench: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    log = tmp_path / "bus.log"
    log.write_bytes(bench[0].read_bytes() * 60)
    looks = iter(range(0, 10**6, 200))  # MiB, at each look: 200 more
    monkeypatch.setattr(log_module, "_memory_mib", lambda: float(next(looks)))
    words = ["export", str(log), "--to", "csv", "--config", str(bench[1])]
    assert main(words) == 74
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{log}: its first 8191 frames take more than 256 MiB of memory: give a part of it, or allow" in line
    assert "--max-size, such as 1024" in line
    assert main([*words, "--max-size", "1024"]) == 0
    for wrong in ("0", "-1", "1e3", "much", "9" * 20):
        with pytest.raises(SystemExit):
            main([*words, f"--max-size={wrong}"])
        assert "is no number of MiB, such as 1024" in capsys.readouterr().err


def test_a_table_of_a_loop_that_would_take_too_much_memory_is_refused(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "loop.csv"
    path.write_text("OP,PV\n" + "50,50\n" * 10_000, encoding="ascii")
    assert main(["diagnose", str(path), "--max-size", "1"]) == 74
    (line,) = capsys.readouterr().err.splitlines()
    assert "loop.csv: is larger than 0.0 MiB, and would take more than 1 MiB of memory: give a part of it" in line
    assert main(["diagnose", str(path)]) == 0


def fifo(path: Path) -> Path:
    os.mkfifo(path)
    return path


def listening(path: Path) -> Path:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
    return path


def zeros(path: Path) -> Path:
    path.symlink_to("/dev/zero")
    return path


def folder_of_that_name(path: Path) -> Path:
    path.mkdir()
    return path


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (fifo, "is a FIFO, and only a regular file is read"),
        (zeros, "is a device, and only a regular file is read"),
        (listening, "is a socket, and only a regular file is read"),
        (folder_of_that_name, "Is a directory"),
    ],
)
@pytest.mark.parametrize("kind", [".log", ".log.gz", ".blf", ".db", ".csv"])
def test_what_is_no_regular_file_is_refused_by_every_command_and_nobody_waits(
    make: Callable[[Path], Path], what: str, kind: str, bench: tuple[Path, Path], capsys: Output, tmp_path: Path
) -> None:
    (tmp_path / "s").mkdir()
    log = make(tmp_path / f"s/b{kind}")
    words = commands(log, bench[1], tmp_path)
    words = [each for each in words if each[0] not in {"health", "report"}] + [["diagnose", str(log)]]
    for command in words:
        assert main(command) == 74, command
        (line,) = capsys.readouterr().err.splitlines()
        assert f"{log}: cannot be read: {what}" in line, command


def test_a_file_that_becomes_a_fifo_while_it_is_opened_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, looked = tmp_path / "bus.log", []
    path.write_text("(0.0) can0 110#00 R\n", encoding="ascii")
    look = Path.stat

    def swapped(self: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        found = look(self, follow_symlinks=follow_symlinks)
        if self == path:
            looked.append(self)
            path.unlink()
            os.mkfifo(path)
        return found

    monkeypatch.setattr(Path, "stat", swapped)
    with pytest.raises(LogError, match="is a FIFO, and only a regular file is read"):
        read_log(path)
    assert looked


def test_a_link_to_a_log_is_followed(bench: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "link.log").symlink_to(bench[0])
    assert read_log(tmp_path / "link.log").count == read_log(bench[0]).count


def test_a_name_with_dots_before_its_ends_is_read(bench: tuple[Path, Path], tmp_path: Path) -> None:
    path = tmp_path / "2024.05.01.log.gz"
    path.write_bytes(gzip.compress(bench[0].read_bytes()))
    assert read_log(path).count == read_log(bench[0]).count


def test_an_identifier_that_no_frame_has_ends_a_log(tmp_path: Path, bench: tuple[Path, Path]) -> None:
    path = tmp_path / "bus.csv"
    head = "timestamp,arbitration_id,extended,remote,error,dlc,data\n"
    path.write_text(f"{head}0.5,0x110,0,0,0,8,AAAAAAAAAAA=\n0.6,0xFFFFFFFFFF,0,0,1,0,\n", encoding="ascii")
    assert (
        read_log(path).cut
        == "line 3: the part after frame 1 cannot be read (ValueError: 1099511627775 is no identifier)"
    )
    assert main(["monitor", str(path), "--config", str(bench[1]), "--picture", str(tmp_path / "x.svg")]) == 0


def test_json_of_a_damaged_log_stays_json(tmp_path: Path, bench: tuple[Path, Path], capsys: Output) -> None:
    path = tmp_path / "bus.log"
    path.write_bytes(bench[0].read_bytes() + b"x" * (1 << 17))
    assert main(["replay", str(path), "--config", str(bench[1]), "--json"]) in {0, 1}
    assert "longer than 64 KiB" in json.dumps(json.loads(capsys.readouterr().out))
    with pytest.raises(PositionerError):
        read_log(tmp_path / "absent.log")
