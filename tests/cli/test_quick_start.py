"""The quick start of the README, command by command, as its reader types it."""

from __future__ import annotations

import os
import re
import secrets
import shlex
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import TIMEOUT_S

from positioner.config.reader import load_config

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.bus
ROOT = Path(__file__).resolve().parents[2]
SECTION = (ROOT / "README.md").read_text(encoding="utf-8").split("\n## Quick start\n")[1].split("\n## ")[0]
BLOCKS = re.findall(r"^```sh\n(.*?)^```$", SECTION, flags=re.DOTALL | re.MULTILINE)
EXAMPLE = "examples/fv101.toml"
BIN = Path(sys.executable).parent
DISARMED = (
    "another host has disarmed the positioner: no more setpoints are sent; "
    "a new `positioner host` with `arm` arms it again"
)


class Walk:
    """The commands of the quick start on a bus of this test's own, on a machine that may be slow."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.channel = f"walk{secrets.token_hex(8)}"
        text = (ROOT / EXAMPLE).read_text(encoding="utf-8")
        assert text.count('channel = "fv101"') == 1
        text = text.replace('channel = "fv101"', f'channel = "{self.channel}"')
        self.config = folder / "fv101.toml"
        longer, times = re.subn(r"(feedback_\w+_periods) = (\d+)", r"\1 = \g<2>0", text)
        assert times == 2
        self.config.write_text(longer, encoding="utf-8")

    def command(self, line: str) -> list[str]:
        """Return the words of a line of the README, with this test's programs, bus and file in their places."""
        line = line.replace(EXAMPLE, str(self.config)).replace("embedded:fv101", f"embedded:{self.channel}")
        program, *arguments = shlex.split(line)
        assert program.startswith(".venv/bin/"), line
        return [str(BIN / program.removeprefix(".venv/bin/")), *arguments]

    @contextmanager
    def running(self, line: str, name: str, stdin: int = subprocess.DEVNULL) -> Iterator[subprocess.Popen[bytes]]:
        """Run a command beside the test, its output in a file."""
        environment = {**os.environ, "XDG_STATE_HOME": str(self.folder / "home")}
        with (self.folder / name).open("wb") as log:
            child = subprocess.Popen(self.command(line), stdin=stdin, stdout=log, stderr=log, env=environment)
        try:
            yield child
        finally:
            if child.poll() is None:
                child.terminate()
            child.wait(TIMEOUT_S)

    def output_of(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8")

    def wait_until_printed(self, name: str, words: str) -> None:
        deadline_s = time.monotonic() + TIMEOUT_S
        while words not in self.output_of(name):
            assert time.monotonic() < deadline_s, [path.read_text() for path in sorted(self.folder.glob("[0-9]"))]
            time.sleep(0.05)

    def done(self, line: str) -> tuple[int, str]:
        """Run a command to its end; return its status and its output."""
        done = subprocess.run(
            self.command(line), capture_output=True, text=True, timeout=TIMEOUT_S, check=False, env=os.environ
        )
        return done.returncode, done.stdout + done.stderr


@pytest.fixture
def walk(tmp_path: Path) -> Walk:
    return Walk(tmp_path)


def test_the_quick_start_is_three_commands_in_three_terminals_and_two_to_look_and_to_end() -> None:
    assert [len(block.splitlines()) for block in BLOCKS] == [1, 1, 1, 2]
    assert load_config(ROOT / EXAMPLE).bus.is_embedded


def _refused_nothing(status: str) -> bool:
    """Return whether no frame was refused; where the machine was too busy for all frames, nothing can be said."""
    starved = re.search("frame lost|late cycle", status)
    return bool(starved or re.search(r"^counters  learned \d+, refused 0, ", status, re.MULTILINE))


def test_a_reader_of_the_quick_start_moves_a_valve_and_ends_it(walk: Walk) -> None:
    plant, positioner, host, afterwards = BLOCKS
    status, disarm = afterwards.splitlines()
    with ExitStack() as terminals:
        terminals.enter_context(walk.running(plant, "1"))
        terminals.enter_context(walk.running(positioner, "2"))
        walk.wait_until_printed("2", "READY (waiting for arm)")
        child = terminals.enter_context(walk.running(host, "3"))
        walk.wait_until_printed("3", "setpoint 78.74 mm (62.00 %)")
        walk.wait_until_printed("3", "ACTIVE: controls the valve")
        assert child.poll() is None

        code, output = walk.done(status)
        assert code == 0
        assert re.search(r"^armed     yes$", output, re.MULTILINE)
        assert _refused_nothing(output)
        assert re.search(r"^setpoint  78\.74 mm", output, re.MULTILINE)
        assert re.search(r"^current   \d+\.\d{3} mA$", output, re.MULTILINE)

        code, output = walk.done(disarm)
        assert code == 0
        assert output.splitlines()[-1] == "disarmed: the positioner commands nothing"
        assert child.wait(TIMEOUT_S) == 0
        assert walk.output_of("3").splitlines()[-1] == DISARMED
        code, output = walk.done(status)
        assert code == 0
        assert re.match(r"mode      READY: disarmed \(NE 107: function check\)\narmed     no\n", output)
        assert _refused_nothing(output)

        again = terminals.enter_context(walk.running(host, "4"))
        walk.wait_until_printed("4", "ACTIVE: controls the valve")
        again.send_signal(signal.SIGKILL)
        walk.wait_until_printed("2", "HOLD (setpoint stale)")
        code, output = walk.done(disarm)
        assert code == 0
        assert output.splitlines()[-1] == "disarmed: the positioner commands nothing"
    logged = "".join(walk.output_of(name) for name in "1234")
    for trouble in ("refused", "dispute", "out of order", "another host sends", "another controller"):
        # a machine that is too busy loses frames, and then says so
        assert trouble not in logged or re.search("lost on the bus|a cycle took|stood still", logged), logged


def test_the_status_tells_a_positioner_that_was_never_armed_from_none(walk: Walk) -> None:
    plant, positioner, _, afterwards = BLOCKS
    status = afterwards.splitlines()[0]
    with ExitStack() as terminals:
        terminals.enter_context(walk.running(plant, "1"))
        deadline_s, output = time.monotonic() + TIMEOUT_S, ""
        while "`positioner run` does not run on this bus with this configuration" not in output:
            assert time.monotonic() < deadline_s, output
            code, output = walk.done(status)
            assert code == 1
        terminals.enter_context(walk.running(positioner, "2"))
        walk.wait_until_printed("2", "READY (waiting for arm)")
        code, output = walk.done(status)
        assert code == 0
        assert re.match(r"mode      READY: waits to be armed \(NE 107: function check\)\narmed     no\n", output)


def test_a_person_at_a_terminal_types_verbs_and_sees_mistakes_reported(walk: Walk) -> None:
    plant, positioner, host, _ = BLOCKS
    read, write = os.pipe()
    with ExitStack() as terminals:
        terminals.enter_context(walk.running(plant, "1"))
        terminals.enter_context(walk.running(positioner, "2"))
        walk.wait_until_printed("2", "READY (waiting for arm)")
        child = terminals.enter_context(walk.running(host.partition(" arm")[0], "3", read))
        os.close(read)
        for typed, words in (
            ("sett 80", "'sett' is no verb of the host; did you mean 'set'?"),
            ("set 200", "200 mm is outside the travel"),
            ("arm", "ACTIVE: controls the valve"),
            ("manual 9.5mA", "MANUAL: the current is given by hand"),
            ("set 80", "use `auto` first"),
            ("status", "current   9.500 mA"),
        ):
            os.write(write, f"{typed}\n".encode())
            walk.wait_until_printed("3", words)
        os.write(write, b"auto\nset 80\nstatus")
        os.close(write)
        assert child.wait(TIMEOUT_S) == 0
    output = walk.output_of("3")
    assert "setpoint 80.00 mm" in output
    assert output.count("counters ") == 2
    assert output.splitlines()[-1].startswith("no more setpoints are sent: the positioner holds within 0.5 s")


def test_a_terminal_is_prompted_and_a_signal_ends_the_host(walk: Walk) -> None:
    keyboard, screen = os.openpty()
    with walk.running(BLOCKS[2].partition(" arm")[0], "3", screen) as child:
        walk.wait_until_printed("3", "status         show mode, health")
        walk.wait_until_printed("3", "\n> ")
        os.write(keyboard, b"disarm\n")
        walk.wait_until_printed("3", "disarmed: the positioner commands nothing")
        child.send_signal(signal.SIGTERM)
        assert child.wait(TIMEOUT_S) == 0
    os.close(keyboard)
    os.close(screen)


def test_a_verb_of_the_command_line_that_cannot_be_done_ends_the_host(walk: Walk) -> None:
    host = BLOCKS[2].strip()
    code, output = walk.done(host)
    assert (code, output.count("\n")) == (1, 1)
    assert output.startswith("positioner: arm: no position frames come: is this the right bus")
    code, output = walk.done(host.replace("62%", "99%"))
    assert (code, output.count("\n")) == (2, 1)
    assert "out of reach" in output
    line = shlex.join(walk.command(host.partition(" arm")[0])) + " <&-"
    closed = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert (closed.returncode, closed.stderr.count("\n")) == (2, 1)
    assert closed.stderr.startswith("positioner: there is no standard input")
    code, output = walk.done(host.partition(" arm")[0] + " status")
    assert (code, output.count("\n")) == (1, 1)
    assert output.startswith("positioner: status: nothing comes, neither position frames nor a status")
