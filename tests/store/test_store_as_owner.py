"""Root and a state directory of somebody else: what root may be made to do there, and what it still can do."""

from __future__ import annotations

import os
import subprocess
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING

import pytest
from store_helpers import VALVE, WIDTH_M, opened, python, series, taught
from test_store_hostile import hot_journal

from positioner.cli.main import main
from positioner.errors import ExitCode, StateError
from positioner.store import access, as_owner, database, messages
from positioner.store.file_check import Fault, TableRejectedError
from positioner.store.health_document import HealthDocument
from positioner.store.health_file import HealthFile
from positioner.store.table_directory import BACKUPS, GOOD_COPY, TABLE

if TYPE_CHECKING:
    from pathlib import Path

IS_ROOT = os.geteuid() == 0
OWNER = 65534 if IS_ROOT else os.geteuid()


def give_away(directory: Path) -> None:
    """Make the directory and all in it somebody else's, where this user may."""
    for path in (directory, *directory.rglob("*")):
        os.chown(path, OWNER, -1, follow_symlinks=False)


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """A state directory of another user, below one that this user cannot enter, as systemd's are."""
    directory = tmp_path / "private" / "fv101"
    directory.mkdir(parents=True)
    database.create(directory / TABLE, taught(series(40)))
    database.create(directory / GOOD_COPY, taught(series(30)))
    give_away(directory)
    directory.parent.chmod(0o700)
    return directory


def test_root_reads_and_replaces_the_table_as_its_owner(state: Path) -> None:
    assert as_owner.is_needed(state) is IS_ROOT
    assert access.dump(state) == taught(series(40))
    backup = access.reset(state)
    assert backup is not None
    assert backup.startswith(f"{state}/{BACKUPS}/before-reset-")
    assert access.replace(state, taught(series(50)), force=False) is None
    assert access.dump(state).table == taught(series(50)).table
    assert {path.stat().st_uid for path in state.rglob("*")} == {OWNER}


def test_root_reads_and_resets_the_health_as_its_owner(state: Path) -> None:
    HealthFile(state, VALVE).save(HealthDocument(VALVE, "2026-05-09T07:35:25Z", sections={"numbers": 7}))
    give_away(state)
    assert access.health(state).sections == {"numbers": 7}
    assert access.reset_health(state, ("numbers",)).startswith(f"{state}/{BACKUPS}/before-health-reset-")
    assert access.health(state).sections == {}
    assert {path.stat().st_uid for path in state.rglob("*")} == {OWNER}


@pytest.mark.parametrize("arguments", [["dump"], ["reset", "--yes"], ["export", "x.json"], ["import", "given.json"]])
def test_no_command_of_root_deletes_what_a_planted_journal_names(
    state: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    main(["table", "export", "given.json", "--state", str(state)])
    victim = tmp_path / "victim"
    victim.write_text("precious")
    hot_journal(state / TABLE, victim)
    give_away(state)
    main(["table", *arguments, "--state", str(state)])
    assert not IS_ROOT or victim.read_text() == "precious"


@pytest.mark.parametrize("name", [BACKUPS, f"{TABLE}.new"])
def test_no_command_of_root_writes_where_a_planted_link_points(state: Path, tmp_path: Path, name: str) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (state / name).symlink_to(elsewhere if name == BACKUPS else elsewhere / "file")
    give_away(state)
    with suppress(StateError):
        access.reset(state)
    assert not IS_ROOT or list(elsewhere.iterdir()) == []


def test_what_the_owner_finds_is_reported_with_the_true_path(state: Path) -> None:
    (state / TABLE).unlink()
    (state / GOOD_COPY).unlink()
    with pytest.raises(TableRejectedError, match="does not exist") as caught:
        access.dump(state)
    assert (caught.value.path, caught.value.fault) == (state / TABLE, Fault.MISSING)
    refused = as_owner.ask(state, messages.Close())  # type: ignore[arg-type]
    assert isinstance(refused, messages.Refused | messages.Rejected)


def test_root_does_not_keep_the_table_of_somebody_else(state: Path) -> None:
    why = f"belongs to user {OWNER}; start the positioner as that user"
    with pytest.raises(StateError, match=why) if IS_ROOT else nullcontext():
        writer, _, _ = opened(state)
        writer.close(10.0)


def test_the_table_writer_imports_nothing_from_the_current_directory(tmp_path: Path) -> None:
    for name in ("select.py", "json.py", "positioner.py"):
        (tmp_path / name).write_text("raise SystemExit('imported from the current directory')\n")
    script = (
        "import os, sys; from pathlib import Path; from positioner.store.client import TableWriterClient\n"
        "os.environ['PYTHONPATH'] = os.pathsep + os.environ['PYTHONPATH']  # an empty entry: the current directory\n"
        f"writer, _, _ = TableWriterClient.open(Path(sys.argv[1]), {VALVE!r}, {WIDTH_M})\n"
        "sys.exit(writer.close(10.0))\n"
    )
    child = python("-P", "-c", script, tmp_path / "state", cwd=tmp_path, stderr=subprocess.STDOUT)
    output, _ = child.communicate()
    assert (child.returncode, output) == (0, "")


def test_the_table_writer_works_with_all_standard_streams_closed(tmp_path: Path) -> None:
    script = (
        "import os, sys; from pathlib import Path; from positioner.store.client import TableWriterClient\n"
        "os.closerange(0, 3)\n"
        f"writer, _, _ = TableWriterClient.open(Path(sys.argv[1]), {VALVE!r}, {WIDTH_M})\n"
        "from store_helpers import series; writer.record(series(20))\n"
        "from positioner.store import lock\n"
        "held = lock.holder(Path(sys.argv[1])) == os.getpid() and os.path.exists(sys.argv[1] + '/control.sock')\n"
        "os._exit(0 if held and writer.close(10.0) is None else 1)\n"
    )
    child = python("-c", script, tmp_path / "state")
    child.communicate()
    assert child.returncode == ExitCode.OK
    assert access.dump(tmp_path / "state").table == taught(series(20)).table
