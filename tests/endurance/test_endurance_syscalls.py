"""The short form of `make syscall-test`, and what it counts and plans."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from endurance.struck_daemon import WAIT, Strike
from endurance.syscall_faults import FIRST, occasions, planned

TESTS = Path(__file__).resolve().parents[1]
TRACE = """\
openat(AT_FDCWD, "/usr/lib/python3.11/encodings/__pycache__/utf_8.cpython-311.pyc", O_RDONLY|O_CLOEXEC) = 3
close(3)                                = 0
newfstatat(AT_FDCWD, "/opt/positioner/start.py", {st_mode=S_IFREG|0644}, 0) = 0
openat(AT_FDCWD, "/opt/positioner/__pycache__/start.cpython-311.pyc", O_RDONLY|O_CLOEXEC) = 3
close(3)                                = 0
openat(AT_FDCWD, "/opt/positioner/cli/main.py", O_RDONLY|O_CLOEXEC) = 3
brk(NULL)                               = 0x55d0
+++ exited with 0 +++
"""


def test_what_is_counted_comes_after_the_first_line_of_our_own_code() -> None:
    assert occasions(TRACE) == {"brk": range(1, 2), "openat": range(3, 4)}


def test_the_first_five_occasions_and_twenty_more_are_struck_with_every_fault_in_turn() -> None:
    strikes = planned({"read": range(10, 1000), "brk": range(1, 3)}, random.Random(1), short=False)  # noqa: S311
    reads = [strike for strike in strikes if strike.call == "read"]
    assert [strike.occasion for strike in reads[:FIRST]] == [10, 11, 12, 13, 14]
    assert len({strike.occasion for strike in reads}) == 25
    assert {strike.fault for strike in reads[:FIRST]} == {"ENOMEM", "EIO", "ENOSPC", "EMFILE", WAIT}
    assert [strike for strike in strikes if strike.call == "brk"] == [Strike("brk", n, WAIT) for n in (1, 2)]


@pytest.mark.slow(short="test_the_first_five_occasions_and_twenty_more_are_struck_with_every_fault_in_turn")
@pytest.mark.bus
def test_no_call_that_fails_once_silences_a_daemon_or_ends_it_in_a_traceback() -> None:
    command = [sys.executable, "-m", "endurance.syscall_faults", "--short"]
    paths = f"{TESTS}:{TESTS / 'kernel'}:{TESTS.parent}"
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
