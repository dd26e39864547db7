"""`positioner host` in a real terminal (a pty), with positioner and valve in virtual time in place of its bus.

Each cycle of the host lets 5 ms pass for them. Run as a program it is that host; `InTerminal` starts it, presses keys,
and reads its screen. Both take turns: the host stands still every 50 ms of its time until its screen has been read, so
that no state which lasts as long is missed, however fast or slow a machine is.
"""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import socket
import struct
import subprocess
import sys
import termios
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

import pyte

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from positioner.wire.messages import CanFrame

ROOT = Path(__file__).resolve().parents[2]
CYCLE_NS, TURN_NS = 5_000_000, 50_000_000
MOST_TURNS = 2400
"""Two minutes of the host's time."""
HANGS_S = 300.0
TURNS = "TURNS"
"""The environment variable with the file descriptor of the program's end of the socket for the turns."""


class InTerminal:
    """The program, or another command of Python's, in a terminal of some size."""

    def __init__(
        self,
        *arguments: str,
        size: tuple[int, int] = (80, 24),
        cwd: Path | None = None,
        program: Sequence[str] = (__file__,),
        environment: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self.master, self.slave = pty.openpty()
        self.screen = pyte.Screen(*size)
        self.stream = pyte.ByteStream(self.screen)
        self.received = b""
        self._set_size(size)
        self.before = termios.tcgetattr(self.slave)
        given = {**os.environ, "TERM": "xterm", "POSITIONER_TRACEBACK": "", **environment}
        given["PYTHONPATH"] = os.pathsep.join(map(str, (ROOT, ROOT / "tests", ROOT / "tests/host")))
        self.turns, theirs = socket.socketpair()
        given[TURNS] = str(theirs.fileno())
        self.process = subprocess.Popen(
            [sys.executable, *program, *arguments], pass_fds=[theirs.fileno()],
            stdin=self.slave, stdout=self.slave, stderr=self.slave, env=given, cwd=cwd, start_new_session=True,
        )  # fmt: skip
        theirs.close()
        self.has_ended = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self.turns.close()
        os.close(self.master)
        os.close(self.slave)

    def _set_size(self, size: tuple[int, int]) -> None:
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))

    def resize(self, size: tuple[int, int]) -> None:
        self._set_size(size)
        self.screen.resize(size[1], size[0])

    def press(self, keys: str) -> None:
        os.write(self.master, keys.encode())

    def take_turn(self) -> None:
        """Take in what the program writes until it waits for us or has ended, and let it go on."""
        while True:
            found = select.select([self.master, self.turns.fileno()], [], [], HANGS_S)[0]
            assert found, f"nothing happens: {self.text}"
            if self.master not in found:
                break
            data = os.read(self.master, 65536)
            self.received += data
            self.stream.feed(data)
        try:
            self.has_ended = not self.turns.recv(1)
            self.turns.send(b".")
        except ConnectionError:
            self.has_ended = True

    @property
    def lines(self) -> list[str]:
        return [line.rstrip() for line in self.screen.display]

    @property
    def text(self) -> str:
        return "\n".join(self.lines).strip()

    def until(self, holds: Callable[[str], Any]) -> str:
        """Return the screen when it is as `holds` wants it."""
        for _ in range(MOST_TURNS):
            if holds(self.text):
                return self.text
            assert not self.has_ended, self.text
            self.take_turn()
        raise AssertionError(self.text)

    def shows(self, *texts: str) -> str:
        return self.until(lambda screen: all(text in screen for text in texts))

    def ended(self) -> int:
        """Return the exit status when the program has ended."""
        self.until(lambda _: self.has_ended)
        return self.process.wait(HANGS_S)

    def is_restored(self) -> bool:
        return termios.tcgetattr(self.slave) == self.before


def play(arguments: Sequence[str]) -> int:
    """Run `positioner host` with a virtual bus."""
    import tqdm.std  # noqa: PLC0415
    from virtual_bench import TEXT, Bench  # noqa: PLC0415 - the test that starts this program needs no plant

    from positioner.cli.main import main  # noqa: PLC0415
    from positioner.host import interactive, terminal  # noqa: PLC0415

    it = Bench(TEXT)
    it.host_is_on = False
    clock = _Clock(it.now_ns)
    turns = socket.socket(fileno=int(os.environ[TURNS]))

    class VirtualBus:
        """The frames of positioner and plant, and of the host for them."""

        def __init__(self, *_: object) -> None:
            self.from_host: list[CanFrame] = []

        def open(self) -> None:
            pass

        def close(self) -> None:
            pass

        def send(self, frame: CanFrame) -> None:
            it.others.append(frame)

        def receive(self, _: float) -> list[CanFrame]:
            if clock.now_ns % TURN_NS == 0:
                turns.send(b".")
                turns.recv(1)
            clock.now_ns += CYCLE_NS
            received: list[CanFrame] = []
            it.session.receive = lambda frames, _now_ns: received.extend(frames)  # type: ignore[method-assign,assignment]
            while it.now_ns < clock.now_ns:
                own = set(it.others)
                it.run(0.002)
                received = [frame for frame in received if frame not in own]
            if os.environ.get("CRASH_AT") and clock.now_ns > float(os.environ["CRASH_AT"]) * 1e9:
                raise ZeroDivisionError("a crash")
            return received

    for module in (terminal, interactive):
        module.time = clock  # type: ignore[attr-defined]
    tqdm.std.time = clock.monotonic  # type: ignore[attr-defined]
    terminal.BusPort = VirtualBus  # type: ignore[attr-defined,assignment]
    folder = Path(arguments[0])
    (folder / "valve.toml").write_text(TEXT, encoding="utf-8")
    return main(["host", "--config", str(folder / "valve.toml"), *arguments[1:]])


class _Clock:
    """Virtual time in place of the module `time`."""

    def __init__(self, now_ns: int) -> None:
        self.now_ns = now_ns

    def monotonic_ns(self) -> int:
        return self.now_ns

    def monotonic(self) -> float:
        return self.now_ns * 1e-9

    def sleep(self, duration_s: float) -> None:
        del duration_s


if __name__ == "__main__":
    fcntl.ioctl(sys.stdin.fileno(), termios.TIOCSCTTY, 0)  # so Ctrl-C in this terminal reaches this program
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(play(sys.argv[1:]))
