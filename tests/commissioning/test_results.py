"""Kept results: what is kept comes back, which is the reference, and what a damaged or planted file can do."""

from __future__ import annotations

import json
import math
import os
from typing import TYPE_CHECKING, Any

import pytest

from positioner.commissioning import results
from positioner.errors import StateError
from positioner.machine import kept_files

if TYPE_CHECKING:
    from pathlib import Path

IS_ROOT = os.geteuid() == 0
OTHER = 65534


def document(number: float) -> dict[str, Any]:
    return {"valve": "FV-101", "number": number}


def numbers(directory: Path, kind: str = "signature") -> list[float]:
    return [each.document["number"] for each in results.kept(directory, kind)]


def test_what_is_kept_comes_back_newest_last_also_within_one_second(tmp_path: Path) -> None:
    for number in range(12):
        results.keep(tmp_path / "state", "signature", document(number))
    results.keep(tmp_path / "state", "step-test", document(99))
    assert numbers(tmp_path / "state") == list(range(12))
    (other,) = results.kept(tmp_path / "state", "step-test")
    assert (other.kind, other.valve, other.versions) == ("step-test", "FV-101", results.versions())
    assert results.kept(tmp_path / "nowhere", "signature") == ()
    with pytest.raises(ValueError, match="no kind of result"):
        results.kept(tmp_path, "../etc")


def test_the_first_is_the_reference_until_another_is_named(tmp_path: Path) -> None:
    assert results.reference(tmp_path, "signature", "FV-101") is None
    chosen = [results.keep(tmp_path, "signature", document(each), as_reference=each == 2) for each in range(4)]
    found = results.reference(tmp_path, "signature", "FV-101")
    assert found is not None
    assert found.document == document(2)
    chosen[2].unlink()
    assert results.reference(tmp_path, "signature", "FV-101") == results.kept(tmp_path, "signature")[0]


def test_a_number_that_is_none_is_kept_as_none(tmp_path: Path) -> None:
    results.keep(tmp_path, "identify", {"valve": "FV-101", "rows": [(1.0, math.nan)], "high": math.inf})
    (found,) = results.kept(tmp_path, "identify")
    assert found.document == {"valve": "FV-101", "rows": [[1.0, None]], "high": None}


@pytest.mark.parametrize("content", ["", "[]", "{", "null", '{"format": "positioner-result"}', "[" * 100_000])
def test_a_damaged_file_is_one_line_and_hides_no_other(tmp_path: Path, content: str) -> None:
    first = results.keep(tmp_path, "signature", document(0))
    damaged = first.with_name("signature-20200101T000000Z.json")
    damaged.write_text(content)
    lines: list[str] = []
    assert [each.document for each in results.kept(tmp_path, "signature", lines.append)] == [document(0)]
    assert lines == [f"{damaged}: is no kept result (it is damaged): remove it"]


def test_every_part_of_a_file_is_checked(tmp_path: Path) -> None:
    path = results.keep(tmp_path, "signature", document(0))
    whole = json.loads(path.read_text())
    for key in whole:
        wrongs: tuple[Any, ...] = (None, 3, [], "x")
        for wrong in wrongs:
            if key != "valve" or wrong != "x":
                path.write_text(json.dumps({**whole, key: wrong}))
                lines: list[str] = []
                assert results.kept(tmp_path, "signature", lines.append) == (), (key, wrong)
                assert len(lines) == 1


def test_neither_links_nor_pipes_are_opened(tmp_path: Path) -> None:
    path = results.keep(tmp_path, "signature", document(0))
    secret = tmp_path / "secret"
    path.rename(secret)
    path.symlink_to(secret)
    os.mkfifo(path.with_name("signature-20200101T000000Z.json"))
    os.link(secret, path.with_name("signature-20200102T000000Z.json"))
    lines: list[str] = []
    assert results.kept(tmp_path, "signature", lines.append) == ()
    assert len(lines) == 3


def test_a_planted_folder_leads_nowhere(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / results.FOLDER).symlink_to(elsewhere)
    with pytest.raises(StateError, match="cannot be kept"):
        results.keep(tmp_path, "signature", document(0))
    with pytest.raises(StateError, match="cannot be kept"):
        results.check_writable(tmp_path)
    assert list(elsewhere.iterdir()) == []


def test_what_root_keeps_belongs_to_the_owner_of_the_directory(tmp_path: Path) -> None:
    owner = OTHER if IS_ROOT else os.geteuid()
    state = tmp_path / "state"
    state.mkdir()
    os.chown(state, owner, -1)
    path = results.keep(state, "signature", document(0))
    assert {each.stat().st_uid for each in (path, path.parent)} == {owner}
    assert numbers(state) == [0]


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results.keep(tmp_path, "signature", document(0))

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("positioner.machine.kept_files.os.fsync", full)
    with pytest.raises(StateError, match="No space left on device"):
        results.keep(tmp_path, "signature", document(1))
    assert numbers(tmp_path) == [0]
    assert [each.name for each in (tmp_path / results.FOLDER).iterdir() if each.name.startswith(".")] == []


def test_looking_before_the_valve_moves_leaves_nothing_behind(tmp_path: Path) -> None:
    results.check_writable(tmp_path / "state")
    with kept_files.opened(tmp_path / "state", results.FOLDER) as folder:
        assert kept_files.names(folder) == []
