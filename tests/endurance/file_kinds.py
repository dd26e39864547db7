"""The kinds of file that the project reads: valid examples, words of their format, and their readers."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import tempfile
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import can
from report_samples import IDENTIFY, LATER, friction_alarm, service, signature, signatures, step_test, stroke_test
from store_helpers import VALVE, WIDTH_M, series, taught
from user_dbc import ALL, USER_DBC

from plant_emulator.presets import overridden
from positioner.bench import scenario
from positioner.campaign.reader import load_campaign
from positioner.commissioning import results
from positioner.config.reader import parse_config
from positioner.errors import ConfigurationError, Problem, StateError
from positioner.health.alarm_text import alarm_lines, trends_as_json
from positioner.health.counters_document import COUNTERS, counters_in
from positioner.health.counters_report import count_rows, histograms
from positioner.health.monitor import begin_health, sections_of
from positioner.health.trends_document import TRENDS, trends_in
from positioner.inputs.toml_reader import read_text, tables
from positioner.replay.cycles import cycles_of
from positioner.replay.log import read_log
from positioner.replay.recorded import FrameClassifier
from positioner.replay.survey import Survey
from positioner.report.procedure_page import section_of, verdict_of
from positioner.report.trend_sections import Service, trend_section
from positioner.runtime.health_reference import measured_health_settings
from positioner.store import access, database, document, messages
from positioner.store.health_document import HealthDocument, to_plain
from positioner.store.health_file import HEALTH, PREVIOUS, HealthFile
from positioner.store.messages import Adopt, ImportRequest, Learn
from positioner.store.table_directory import TABLE, TableDirectory
from positioner.wire.codec import make_codec
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.health.counters import Counters
    from positioner.health.watch import Trends

ROOT = Path(__file__).resolve().parents[2]
_NUMBERS = (b"0", b"-1", b"1e999", b"-1e308", b"nan", b"inf", b"9" * 40, b"9" * 5000, b"0x7f", b"1.5", b"\xff", b"\x00")
_AS_OWNER_EVERY = 500
_CLASSIFIER = FrameClassifier(make_codec(WireSettings()))
_PERIOD_NS = 1_000_000
_DEEPER = 0.85
"""The chance that a value within the present one is changed rather than this one."""
_ODD_VALUES = (
    *("null", "true", '""', '"x"', "0", "-1", "1", "2", "7.5", "-0.0", "1e-300", "1e99", "-1e99", "1e308", "1e999"),
    *("NaN", "9007199254740992", "9223372036854775808", "1" + 18 * "0", "1" + 400 * "0", "[]", "{}", "[[]]", "[{}]"),
    *("[null]", '{"a": 1}', '{"median": "x"}', '"2026-05-09T07:35:25Z"', '"9999-99-99T99:99:99Z"'),
)


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


_LOG_SUFFIXES = (".log", ".asc", ".csv", ".blf", ".trc", ".db", ".log.gz")


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
    if path.suffix == ".db":  # what SQLite would play back and delete
        path.with_name(f"{path.name}-journal").write_bytes(_JOURNAL)
    survey = Survey(_CLASSIFIER, _PERIOD_NS)
    try:
        log = read_log(path, survey.add)
        for _ in cycles_of(survey.kind, _CLASSIFIER, log.frames(), _PERIOD_NS):
            pass
    finally:
        if path.read_bytes() != data:
            raise AssertionError("the log was changed")


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


_STATE = parse_config(
    '[valve]\nid = "FV-101"\npreset = "paper"\n[state]\ndirectory = "."\n[health]\nstroke_test_days = 30.0\n',
    "fv101.toml",
    Path(),
)
_SERVICE = service(0.3, (friction_alarm(0.3),))
_SETTINGS = replace(_STATE.health_settings, watch=_SERVICE.watch)
_SECTIONS = {COUNTERS: counters_in(_SERVICE.counters), TRENDS: trends_in(_SERVICE.trends)}


def _parsed(data: bytes, true: bytes) -> bytes:
    """Return every second input that is no JSON as a true file with other values, chosen by it, at some places."""
    if not len(data) % 2:
        return data
    with suppress(ValueError, RecursionError):
        json.loads(data)
        return data
    chance = Random(data)  # noqa: S311 - a test needs the same numbers again
    plain = json.loads(true)
    for _ in range(chance.choice((1, 1, 2, 5))):
        outer: Any = plain
        inner, key = plain, None
        while isinstance(inner, dict | list) and inner and (key is None or chance.random() < _DEEPER):
            outer, keys = inner, list(inner) if isinstance(inner, dict) else range(len(inner))
            key = chance.choice(keys)
            inner = outer[key]
        outer[key] = json.loads(chance.choice(_ODD_VALUES))
    return json.dumps(plain).encode()


def _read_health(number: int, data: bytes, folder: Path) -> None:
    """Start from the health of a valve beside a good copy; what is an object has the digest that fits it."""
    del number
    data = _parsed(data, _HEALTH)
    with suppress(ValueError, RecursionError):
        plain = json.loads(data)
        if isinstance(plain, dict):
            plain.pop("sha256", None)
            plain["sha256"] = hashlib.sha256(json.dumps(plain, sort_keys=True, allow_nan=False).encode()).hexdigest()
            data = json.dumps(plain).encode()
    (folder / PREVIOUS).write_bytes(_HEALTH)
    (folder / HEALTH).write_bytes(data)
    file = HealthFile(folder, _STATE.valve.id)
    found = file.load()
    lines = file.take_notices()
    if lines and found.sections != _SECTIONS:
        raise AssertionError("the good copy is not used")
    health = begin_health(_SETTINGS, found.sections)
    _show(health.counting.so_far, health.watch.trends)
    file.save(replace(found, sections=sections_of(health)))
    for path in folder.iterdir():
        path.unlink()
    if lines:
        raise StateError(lines[0])


def _show(counters: Counters, trends: Trends) -> None:
    """Show the health as `positioner health` and `positioner report` do."""
    count_rows(_SETTINGS.counters, counters)
    histograms(counters)
    trends_as_json(_SETTINGS.watch, trends)
    for alarm in trends.alarms:
        alarm_lines(alarm)
    trend_section(Service(counters, trends, _SETTINGS.watch, "", LATER), signatures(1.3))


def _shortened(value: Any) -> Any:
    """Return the value with the first of its points: what is a quantity's own row stays."""
    if isinstance(value, dict):
        return {key: each if key == "rows" else _shortened(each) for key, each in value.items()}
    return [_shortened(each) for each in value[:_SHORT]] if isinstance(value, list) else value


def _kept_result(kind: str, document: dict[str, Any]) -> bytes:
    with tempfile.TemporaryDirectory() as place:
        return results.keep(Path(place), kind, document).read_bytes()


def _read_result(number: int, data: bytes, folder: Path) -> None:
    """Read a kept result, or the name of the reference, beside a good one, as a daemon that starts and a report do."""
    place = folder / results.FOLDER
    place.mkdir(exist_ok=True)
    data = _parsed(data, _KEPT_RESULTS[number])
    kind = _RESULT_KINDS[number % len(_RESULT_KINDS)]
    good = _RESULTS[number % len(_RESULT_KINDS)]
    (place / f"{kind}-20260101T000000Z.json").write_bytes(good)
    name = f"{kind}-20260102T000000Z.json" if number < len(_RESULT_KINDS) else f"reference-{kind}.json"
    (place / name).write_bytes(data)
    lines: list[str] = []
    measured_health_settings(_STATE, lines.append, folder, aside=True)
    found = results.kept(folder, kind, lines.append)
    if json.loads(good)["document"] not in [each.document for each in found]:
        raise AssertionError("the good one is not used")
    for each in found:
        section_of(each, found[0])
        verdict_of(each)
    for path in place.iterdir():
        path.unlink()
    if lines:
        raise StateError(lines[0])


_TABLE = _table()
_JOURNAL = _journal()
_DOCUMENT = document.dumps(taught(series(12))).encode()
_MESSAGES = tuple(
    messages.encode(message)
    for message in (
        Adopt(taught(series(20))),
        ImportRequest(taught(series(20)), force=True),
        Learn(1, tuple(series(4))),
    )
)
_HEALTH = json.dumps(
    to_plain(HealthDocument(_STATE.valve.id, "2026-05-09T07:35:25Z", 3, "2026-05-10T07:35:25Z", _SECTIONS))
).encode()
_RESULT_KINDS = ("identify", "signature", "step-test", "stroke-test")
_SHORT = 5
"""Of the points and rows of a document so many: a file of ten times the size is read ten times as slowly."""
_IDENTIFIED = {"configuration": {"valve": {"coulomb_friction_n": 1423.0, "static_friction_n": 1708.0}}}
_RESULTS = tuple(
    _kept_result(*each)
    for each in zip(_RESULT_KINDS, ({**IDENTIFY, **_IDENTIFIED}, signature(), step_test(), stroke_test()), strict=True)
)
_KEPT_RESULTS = (*_RESULTS, *(4 * (b'{"file": "signature-20260101T000000Z.json"}',)))
_KEPT_WORDS = (b'"value": null', b'"value": 1e99', b'"median": -0', b"[[]]", b'{"a": 1}', b"true", b'"sections": {}')
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
    b"CREATE VIEW messages AS SELECT zeroblob(1000000000)",
    b"\x7f\xff\xff\xff",
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
        FileKind("health", 500_000, (_HEALTH,), (*_NUMBERS, *_JSON_WORDS, *_KEPT_WORDS), _read_health),
        FileKind(
            "result",
            500_000,
            _KEPT_RESULTS,
            (*_NUMBERS, *_JSON_WORDS, *_KEPT_WORDS),
            _read_result,
        ),
        FileKind("log", 200_000, _logs(), (*_NUMBERS, *_LOG_WORDS), _read_log),
        FileKind("dbc", 50_000, (USER_DBC.encode("cp1252"),), (*_NUMBERS, *_DBC_WORDS), _read_dbc),
        FileKind("sqlite", 50_000, (_TABLE, _JOURNAL), _SQL_WORDS, _read_sqlite),
    )
}
