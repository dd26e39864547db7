"""The kinds of file that the project reads: valid examples, words of their format, and their readers."""

from __future__ import annotations

import gzip
import os
import tempfile
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import can
from store_helpers import VALVE, WIDTH_M, series, taught
from user_dbc import ALL, USER_DBC

from plant_emulator.presets import overridden
from positioner.bench import scenario
from positioner.campaign.reader import load_campaign
from positioner.config.reader import parse_config
from positioner.errors import ConfigurationError, Problem
from positioner.inputs.toml_reader import read_text, tables
from positioner.replay.cycles import cycles_of
from positioner.replay.log import read_log
from positioner.replay.recorded import FrameClassifier
from positioner.replay.survey import Survey
from positioner.store import access, database, document, messages
from positioner.store.messages import Adopt, ImportRequest, Learn
from positioner.store.table_directory import TABLE, TableDirectory
from positioner.wire.codec import make_codec
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[2]
_NUMBERS = (b"0", b"-1", b"1e999", b"-1e308", b"nan", b"inf", b"9" * 40, b"9" * 5000, b"0x7f", b"1.5", b"\xff", b"\x00")
_AS_OWNER_EVERY = 500
_CLASSIFIER = FrameClassifier(make_codec(WireSettings()))
_PERIOD_NS = 1_000_000


@dataclass(frozen=True)
class FileKind:
    """A kind of file: the full number of inputs, true files, words of the format, and the reader of an input.

    The reader gets the number of the true file, the input, and a folder that it may write in.
    """

    name: str
    inputs: int
    true: tuple[bytes, ...]
    words: tuple[bytes, ...]
    read: Callable[[int, bytes, Path], None]


def _files(folder: str, pattern: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((ROOT / folder).glob(pattern))]


_CONFIGURATIONS = [
    *_files("positioner", "example.toml"),
    *_files("tests/logs", "*.toml"),
    b'[valve]\nid = "FV-1"\npreset = "paper"\n[bus]\ninterface = "virtual"\nchannel = 3\n[guard]\nauto_arm = true\n',
]
_SCENARIOS = _files("positioner/bench/scenarios", "*.toml")[:6]
_PLANTS = _files("plant_emulator/presets", "*.toml")
_TOML_FILES = (*_CONFIGURATIONS, *_SCENARIOS, *_PLANTS, *_files("examples", "campaign.toml"))


def _text(data: bytes, folder: Path) -> str:
    path = folder / "input.toml"
    path.write_bytes(data)
    return read_text(path)


def _read_toml(number: int, data: bytes, folder: Path) -> None:
    text = _text(data, folder)
    if number < len(_CONFIGURATIONS):
        parse_config(text, "input.toml", folder)
    elif number < len(_CONFIGURATIONS) + len(_SCENARIOS):
        scenario.parse_scenario(text, "input.toml")
    elif number >= len(_CONFIGURATIONS) + len(_SCENARIOS) + len(_PLANTS):
        load_campaign(folder / "input.toml")
    else:
        overridden(tables(text, "input.toml"), {}, "input.toml", text)


def _read_json(number: int, data: bytes, folder: Path) -> None:
    del folder
    if number:
        messages.decode(data)
        return
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise ConfigurationError("input", (Problem("file", None, str(error)),)) from error
    document.loads(text, "input.json")


_LOG_SUFFIXES = (".log", ".asc", ".csv", ".blf", ".trc")


def _logs() -> tuple[bytes, ...]:
    """Return the first frames of a recorded log in every format."""
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / "source.log"
        source.write_bytes(b"\n".join(gzip.decompress(*_files("tests/logs", "nmpc.log.gz")).split(b"\n")[:40]) + b"\n")
        with can.LogReader(source) as reader:
            frames = list(reader)
        found = []
        for suffix in _LOG_SUFFIXES:
            path = Path(place) / f"log{suffix}"
            with can.Logger(path) as logger:
                for frame in frames:
                    logger(frame)
            found.append(path.read_bytes())
    return tuple(found)


def _read_log(number: int, data: bytes, folder: Path) -> None:
    path = folder / f"input{_LOG_SUFFIXES[number]}"
    path.write_bytes(data)
    survey = Survey(_CLASSIFIER, _PERIOD_NS)
    log = read_log(path, survey.add)
    for _ in cycles_of(survey.kind, _CLASSIFIER, log.frames(), _PERIOD_NS):
        pass


def _read_dbc(number: int, data: bytes, folder: Path) -> None:
    del number
    path = folder / "input.dbc"
    path.write_bytes(data)
    make_codec(replace(ALL, dbc=path), span_m=0.1)


def _table() -> bytes:
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / TABLE
        database.create(path, taught(series(40)))
        return path.read_bytes()


def _read_sqlite(number: int, data: bytes, folder: Path) -> None:
    """Read a table, or a table with a journal; now and then as root does it in somebody else's directory."""
    for path in folder.iterdir():
        with suppress(OSError):
            path.unlink()
    table, journal = (data, b"") if number == 0 else (_TABLE, data)
    (folder / TABLE).write_bytes(table)
    if journal:
        (folder / f"{TABLE}-journal").write_bytes(journal)
    if len(data) % _AS_OWNER_EVERY == 0 and os.geteuid() == 0:
        os.chown(folder, 65534, 65534)
        access.dump(folder)
    else:
        table_directory = TableDirectory(folder, VALVE, WIDTH_M)
        stored = table_directory.load()
        table_directory.save(stored)
        table_directory.close()


def _journal() -> bytes:
    """Return the journal of an unfinished transaction on the table."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / TABLE
        path.write_bytes(_TABLE)
        connection = database.connect(path)
        connection.execute("PRAGMA cache_size = 1")
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("UPDATE cells SET count = count + 1, samples = samples || hex(randomblob(500))")
        journal = Path(f"{path}-journal").read_bytes()
        connection.rollback()
        connection.close()
        return journal


_TABLE = _table()
_DOCUMENT = document.dumps(taught(series(12))).encode()
_MESSAGES = tuple(
    messages.encode(message)
    for message in (
        Adopt(taught(series(20))),
        ImportRequest(taught(series(20)), force=True),
        Learn(1, tuple(series(4))),
    )
)
_TOML_WORDS = (
    b"[",
    b"]",
    b"[[",
    b"=",
    b"\n",
    b'"',
    b"'''",
    b".",
    b"a.b.c = 1\n",
    b"[valve]\n",
    b"true",
    b"{",
    b"}",
    b"#",
)
_JSON_WORDS = (
    b"{",
    b"}",
    b"[",
    b"]",
    b",",
    b":",
    b'"',
    b"null",
    b"\\u0000",
    b'"kind": "Cells"',
    b'"samples": []',
    b"\n",
)
_LOG_WORDS = (
    b"(",
    b")",
    b" ",
    b"#",
    b"R",
    b"(nan)",
    b"(1e30)",
    b"vcan0",
    b"1FFFFFFF#",
    b",",
    b"\n",
    b";",
    b"Rx",
    b"##",
)
_DBC_WORDS = (
    b"BO_ ",
    b"SG_ ",
    b"BA_ ",
    b"VAL_ ",
    b"(0,0)",
    b"0|0@1+",
    b"0|64@0-",
    b'"',
    b";",
    b"\n",
    b"m0",
    b"M ",
    b"|",
)
_SQL_WORDS = (
    b"CREATE TABLE x(i)",
    b"sqlite_master",
    b"SQLite format 3\x00",
    bytes(16),
    b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7",
)

KINDS = {
    kind.name: kind
    for kind in (
        FileKind("toml", 300_000, _TOML_FILES, (*_NUMBERS, *_TOML_WORDS), _read_toml),
        FileKind("json", 500_000, (_DOCUMENT, *_MESSAGES), (*_NUMBERS, *_JSON_WORDS), _read_json),
        FileKind("log", 200_000, _logs(), (*_NUMBERS, *_LOG_WORDS), _read_log),
        FileKind("dbc", 50_000, (USER_DBC.encode("cp1252"),), (*_NUMBERS, *_DBC_WORDS), _read_dbc),
        FileKind("sqlite", 50_000, (_TABLE, _journal()), _SQL_WORDS, _read_sqlite),
    )
}
