"""The quick part of `make fuzz-files`, and proof that it would find what it looks for."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from random import Random
from typing import TYPE_CHECKING

import pytest

from endurance import fuzz_files
from endurance.file_kinds import KINDS, FileKind
from positioner.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

JSON = KINDS["json"]


@pytest.mark.parametrize("name", KINDS)
def test_hundreds_of_damaged_files_are_read_or_refused_with_one_clear_line(name: str, tmp_path: Path) -> None:
    found = fuzz_files.run_part(name, range(100), str(tmp_path))
    # the memory of this process proves nothing: it holds the rest of the suite as well
    assert [line for line in found.violations if not line.endswith("MiB")] == []
    assert 0 < found.taken[name] <= found.inputs[name] == 100


def test_the_same_seed_gives_the_same_file_and_every_kind_of_change_happens() -> None:
    def file(seed: int) -> bytes:
        return fuzz_files.changed(JSON.true[0], JSON.true[1], JSON.words, Random(seed))  # noqa: S311

    files = [file(seed) for seed in range(200)]
    assert files == [file(seed) for seed in range(200)]
    assert len(set(files)) > 190
    assert any(len(data) < len(JSON.true[0]) / 2 for data in files)
    assert any(len(data) > 2 * len(JSON.true[0]) for data in files)


def fails(number: int, data: bytes, folder: Path) -> None:
    del number, data, folder
    raise ValueError("nobody caught it")


def babbles(number: int, data: bytes, folder: Path) -> None:
    del number, data, folder
    raise UsageError("x" * 5000)


def strays(number: int, data: bytes, folder: Path) -> None:
    del number
    (folder.parent / "elsewhere").write_bytes(data)


@pytest.mark.parametrize(
    ("reader", "violation"),
    [(fails, "ValueError: 'nobody caught it'"), (babbles, "5000 characters"), (strays, "touched ['elsewhere']")],
)
def test_what_it_looks_for_is_found_and_kept(
    reader: object, violation: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken: FileKind = replace(JSON, read=reader)  # type: ignore[arg-type]
    monkeypatch.setitem(KINDS, "json", broken)
    found = fuzz_files.run_part("json", range(1), str(tmp_path))
    assert violation in found.violations[0]
    assert (tmp_path / "json-0").is_file()


def test_what_takes_too_long_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz_files, "MOST_CPU_S", -1.0)
    assert fuzz_files.run_part("json", range(1), "").violations[0].endswith(" s")


def test_what_never_ends_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def goes_on(number: int, data: bytes, folder: Path) -> None:
        del number, data, folder
        while True:
            with contextlib.suppress(Exception):
                pass

    monkeypatch.setitem(KINDS, "json", replace(JSON, read=goes_on))
    monkeypatch.setattr(fuzz_files, "_ENDLESS_S", 0.05)
    assert fuzz_files.run_part("json", range(1), "").violations[0] == "json 0: not read after 0 s"
