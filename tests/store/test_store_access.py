from __future__ import annotations

import codecs
import os
import socket
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from store_helpers import VALVE, opened, python, series, taught, wait_for

from positioner.errors import AlreadyRunningError, StateError
from positioner.store import access, control, database, document, lock
from positioner.store.messages import Replaced
from positioner.store.table_directory import GOOD_COPY, TABLE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.store.client import TableWriterClient
    from positioner.store.content import StoredTable

_NOBODY = 65534

_IMPORTER = """
import sys
from pathlib import Path
from positioner.store import access
directory = Path(sys.argv[1])
for _ in range(10):
    access.replace(directory, access.dump(directory), force=False)
"""


@pytest.fixture(params=["writer", "files"])
def directory(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    """A state directory with 40 samples, held by a table writer or by nobody."""
    writer, _, _ = opened(tmp_path)
    writer.record(series(40))
    if request.param == "files":
        assert writer.close(10.0) is None
        yield tmp_path
    else:
        yield tmp_path
        assert writer.close(10.0) is None


def _cells(stored: StoredTable) -> tuple[object, ...]:
    return stored.valve_id, stored.table


def test_a_dump_shows_what_was_learned(directory: Path) -> None:
    assert _cells(access.dump(directory)) == _cells(taught(series(40)))


def test_a_reset_empties_the_table_and_its_backup_brings_it_back(directory: Path) -> None:
    backup = access.reset(directory)
    assert backup
    assert len(access.dump(directory).table) == 0
    assert access.reset(directory) is None
    stored = document.loads(Path(backup).read_text(encoding="utf-8"), backup)
    assert access.replace(directory, stored, force=False) is None
    after = access.dump(directory)
    assert _cells(after) == _cells(taught(series(40)))
    assert after.recorded_s == stored.recorded_s
    assert after.generation == 3


def test_an_import_is_on_the_disk_and_in_the_good_copy_and_backs_up_what_it_replaces(directory: Path) -> None:
    backup = access.replace(directory, taught(series(7)), force=False)
    assert backup
    assert _cells(document.loads(Path(backup).read_text(encoding="utf-8"), "x")) == _cells(taught(series(40)))
    for name in (TABLE, GOOD_COPY):
        assert _cells(database.read(directory / name)) == _cells(taught(series(7)))


def test_another_valves_table_is_imported_by_force_only(directory: Path) -> None:
    other = taught(series(7), valve_id="FV-202")
    with pytest.raises(StateError, match="is of valve 'FV-202', this is 'FV-101'; --force takes it"):
        access.replace(directory, other, force=False)
    assert access.dump(directory).table.sequence == 40
    access.replace(directory, other, force=True)
    assert _cells(access.dump(directory)) == (VALVE, other.table)


def test_a_table_of_another_cell_width_is_never_imported(directory: Path) -> None:
    with pytest.raises(StateError, match=r"cells of 0\.004 m, this valve's are 0\.005 m wide: it cannot be converted"):
        access.replace(directory, taught(series(7), width_m=0.004), force=True)
    assert access.dump(directory).table.sequence == 40


def test_an_import_into_a_new_directory_makes_its_table(tmp_path: Path) -> None:
    assert access.replace(tmp_path, taught(series(7)), force=False) is None
    writer, table, notices = opened(tmp_path)
    assert (table, notices) == (taught(series(7)).table, ())
    writer.close(10.0)


def test_an_import_repairs_a_damaged_table_and_loses_nothing_of_it(tmp_path: Path) -> None:
    (tmp_path / TABLE).write_bytes(b"garbage")
    access.replace(tmp_path, taught(series(7)), force=False)
    assert _cells(access.dump(tmp_path)) == _cells(taught(series(7)))
    (aside,) = tmp_path.glob("stiction.damaged-*")
    assert aside.read_bytes() == b"garbage"


def test_there_is_nothing_to_dump_or_reset_in_a_new_directory(tmp_path: Path) -> None:
    for command in (access.dump, access.reset):
        with pytest.raises(StateError, match=rf"^{tmp_path}/{TABLE} does not exist$"):
            command(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_reset_without_a_daemon_changes_nothing(tmp_path: Path) -> None:
    access.replace(tmp_path, taught(series(7)), force=False)
    (tmp_path / "backups").touch()  # a file in the place of the directory
    with pytest.raises(StateError, match="nothing was changed, since the table cannot be saved: File exists"):
        access.reset(tmp_path)
    assert access.dump(tmp_path).table.sequence == 7


def test_imports_hammering_at_a_daemon_leave_daemon_table_writer_and_disk_with_the_same_table(tmp_path: Path) -> None:
    writer, table, _ = opened(tmp_path)
    importer = python("-c", _IMPORTER, tmp_path)
    number = replacements = 0
    while importer.poll() is None:
        (one,) = series(1, number)
        number += 1
        writer.record([one])
        table = table.learned(one)
        for event in writer.poll():
            if isinstance(event, Replaced):
                table = event.stored.table
                replacements += 1
    importer.communicate()
    assert importer.returncode == 0
    for event in wait_for(writer, lambda: writer.saved):
        if isinstance(event, Replaced):
            table = event.stored.table
            replacements += 1
    assert replacements == 10
    assert writer.close(10.0) is None
    assert database.read(tmp_path / TABLE).table == table


def test_commands_on_the_files_alone_wait_for_each_other(tmp_path: Path) -> None:
    access.replace(tmp_path, taught(series(7)), force=False)
    importers = [python("-c", _IMPORTER, tmp_path) for _ in range(3)]
    for importer in importers:
        importer.communicate()
        assert importer.returncode == 0
    assert access.dump(tmp_path).generation == 1 + 30
    assert len(list((tmp_path / "backups").iterdir())) == 30


def test_a_change_is_refused_while_the_directory_is_held_by_something_without_a_table_writer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    access.replace(tmp_path, taught(series(7)), force=False)
    monkeypatch.setattr(access, "_LOCK_TIMEOUT_S", 0.0)
    with lock.held(tmp_path, 0.0):
        with pytest.raises(AlreadyRunningError, match=f"in use by process {os.getpid()}"):
            access.reset(tmp_path)
        assert access.dump(tmp_path).table.sequence == 7


def test_a_table_writer_answers_nonsense_with_a_refusal_and_lives_on(tmp_path: Path, writer: TableWriterClient) -> None:
    descriptor = os.open(tmp_path, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(control.address(descriptor))
        client.sendall(b'nonsense\n{"kind": "Close"}\n{"kind": "ResetRequest", "stored": 1}\n[1]\n')
        with client.makefile("rb") as answers:
            kinds = [b'"kind": "Refused"' in answers.readline() for _ in range(4)]
    os.close(descriptor)
    assert kinds == [True] * 4
    writer.record(series(3))
    assert wait_for(writer, lambda: writer.saved)


@contextmanager
def _as_nobody() -> Iterator[None]:
    """Act as a user without rights; root may write anywhere."""
    if os.geteuid() != 0:
        yield
        return
    codecs.lookup("ascii")  # nobody may not read the interpreter's library where it lies below /root
    groups = os.getgroups()
    os.setgroups([])
    os.setegid(_NOBODY)
    os.seteuid(_NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(0)
        os.setgroups(groups)


@pytest.fixture
def read_only() -> Iterator[Path]:
    """A state directory that may only be read, and not below a directory that only its owner may enter."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        writer, _, _ = opened(place)
        writer.record(series(40))
        writer.close(10.0)
        place.chmod(0o555)
        yield place
        place.chmod(0o755)


def test_a_directory_that_may_only_be_read_can_be_dumped_but_not_reset(read_only: Path) -> None:
    before = sorted(path.name for path in read_only.iterdir())
    with _as_nobody():
        assert access.dump(read_only).table == taught(series(40)).table
        with pytest.raises(StateError, match=r"nothing was changed, .* make the state directory writable"):
            access.reset(read_only)
    assert sorted(path.name for path in read_only.iterdir()) == before


def test_a_crash_is_rolled_back_for_a_reader_of_a_read_only_directory(read_only: Path) -> None:
    read_only.chmod(0o755)
    with database.connect(read_only / TABLE) as connection:
        connection.execute("PRAGMA cache_size = 1")
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("UPDATE cells SET count = count + 1, samples = samples || hex(randomblob(500))")
        crashed = {path: path.read_bytes() for path in read_only.glob(f"{TABLE}*")}
        connection.rollback()
    connection.close()
    assert len(crashed) == 2
    for path, content in crashed.items():
        path.write_bytes(content)
    read_only.chmod(0o555)
    with _as_nobody():
        assert access.dump(read_only).table == taught(series(40)).table
    assert {path: path.read_bytes() for path in read_only.glob(f"{TABLE}*")} == crashed


def test_a_dump_by_somebody_without_a_way_to_the_table_writer_reads_the_last_transaction(read_only: Path) -> None:
    is_root = os.geteuid() == 0
    read_only.chmod(0o755)
    writer, _, _ = opened(read_only)
    writer.record(series(5, 40))
    wait_for(writer, lambda: writer.saved)
    with _as_nobody():
        assert access.dump(read_only).table.sequence == 45
        if is_root:
            with pytest.raises(StateError, match=r"control\.sock: Permission denied; become the daemon's user"):
                access.reset(read_only)
    assert writer.close(10.0) is None
