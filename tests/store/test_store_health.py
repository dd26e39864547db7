"""The health of a valve in its state directory: saved by the table writer, whatever happens."""

from __future__ import annotations

import json
import os
import signal
import stat
from typing import TYPE_CHECKING

import pytest
from store_helpers import VALVE, opened, python, wait_for

from positioner.errors import StateError
from positioner.store import access, health_file, lock
from positioner.store.health_document import HealthDocument, from_plain, to_plain
from positioner.store.health_file import HEALTH, PREVIOUS, HealthFile
from positioner.store.health_keeper import SAVE_AFTER_S, HealthKeeper
from positioner.store.health_messages import HealthReplaced, KeepHealth
from positioner.store.messages import Notice

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.store.client import TableWriterClient

STARTED = "2026-05-09T07:35:25Z"
_DAEMON = """
import sys
from itertools import count
from pathlib import Path
from store_helpers import opened
writer, _, _ = opened(Path(sys.argv[1]))
first = writer.health.found.sections.get("numbers", 0)
for number in count(first + 1):
    writer.keep_health({"numbers": number})
    writer.poll()
    print(number, flush=True)
"""


def document(number: int) -> HealthDocument:
    return HealthDocument(VALVE, STARTED, sections={"numbers": {"slips": number}, "friction": [0.25, None]})


def test_a_document_is_read_as_it_was_written(tmp_path: Path) -> None:
    saved = HealthFile(tmp_path, VALVE).save(document(3))
    assert HealthFile(tmp_path, VALVE).load() == saved == health_file.read(tmp_path)
    assert saved.saved > saved.started == STARTED
    assert saved.sections == document(3).sections


def test_a_directory_without_health_gives_a_new_one_without_a_notice(tmp_path: Path) -> None:
    file = HealthFile(tmp_path, VALVE)
    assert (file.load().sections, file.take_notices()) == ({}, ())
    with pytest.raises(StateError, match="holds no health of a valve yet"):
        health_file.read(tmp_path)


def test_every_damaged_byte_is_noticed_and_the_one_before_is_used(tmp_path: Path) -> None:
    HealthFile(tmp_path, VALVE).save(document(1))
    former = health_file.read(tmp_path)
    file = HealthFile(tmp_path, VALVE)
    file.load()
    file.save(document(2))
    whole = (tmp_path / HEALTH).read_bytes()
    for at in range(len(whole)):
        damaged = whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]
        (tmp_path / HEALTH).write_bytes(damaged)
        found = HealthFile(tmp_path, VALVE).load()
        assert found == former or _says_the_same(damaged, whole), at
    for length in range(len(whole) - 1):
        (tmp_path / HEALTH).write_bytes(whole[:length])
        assert HealthFile(tmp_path, VALVE).load() == former


def _says_the_same(damaged: bytes, whole: bytes) -> bool:
    """Return whether only the white space between values differs."""
    try:
        return bool(json.loads(damaged) == json.loads(whole))
    except ValueError:
        return False


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"valve": "FV-999"}, "does not fit its digest"),
        ({"schema": 2}, "another version wrote it"),
        ({"format": "x"}, "no health"),
    ],
)
def test_a_file_that_is_not_used_is_moved_aside_by_the_next_save_and_never_deleted(
    tmp_path: Path, change: dict[str, object], why: str
) -> None:
    text = json.dumps({**to_plain(document(1)), **change})
    (tmp_path / HEALTH).write_text(text, encoding="utf-8")
    file = HealthFile(tmp_path, VALVE)
    assert file.load().sections == {}
    notice, anew = file.take_notices()
    assert why in notice
    assert "start anew" in anew
    file.save(document(2))
    (aside,) = tmp_path.glob("health.damaged-*.json")
    assert aside.read_text(encoding="utf-8") == text
    assert health_file.read(tmp_path).sections == document(2).sections


def test_the_health_of_another_valve_is_not_used(tmp_path: Path) -> None:
    HealthFile(tmp_path, "FV-999").save(HealthDocument("FV-999", STARTED, sections={"numbers": 1}))
    file = HealthFile(tmp_path, VALVE)
    assert file.load().sections == {}
    assert "belongs to valve 'FV-999'" in file.take_notices()[0]


def test_a_file_that_somebody_puts_there_meanwhile_is_moved_aside(tmp_path: Path) -> None:
    file = HealthFile(tmp_path, VALVE)
    file.save(file.load())
    (tmp_path / "other").write_text("a spreadsheet", encoding="utf-8")
    (tmp_path / "other").rename(tmp_path / HEALTH)
    file.save(document(2))
    (aside,) = tmp_path.glob("health.unexpected-*.json")
    assert aside.read_text(encoding="utf-8") == "a spreadsheet"


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_what_is_no_plain_file_is_neither_waited_for_nor_followed(tmp_path: Path, kind: str) -> None:
    path, elsewhere = tmp_path / HEALTH, tmp_path / "elsewhere"
    elsewhere.write_text(json.dumps(to_plain(document(1))), encoding="utf-8")
    match kind:
        case "link":
            path.symlink_to(elsewhere)
        case "pipe":
            os.mkfifo(path)
        case _:
            path.mkdir()
    file = HealthFile(tmp_path, VALVE)
    assert file.load().sections == {}
    file.save(document(2))
    assert stat.S_ISREG((tmp_path / HEALTH).lstat().st_mode)
    assert health_file.read(tmp_path).sections == document(2).sections


@pytest.mark.parametrize("fails", range(3))
def test_a_save_that_ends_between_its_renames_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: int
) -> None:
    file = HealthFile(tmp_path, VALVE)
    file.load()
    former = file.save(document(1))
    rename, calls = os.rename, iter(range(9))

    def torn(*arguments: object, **options: object) -> None:
        if next(calls) == fails:
            raise KeyboardInterrupt
        rename(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "rename", torn)
    with pytest.raises(KeyboardInterrupt):
        file.save(document(2))
    monkeypatch.undo()
    found = HealthFile(tmp_path, VALVE).load()
    assert found == former if fails < 2 else found.sections == document(2).sections


def keeper(folder: Path) -> HealthKeeper:
    file = HealthFile(folder, VALVE)
    return HealthKeeper(file, file.load())


def test_the_first_sections_are_saved_at_once_and_later_ones_every_ten_minutes(tmp_path: Path) -> None:
    one = keeper(tmp_path)
    assert one.due_in(1000.0) is None
    saves = []
    for second in range(1000, 3000, 5):
        one.take(KeepHealth(0, {"numbers": second}))
        before = one.document.saved, one._is_saved
        one.work(float(second))
        saves += [second] if one._is_saved and not before[1] else []
    assert saves == [1000, 1600, 2200, 2800]
    assert SAVE_AFTER_S == 600.0
    one.finish()
    assert health_file.read(tmp_path).sections == {"numbers": 2995}


def test_a_full_disk_is_told_once_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = keeper(tmp_path)
    one.take(KeepHealth(0, {"numbers": 1}))

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    told = [line for second in range(0, 120, 10) for line in one.work(float(second))]
    assert told == ["the health of the valve cannot be saved: No space left on device; free some space on the disk"]
    assert one.due_in(100.0) == 20.0
    monkeypatch.undo()
    assert one.work(120.0) == ("the health of the valve is saved again",)
    assert health_file.read(tmp_path).sections == {"numbers": 1}


def test_sections_that_json_cannot_hold_are_not_saved(tmp_path: Path) -> None:
    one = keeper(tmp_path)
    one.take(KeepHealth(0, {"numbers": float("nan")}))
    (line,) = one.work(0.0)
    assert "cannot be saved" in line


def test_a_reset_backs_up_and_what_was_counted_before_it_never_comes_back(tmp_path: Path) -> None:
    one = keeper(tmp_path)
    one.take(KeepHealth(0, {"numbers": 7, "friction": 1.5}))
    backup = one.reset(("numbers",), {})
    assert from_plain(json.loads((tmp_path / backup).read_text("utf-8"))).sections == {"numbers": 7, "friction": 1.5}
    one.take(KeepHealth(0, {"numbers": 8, "friction": 1.5}))
    one.finish()
    assert health_file.read(tmp_path).sections == {"friction": 1.5}
    one.take(KeepHealth(1, {"numbers": 1, "friction": 1.5}))
    one.finish()
    assert health_file.read(tmp_path).sections == {"numbers": 1, "friction": 1.5}


def test_a_daemon_that_is_killed_loses_nothing_that_it_had_handed_over(tmp_path: Path) -> None:
    last = 0
    for milliseconds in (10, 100, 200):
        with python("-c", _DAEMON, tmp_path) as daemon:
            assert daemon.stdout
            first = daemon.stdout.readline()
            assert int(first) == last + 1, "goes on where the last one was killed"
            signal.sigtimedwait([], milliseconds / 1e3)
            daemon.kill()
            handed_over = int((first + daemon.stdout.read()).split()[-1])
        with lock.held(tmp_path, 10.0):  # its table writer saves, then releases the lock
            last = health_file.read(tmp_path).sections["numbers"]
        # what finds the channel full is not sent: the next one holds it
        assert 0 < last <= handed_over + 1


def test_a_table_writer_that_is_killed_gets_the_sections_again(tmp_path: Path) -> None:
    writer, _, _ = opened(tmp_path)
    writer.keep_health({"numbers": 41})
    wait_for(writer, (tmp_path / HEALTH).exists)
    writer.keep_health({"numbers": 42})
    os.kill(writer._child.process.pid, signal.SIGKILL)
    wait_for(writer, lambda: writer.problem is not None)
    wait_for(writer, lambda: writer.saved)
    assert writer.close(10.0) is None
    assert health_file.read(tmp_path).sections == {"numbers": 42}
    assert (tmp_path / PREVIOUS).exists()


def test_the_command_line_reads_what_the_daemon_has_and_resets_it(tmp_path: Path, writer: TableWriterClient) -> None:
    writer.keep_health({"numbers": 41})
    wait_for(writer, (tmp_path / HEALTH).exists)
    writer.keep_health({"numbers": 42})
    assert access.health(tmp_path).sections == {"numbers": 42}
    assert "before-health-reset" in access.reset_health(tmp_path, ("numbers",))
    events = wait_for(writer, lambda: writer.health.found.generation == 1)
    assert HealthReplaced(1, {}) in events
    assert access.health(tmp_path).sections == {}


def test_without_a_daemon_the_command_line_works_on_the_files(tmp_path: Path) -> None:
    HealthFile(tmp_path, VALVE).save(document(5))
    assert access.health(tmp_path).sections == document(5).sections
    access.reset_health(tmp_path, ("numbers",))
    after = access.health(tmp_path)
    assert (after.sections, after.generation) == ({"friction": [0.25, None]}, 1)
    assert after.started > STARTED


def test_a_notice_about_a_damaged_file_reaches_the_daemon(tmp_path: Path) -> None:
    (tmp_path / HEALTH).write_text("{", encoding="utf-8")
    writer, _, notices = opened(tmp_path)
    assert any(HEALTH in notice for notice in notices)
    writer.keep_health({"numbers": 1})
    events = wait_for(writer, lambda: bool(list(tmp_path.glob("health.damaged-*"))))
    events += wait_for(writer, lambda: True)
    assert writer.close(10.0) is None
    assert all(isinstance(event, Notice) for event in events if "health" in str(event))
