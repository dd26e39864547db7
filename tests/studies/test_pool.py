"""The pool of workers: results with their items, one line when a worker dies, nothing left when it is stopped.

Started as a program, this file is a pool whose parent is interrupted: an interrupt reaches a whole process, and must
not reach the process that runs the tests.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from contextlib import closing
from multiprocessing import active_children
from threading import Event

import pytest

from positioner.errors import BenchError, UsageError
from positioner.studies.pool import Workers, spread_out


def interrupt_the_parent(_: int) -> None:
    for _ in range(120):  # an interrupt that comes inside a callback of the interpreter's own is lost
        os.kill(os.getppid(), signal.SIGINT)
        Event().wait(5.0)  # work whose result is not needed any more


def kill_the_parent(_: int) -> None:
    os.kill(os.getppid(), signal.SIGKILL)
    Event().wait(600.0)


def die(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_every_item_comes_back_with_its_result() -> None:
    assert dict(spread_out(math.factorial, (3, 4, 5), Workers(2))) == {3: 6, 4: 24, 5: 120}


def test_an_interrupt_ends_the_workers_in_the_middle_of_their_work() -> None:
    program = [sys.executable, __file__]
    done = subprocess.run(program, check=False, capture_output=True, text=True, timeout=300.0)  # of three times 600
    assert done.stdout == "interrupted, 0 workers left\n", done.stderr


def test_the_suite_receives_an_interrupt_though_a_script_started_it_in_the_background() -> None:
    shell = f"trap '' INT; exec {sys.executable} -m pytest -q -p no:cacheprovider {__file__} -k is_not_ignored"
    done = subprocess.run(["sh", "-c", shell], check=False, capture_output=True, text=True, timeout=300.0)
    assert "1 passed" in done.stdout, done.stdout


def test_an_interrupt_is_not_ignored() -> None:
    assert signal.getsignal(signal.SIGINT) is not signal.SIG_IGN


def test_a_worker_that_is_killed_is_one_line() -> None:
    with pytest.raises(BenchError, match="a worker was killed"):
        list(spread_out(die, (1,), Workers(1)))


def test_the_workers_of_a_parent_that_is_killed_end_in_the_middle_of_their_work() -> None:
    program = [sys.executable, __file__, "killed"]
    # its output ends with the last process that holds it
    done = subprocess.run(program, check=False, capture_output=True, text=True, timeout=300.0)  # of three times 600
    assert (done.returncode, done.stdout) == (-signal.SIGKILL, ""), done.stderr


def test_no_workers_at_all_are_refused() -> None:
    with pytest.raises(UsageError, match="--workers 0"):
        list(spread_out(math.factorial, (1,), Workers(0)))


def main() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    try:
        work = kill_the_parent if "killed" in sys.argv else interrupt_the_parent
        with closing(spread_out(work, (1, 2, 3), Workers(1))) as results:
            list(results)
    except KeyboardInterrupt:
        sys.stdout.write(f"interrupted, {len(active_children())} workers left\n")


if __name__ == "__main__":
    main()
