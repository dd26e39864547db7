"""The short form of `make crash-test`: the same programs, fewer kills, and longer limits for a busy machine."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from golden_table import FIT
from store_helpers import VALVE, WIDTH_M, series

from endurance import damage, sample_log
from endurance.crash import lost_too_much
from endurance.crash_learners import AGAIN, ALONE, TOGETHER, WRITER
from endurance.sample_log import Entry, SampleLogWriter
from endurance.table_check import TableCheck, taught
from positioner.store import database
from positioner.store.content import StoredTable
from positioner.store.table_directory import TABLE
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from pathlib import Path

EMPTY = StictionTable(cell_width_m=WIDTH_M)


def crash(*arguments: str) -> tuple[int, str]:
    """Return the exit status and the report of the crash test."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-m", "endurance.crash", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.bus
def test_kills_of_learners_and_daemons_leave_a_table_that_loads_without_a_hole(tmp_path: Path) -> None:
    code, report = crash(
        *("--kills", "20", "--daemon-kills", "2", "--slots", "3", "--daemon-slots", "1", "--damage-share", "0.001"),
        *("--limit-s", "30", "--seed", "5", "--folder", str(tmp_path)),
    )
    assert code == 0, report
    loads = [int(found) for found in re.findall(r"^(\d+) loads after", report, re.MULTILINE)]
    assert [loads[0] >= 20, loads[1]] == [True, 2], report
    saved = [int(found) for found in re.findall(r"^  (\d+) samples saved", report, re.MULTILINE)]
    assert [saved[0] > 0, saved[1] > 0] == [True, True], report
    assert report.endswith("violations: 0\n"), report


def test_a_sample_lost_beyond_the_limit_is_a_violation_and_a_start_of_a_table_writer_is_allowed_for() -> None:
    oldest_s = {TOGETHER: 1.2, TOGETHER + AGAIN: 1.2, ALONE + AGAIN: 1.9, WRITER: 1.0}
    assert lost_too_much(oldest_s, limit_s=1.1, start_s=0.5) == [
        f"{TOGETHER}: a sample of 1.200 s was lost, beyond the limit of 1.100 s",
        f"{ALONE + AGAIN}: a sample of 1.900 s was lost, beyond the limit of 1.600 s",
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage")


@pytest.fixture(scope="module")
def size(folder: Path) -> int:
    return len(damage.write_tables(folder / "whole"))


def test_a_damaged_byte_anywhere_is_harmless_or_the_table_is_set_aside_and_mended(folder: Path, size: int) -> None:
    flips = [one for one in damage.damages(size) if one[1]]
    found = [damage.what_becomes_of(folder, one) for one in flips[:: len(flips) // 120]]
    assert set(found) == {"detected", "harmless"}
    assert 40 < found.count("detected") < 120


def test_a_table_cut_anywhere_is_set_aside_and_mended(folder: Path, size: int) -> None:
    cuts = [one for one in damage.damages(size) if not one[1]]
    assert len(cuts) == size
    chosen = [*cuts[:: len(cuts) // 30], cuts[-1]]
    assert {damage.what_becomes_of(folder, one) for one in chosen} == {"detected"}


def entries(count: int, *, second_ns: int = 1_000_000_000) -> list[Entry]:
    """Return a sample log of `count` samples, one a second."""
    return [Entry(number * second_ns, number + 1, sample) for number, sample in enumerate(series(count))]


def on_disk(folder: Path, numbers: list[int]) -> Path:
    """Return a state directory whose table holds the samples of these numbers of the series."""
    stored = StoredTable(VALVE, EMPTY)
    for number in numbers:
        stored = stored.learned(series(1, number)[0], 0)
    database.create(folder / TABLE, stored)
    return folder


def test_the_check_ages_what_was_lost_from_the_sample_log(tmp_path: Path) -> None:
    check = TableCheck(on_disk(tmp_path, [0, 1, 2]), VALVE, EMPTY)
    outcome = check.after_kill("kill", entries(5), killed_ns=4_500_000_000)
    assert (outcome.saved, outcome.lost, outcome.oldest_s, outcome.violations) == (3, 2, 1.5, ())
    assert check.table == taught(EMPTY, entries(3))


@pytest.mark.parametrize("numbers", [[0, 2, 3], [0, 2, 1], [1, 2, 3], [0, 1, 1]])
def test_the_check_sees_a_hole(tmp_path: Path, numbers: list[int]) -> None:
    outcome = TableCheck(on_disk(tmp_path, numbers), VALVE, EMPTY).after_kill("kill", entries(5), 0)
    assert ["has a hole" in violation for violation in outcome.violations] == [True]


def test_the_check_sees_a_table_that_went_back_and_one_that_was_set_aside(tmp_path: Path) -> None:
    check = TableCheck(on_disk(tmp_path, [0]), VALVE, taught(EMPTY, entries(2)))
    assert "went back from 2 to 1 samples" in check.after_kill("kill", [], 0).violations[0]
    (tmp_path / TABLE).write_bytes(b"garbage")
    (tmp_path / "stiction.damaged-20260101T000000Z-1.sqlite").touch()
    reported = " ".join(check.after_kill("kill", [], 0).violations)
    assert "is not an SQLite database" in reported
    assert "was set aside" in reported


def test_a_sample_log_keeps_every_digit_and_leaves_out_a_line_cut_short(tmp_path: Path) -> None:
    samples = [*series(3), replace(series(1)[0], fit=FIT)]
    writer = SampleLogWriter(tmp_path / "sample_log")
    for number, sample in enumerate(samples):
        writer.write(number + 1, sample)
    with (tmp_path / "sample_log").open("a", encoding="ascii") as file:
        file.write("[1, 4, ")
    found = sample_log.read(tmp_path / "sample_log")
    assert [entry.sample for entry in found] == samples
    assert [entry.sequence for entry in found] == [1, 2, 3, 4]
    assert taught(EMPTY, found).fit == FIT
    assert sample_log.read(tmp_path / "none") == []
