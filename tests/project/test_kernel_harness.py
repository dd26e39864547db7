"""What the kernel tests say of a kernel that never came to a test, and what they do without user-mode Linux."""

from __future__ import annotations

import shlex
import shutil
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from harness import boot, dispatch, emulated, fleet, preload, user_mode
from harness.packages import CannotFetchError
from harness.plan import BEGAN, INSIDE, KINDS, PROJECT, RESULTS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from harness.plan import Kind

pytest_plugins = ("pytester",)
RECORDED = PROJECT / "tests/kernel/recorded"
REASONS = {
    "user_mode_amx": "the processor has registers that this user-mode Linux does not know (AMX): "
    "'userspace - ptrace set fp regs failed, errno = 14'",
    "user_mode_no_ptrace": "this machine forbids one process to trace another: 'ptrace: Operation not permitted'",
    "user_mode_small_shm": "this machine has too little memory left for the kernel: "
    "'Bus error - the host /dev/shm or /tmp mount likely just ran out of space'",
    "user_mode_no_memory": "this machine has too little memory left for the kernel: "
    "'setup_physmem - mapping 1591853056 bytes of memory at 0x(____ptrval____) failed - errno = -12'",
    "user_mode_no_init": "Kernel panic - not syncing: Requested init /nonexist failed (error -2).",
    "qemu_no_memory": "this machine has too little memory left for the kernel: "
    "\"qemu-system-x86_64: cannot set up guest memory 'pc.ram': Cannot allocate memory\"",
    "qemu_no_root": "Kernel panic - not syncing: VFS: Unable to mount root fs on unknown-block(0,0)",
}


def recorded(name: str) -> Path:
    return RECORDED / f"{name}.txt"


@pytest.mark.parametrize("name", sorted(path.stem for path in RECORDED.iterdir()))
def test_the_reason_of_every_recorded_failure_to_boot_is_one_line(name: str) -> None:
    assert boot.why_it_ended(recorded(name).read_text(encoding="utf-8")) == REASONS[name]


def test_without_a_known_reason_the_last_line_of_the_console_is_given() -> None:
    assert boot.why_it_ended("booting\nenv: no such file\n\n") == "it ended with 'env: no such file'"
    assert boot.why_it_ended("") == "it said nothing"


@pytest.mark.parametrize("compiler", [name for name in preload.COMPILERS if shutil.which(name)])
def test_the_preloaded_library_is_made_by_each_compiler_of_this_machine(
    compiler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preload, "COMPILERS", (compiler,))
    made = preload.library(tmp_path, fetch=lambda *_: pytest.fail("fetched a compiler though one is here"))
    assert made is not None
    assert made.read_bytes().startswith(b"\x7fELF")
    assert preload.library(tmp_path) == made


def test_without_any_compiler_the_kernel_is_tried_without_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cannot_fetch(*_: object) -> Path:
        raise CannotFetchError("no network")

    monkeypatch.setattr(preload, "COMPILERS", ("no-such-compiler",))
    assert preload.library(tmp_path, cannot_fetch) is None


class Engines:
    """Engines that play a recorded console, or run the tests at once, and note what they were asked to run."""

    def __init__(self, *, user_mode: str, emulated: str = "") -> None:
        self.user_mode_says, self.emulated_says = user_mode, emulated
        self.asked: list[tuple[str, list[str]]] = []

    def user_mode(self, kind_name: str, kind: Kind, out: Path, tests: Sequence[str]) -> list[str]:
        return self._command(kind_name, kind, out, tests, self.user_mode_says)

    def emulated(self, kind_name: str, kind: Kind, out: Path, tests: Sequence[str]) -> list[str]:
        return self._command(kind_name, kind, out, tests, self.emulated_says)

    def _command(self, kind_name: str, kind: Kind, out: Path, tests: Sequence[str], says: str) -> list[str]:
        self.asked.append(("QEMU" if kind.emulated else "user mode", list(tests)))
        if says:
            return ["cat", str(recorded(says))]
        run = [sys.executable, "-m", "pytest", "-p", "harness.inside", "-p", "no:cacheprovider", *tests]
        settings = [
            f"{INSIDE}={kind_name}",
            f"{RESULTS}={out}/results.jsonl",
            f"PYTHONPATH={PROJECT}/tests/kernel",
        ]
        play = f"echo 6.1 > {out}/{BEGAN}; {shlex.join(['env', *settings, *run])} > {out}/pytest.log 2>&1"
        return ["sh", "-c", play if tests else f"echo 6.1 > {out}/{BEGAN}"]


TESTS = """
import pytest
pytestmark = pytest.mark.kernel("vcan")

@pytest.mark.short_form
def test_short(): pass

def test_long(): pass
"""


def play(pytester: pytest.Pytester, engines: Engines, monkeypatch: pytest.MonkeyPatch) -> tuple[int, str]:
    """Return the exit status and the output of a session with two tests for a kernel."""
    monkeypatch.setattr(user_mode, "command", engines.user_mode)
    monkeypatch.setattr(emulated, "command", engines.emulated)
    monkeypatch.setattr(fleet, "CACHE", pytester.path / "cache")
    monkeypatch.setattr(dispatch, "host_has_vcan", lambda: False)
    pytester.makepyfile(test_two=TESTS)
    pytester.makeini("[pytest]\nmarkers =\n    kernel(kind): its kernel\n    short_form: runs in QEMU, too\n")
    result = pytester.runpytest_inprocess(plugins=[dispatch.Dispatcher(only_qemu=False)])
    return int(result.ret), "\n".join([*result.outlines, *result.errlines])


def test_where_user_mode_linux_runs_it_runs_everything_and_the_summary_says_so(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    engines = Engines(user_mode="")
    status, said = play(pytester, engines, monkeypatch)
    assert status == 0, said
    assert {engine for engine, _ in engines.asked} == {"user mode"}
    assert "user-mode Linux 6.1: 2 vcan" in said
    assert "2 passed" in said


def test_where_user_mode_linux_panics_qemu_runs_the_short_form_and_the_summary_says_why(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    engines = Engines(user_mode="user_mode_amx")
    status, said = play(pytester, engines, monkeypatch)
    assert status == 0, said
    assert [tests for engine, tests in engines.asked if engine == "QEMU"] == [["test_two.py::test_short"]]
    assert "1 passed, 1 deselected" in said
    assert "QEMU 6.1: 1 vcan" in said
    why = f"short form in QEMU (left out: 1) since {REASONS['user_mode_amx']}"
    assert f"{why}\nleft out: test_two.py::test_long" in said


def test_a_kernel_that_panics_before_its_first_test_is_no_test_that_failed(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    engines = Engines(user_mode="user_mode_amx", emulated="qemu_no_root")
    status, said = play(pytester, engines, monkeypatch)
    assert status == 3, said
    assert "failed," not in said
    line = f"the kernel for vcan-test_two (QEMU) ended before its first test: {REASONS['qemu_no_root']}"
    assert f"Exit: {line}" in said


def test_a_kernel_whose_tests_take_too_long_is_ended_and_its_tests_fail_without_another_try(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    engines = Engines(user_mode="")
    endless = replace(KINDS["vcan"], timeout_s=0.0)
    monkeypatch.setattr(dispatch, "KINDS", {**KINDS, "vcan": endless})
    monkeypatch.setattr(fleet, "why_user_mode_cannot_run", lambda _kind: "")
    monkeypatch.setattr(fleet.Guest, "kernel", "6.1")  # it came as far as its tests
    status, said = play(pytester, engines, monkeypatch)
    assert status == 1, said
    assert [tests for _, tests in engines.asked if tests] == [["test_two.py::test_short", "test_two.py::test_long"]]
    assert "2 failed" in said
    assert "its tests were not over after 0 s" in said


def test_a_selection_of_which_nothing_can_run_is_not_green(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "TESTS", TESTS.replace("@pytest.mark.short_form", ""))
    status, said = play(pytester, Engines(user_mode="user_mode_no_ptrace"), monkeypatch)
    assert status == 3, said
    assert "no test ran: none of these is in the short form for QEMU" in said


def test_every_kind_of_kernel_has_a_form_for_qemu() -> None:
    assert all(kind.in_qemu().emulated for kind in KINDS.values())
