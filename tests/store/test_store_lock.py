from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from positioner.errors import AlreadyRunningError, ExitCode, StateError
from positioner.store import lock

_HOLDER = """
import sys
import threading
from pathlib import Path
from positioner.store import lock
with lock.held(Path(sys.argv[1]), 0.0):
    print("held", flush=True)
    sys.stdin.readline()
"""


def test_a_second_holder_is_refused_in_one_line_that_names_the_first(tmp_path: Path) -> None:
    with (
        lock.held(tmp_path, 0.0),
        pytest.raises(AlreadyRunningError, match=rf"^{tmp_path}: in use by process {os.getpid()}; stop it, or [^\n]*$"),
    ):
        lock.acquire(tmp_path, 0.0)
    with lock.held(tmp_path, 0.0):
        pass


def test_the_lock_waits_for_a_holder_that_ends(tmp_path: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLDER, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert holder.stdin
    assert holder.stdout
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(AlreadyRunningError, match=f"in use by process {holder.pid};"):
        lock.acquire(tmp_path, 0.0)
    end = threading.Timer(0.2, holder.stdin.close)  # it ends while it is waited for, no sooner
    os.close(lock.acquire(tmp_path, 60.0, lambda _: end.start()))
    end.join()
    holder.stdout.close()
    assert holder.wait() == 0


def test_a_lock_that_is_held_ends_a_start_with_a_status_that_is_tried_again(tmp_path: Path) -> None:
    reports: list[str] = []
    with lock.held(tmp_path, 0.0), pytest.raises(AlreadyRunningError) as caught:
        lock.acquire(tmp_path, 0.1, reports.append)
    assert reports == [f"waiting 0.1 s at most: {caught.value}"]
    assert caught.value.exit_code is ExitCode.TEMPORARY
    unit = (Path(__file__).resolve().parents[2] / "systemd" / "positioner@.service").read_text(encoding="utf-8")
    (kept_down,) = re.findall(r"^RestartPreventExitStatus=(.*)$", unit, re.MULTILINE)
    assert str(int(caught.value.exit_code)) not in kept_down.split()


def test_the_lock_lasts_until_the_last_copy_of_its_descriptor_is_closed(tmp_path: Path) -> None:
    descriptor = lock.acquire(tmp_path, 0.0)
    copy = os.dup(descriptor)
    os.close(descriptor)
    with pytest.raises(AlreadyRunningError):
        lock.acquire(tmp_path, 0.0)
    os.close(copy)
    os.close(lock.acquire(tmp_path, 0.0))


def test_locking_leaves_no_trace_in_the_directory(tmp_path: Path) -> None:
    with lock.held(tmp_path, 0.0):
        assert list(tmp_path.iterdir()) == []


def test_what_is_no_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StateError, match="cannot be opened: Not a directory"):
        lock.acquire(tmp_path / "file", 0.0)
    with pytest.raises(StateError, match="cannot be opened: No such file or directory"):
        lock.acquire(tmp_path / "nothing", 0.0)
