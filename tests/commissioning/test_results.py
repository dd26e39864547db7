"""Kept results: what is kept comes back, which is the reference, and what a damaged or planted file can do."""

from __future__ import annotations

import json
import math
import os
from datetime import datetime
from random import Random
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import write_configuration
from report_samples import IDENTIFY, SIGNATURE, step_test, stroke_test

from positioner.bus.address import BusAddress
from positioner.commissioning import results
from positioner.config.reader import load_config
from positioner.errors import StateError
from positioner.machine import kept_files
from positioner.report.procedure_page import section_of, verdict_of
from positioner.runtime.health_reference import measured_health_settings

if TYPE_CHECKING:
    from pathlib import Path

IS_ROOT = os.geteuid() == 0
OTHER = 65534


def document(number: float) -> dict[str, Any]:
    return {"valve": "FV-101", "number": number}


def numbers(directory: Path, kind: str = "trial") -> list[float]:
    return [each.document["number"] for each in results.kept(directory, kind)]


def test_what_is_kept_comes_back_newest_last_also_within_one_second(tmp_path: Path) -> None:
    for number in range(12):
        results.keep(tmp_path / "state", "trial", document(number))
    results.keep(tmp_path / "state", "other-trial", document(99))
    assert numbers(tmp_path / "state") == list(range(12))
    (other,) = results.kept(tmp_path / "state", "other-trial")
    assert (other.kind, other.valve, other.versions) == ("other-trial", "FV-101", results.versions())
    assert results.kept(tmp_path / "nowhere", "trial") == ()
    with pytest.raises(ValueError, match="no kind of result"):
        results.kept(tmp_path, "../etc")


def test_the_first_is_the_reference_until_another_is_named(tmp_path: Path) -> None:
    assert results.reference(tmp_path, "trial", "FV-101") is None
    chosen = [results.keep(tmp_path, "trial", document(each), as_reference=each == 2) for each in range(4)]
    found = results.reference(tmp_path, "trial", "FV-101")
    assert found is not None
    assert found.document == document(2)
    chosen[2].unlink()
    assert results.reference(tmp_path, "trial", "FV-101") == results.kept(tmp_path, "trial")[0]


def test_a_number_that_is_none_is_kept_as_none(tmp_path: Path) -> None:
    results.keep(tmp_path, "trial", {"valve": "FV-101", "points": [(1.0, math.nan)], "high": math.inf})
    (found,) = results.kept(tmp_path, "trial")
    assert found.document == {"valve": "FV-101", "points": [[1.0, None]], "high": None}


@pytest.mark.parametrize("content", ["", "[]", "{", "null", '{"format": "positioner-result"}', "[" * 100_000])
def test_a_damaged_file_is_one_line_and_hides_no_other(tmp_path: Path, content: str) -> None:
    first = results.keep(tmp_path, "trial", document(0))
    damaged = first.with_name("trial-20200101T000000Z.json")
    damaged.write_text(content)
    lines: list[str] = []
    assert [each.document for each in results.kept(tmp_path, "trial", lines.append)] == [document(0)]
    (line,) = lines
    assert line.startswith(f"{damaged} ")
    assert line.endswith(": not used, move it away")
    results.kept(tmp_path, "trial", lines.append, aside=True)
    (aside,) = (tmp_path / results.FOLDER).glob("trial-20200101T000000Z.damaged-*.json")
    assert lines[1].endswith(f": not used, moved aside to {aside}")
    assert aside.read_text() == content
    assert [each.document for each in results.kept(tmp_path, "trial", lines.append)] == [document(0)]
    assert len(lines) == 2


def test_every_part_of_a_file_is_checked(tmp_path: Path) -> None:
    path = results.keep(tmp_path, "trial", document(0))
    whole = json.loads(path.read_text())
    for key in whole:
        wrongs: tuple[Any, ...] = (None, 3, [], "x")
        for wrong in wrongs:
            if (key, wrong) != ("sequence", 3):
                path.write_text(json.dumps({**whole, key: wrong}))
                lines: list[str] = []
                assert results.kept(tmp_path, "trial", lines.append) == (), (key, wrong)
                assert len(lines) == 1


def test_neither_links_nor_pipes_are_opened(tmp_path: Path) -> None:
    path = results.keep(tmp_path, "trial", document(0))
    secret = tmp_path / "secret"
    path.rename(secret)
    path.symlink_to(secret)
    os.mkfifo(path.with_name("trial-20200101T000000Z.json"))
    os.link(secret, path.with_name("trial-20200102T000000Z.json"))
    lines: list[str] = []
    assert results.kept(tmp_path, "trial", lines.append) == ()
    assert len(lines) == 3


def test_a_planted_folder_leads_nowhere(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / results.FOLDER).symlink_to(elsewhere)
    with pytest.raises(StateError, match="cannot be kept"):
        results.keep(tmp_path, "trial", document(0))
    with pytest.raises(StateError, match="cannot be kept"):
        results.check_writable(tmp_path)
    assert list(elsewhere.iterdir()) == []


def test_what_root_keeps_belongs_to_the_owner_of_the_directory(tmp_path: Path) -> None:
    owner = OTHER if IS_ROOT else os.geteuid()
    state = tmp_path / "state"
    state.mkdir()
    os.chown(state, owner, -1)
    path = results.keep(state, "trial", document(0))
    assert {each.stat().st_uid for each in (path, path.parent)} == {owner}
    assert numbers(state) == [0]


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results.keep(tmp_path, "trial", document(0))

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("positioner.machine.kept_files.os.fsync", full)
    with pytest.raises(StateError, match="No space left on device"):
        results.keep(tmp_path, "trial", document(1))
    assert numbers(tmp_path) == [0]
    assert [each.name for each in (tmp_path / results.FOLDER).iterdir() if each.name.startswith(".")] == []


def test_looking_before_the_valve_moves_leaves_nothing_behind(tmp_path: Path) -> None:
    results.check_writable(tmp_path / "state")
    with kept_files.opened(tmp_path / "state", results.FOLDER) as folder:
        assert kept_files.names(folder) == []


def shuffled_clock(monkeypatch: pytest.MonkeyPatch, *days: int) -> None:
    """Have the wall clock show these days of 2026-05, one at each look."""
    left = list(days)

    class Clock(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> datetime:  # type: ignore[override]
            return datetime(2026, 5, left.pop(0), tzinfo=tz)

    monkeypatch.setattr(results, "datetime", Clock)


def test_after_a_step_of_the_clock_the_newest_result_stays_the_newest_and_the_first_the_reference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shuffled_clock(monkeypatch, 20, 3, 4, 30, 1)
    for number in range(5):
        results.keep(tmp_path, "trial", document(number))
    assert numbers(tmp_path, "trial") == [0, 1, 2, 3, 4]
    found = results.reference(tmp_path, "trial", "FV-101")
    assert found is not None
    assert found.document == document(0)
    assert [each.sequence for each in results.kept(tmp_path, "trial")] == [1, 2, 3, 4, 5]


def test_files_of_earlier_versions_stand_first_by_their_dates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shuffled_clock(monkeypatch, 5, 4, 6, 1, 2)
    for number in range(3):
        path = results.keep(tmp_path, "trial", document(number))
        whole = json.loads(path.read_text())
        del whole["sequence"]
        path.write_text(json.dumps(whole))
    results.keep(tmp_path, "trial", document(3))
    results.keep(tmp_path, "trial", document(4))
    assert numbers(tmp_path, "trial") == [1, 0, 2, 3, 4]


@pytest.mark.parametrize("content", ["", "{}", '{"file": 3}', "[" * 100_000, '{"file": "trial-20200101T000000Z.json"}'])
def test_a_damaged_name_of_the_reference_is_told_and_the_first_result_is_the_reference(
    tmp_path: Path, content: str
) -> None:
    results.keep(tmp_path, "trial", document(0))
    results.keep(tmp_path, "trial", document(1), as_reference=True)
    (tmp_path / results.FOLDER / "reference-trial.json").write_text(content)
    lines: list[str] = []
    found = results.reference(tmp_path, "trial", "FV-101", lines.append, aside=True)
    assert found is not None
    assert found.document == document(0)
    assert len(lines) == (0 if "2020" in content or "3" in content else 1)


DOCUMENTS = {
    "identify": {
        **IDENTIFY,
        "configuration": {"valve": {"coulomb_friction_n": 1423.0, "static_friction_n": 1708.0}},
    },
    "signature": {**SIGNATURE, "compared": True, "beyond_limits": []},
    "step-test": step_test(),
    "stroke-test": stroke_test(),
}


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths to all values in a document."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, each in inner for place in places(each, (*path, key)))]


def with_value(plain: Any, path: tuple[Any, ...], value: Any) -> Any:
    if not path:
        return value
    if isinstance(plain, dict):
        return {**plain, path[0]: with_value(plain[path[0]], path[1:], value)}
    return [with_value(each, path[1:], value) if number == path[0] else each for number, each in enumerate(plain)]


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_whatever_one_value_of_a_kept_result_becomes_the_older_good_one_is_used_and_nothing_stops(
    tmp_path: Path, kind: str
) -> None:
    configuration = load_config(write_configuration(tmp_path, BusAddress(interface="virtual", channel="none")))
    state = configuration.state_directory
    results.keep(state, kind, DOCUMENTS[kind])
    path = results.keep(state, kind, DOCUMENTS[kind])
    whole = json.loads(path.read_text())
    every = places(whole)
    chance = Random(kind)  # noqa: S311 - the same places again
    refused = 0
    for place in chance.sample(every, min(len(every), 250)):
        value: Any = chance.choice((None, "x", -1, 0, 1e300, 10**400, [], {}, True, [[]], {"median": "x"}))
        path.write_text(json.dumps(with_value(whole, place, value)))
        lines: list[str] = []
        found = results.kept(state, kind, lines.append)
        assert found[0].document == DOCUMENTS[kind]
        assert len(found) + len(lines) == 2
        refused += len(lines)
        settings = measured_health_settings(configuration, lines.append)
        assert settings.watch.reference.source == (kind if kind in {"identify", "signature"} else "configuration")
        assert [line for line in lines if "not used" not in line] == []
        for each in found:
            section_of(each, found[0])
            verdict_of(each)
    assert refused > 0
