"""can-utils and cantools on the bus, as a user would use them."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import TYPE_CHECKING

import can
import printed
import pytest
from daemon_helpers import PERIOD_S, Service
from links import TIMEOUT_S, Program, command, until, vcan
from test_daemon_process import LONG_TIMEOUTS
from test_vcan_bus import filters

from positioner.bus.port import BusPort
from positioner.wire.codec import make_codec
from positioner.wire.messages import CanFrame, CurrentCommand, HostRequest, PlantTruth, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.bus.address import BusAddress

pytestmark = pytest.mark.kernel("vcan")
DBC = Path(__file__).parents[2] / "dbc" / "positioner.dbc"
CURRENT_COMMAND = 0x100


@pytest.fixture
def bus() -> Iterator[BusAddress]:
    with vcan() as address:
        yield address


def emulator(bus: BusAddress, folder: Path) -> Program:
    words = [sys.executable, "-m", "plant_emulator.cli.main", "run", "--bus", str(bus), "--period", "0.02"]
    return Program(words, folder / "plant.log")


def frames_in(log: Path) -> list[CanFrame]:
    with can.LogReader(log) as reader:
        return [CanFrame(m.arbitration_id, bytes(m.data), m.is_extended_id) for m in reader]


def test_candump_records_what_the_emulator_says_and_python_can_reads_it(bus: BusAddress, tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    with Program(["candump", "-L", "-n", "40", bus.channel], log) as candump, emulator(bus, tmp_path):
        assert candump.wait() == 0
    codec = make_codec()
    kinds = {type(codec.decode(frame)[0]) for frame in frames_in(log)}
    assert len(frames_in(log)) == 40
    assert kinds == {PlantTruth, StemPosition}


@pytest.mark.slow(short="test_candump_records_what_the_emulator_says_and_python_can_reads_it")
def test_cantools_decodes_what_candump_shows(bus: BusAddress, tmp_path: Path) -> None:
    log = tmp_path / "dump.txt"
    with Program(["candump", "-n", "20", bus.channel], log) as candump, emulator(bus, tmp_path):
        assert candump.wait() == 0
    decoded = command(sys.executable, "-m", "cantools", "decode", str(DBC), text=log.read_text(encoding="ascii"))
    position = re.findall(r"Position_mm: ([-\d.]+) mm", decoded)
    assert "STEM_POSITION(" in decoded
    assert "PLANT_TRUTH(" in decoded
    assert position
    assert all(-20.0 < float(value) < 160.0 for value in position)


@pytest.mark.slow(short="test_candump_records_what_the_emulator_says_and_python_can_reads_it")
def test_cantools_monitor_shows_the_running_valve(bus: BusAddress, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "cantools", "monitor", "-i", "socketcan", "-c", bus.channel, str(DBC)]
    with emulator(bus, tmp_path):
        leader, follower = pty.openpty()
        fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 120, 0, 0))
        environment = {**os.environ, "TERM": "xterm", "LINES": "50", "COLUMNS": "120"}
        with subprocess.Popen(words, stdin=follower, stdout=follower, stderr=follower, env=environment) as monitor:
            shown, deadline_s = "", time.monotonic() + TIMEOUT_S
            while "STEM_POSITION" not in shown or "Position_mm" not in shown:
                assert time.monotonic() < deadline_s, shown
                assert monitor.poll() is None, shown
                if select.select([leader], [], [], 0.1)[0]:
                    shown += os.read(leader, 65536).decode(errors="replace")
            monitor.terminate()
            monitor.wait(TIMEOUT_S)
        os.close(leader)
        os.close(follower)


def test_cansend_arms_the_positioner(bus: BusAddress, tmp_path: Path) -> None:
    codec = make_codec()
    with Service(tmp_path, bus=bus, guard=LONG_TIMEOUTS) as service:
        numbers = iter(range(1000))

        def answers() -> bool:
            number = next(numbers)
            request = HostRequest.ARM if number % 2 else HostRequest.NONE
            frame = codec.encode(Setpoint(0.08, request), number)
            service.others.report()
            command("cansend", bus.channel, f"{frame.arbitration_id:03X}#{frame.data.hex().upper()}")
            return any(isinstance(message, CurrentCommand) for message in service.others.listen(PERIOD_S))

        until(answers, lambda: service.lines)
        assert service.stop() == 0


def test_canplayer_plays_a_recorded_bus(bus: BusAddress, tmp_path: Path) -> None:
    codec = make_codec()
    sent = [codec.encode(StemPosition(0.08 + 1e-5 * number), number) for number in range(50)]
    log = tmp_path / "bus.log"
    lines = [f"({n * 0.001:.6f}) vcan0 {f.arbitration_id:03X}#{f.data.hex().upper()}" for n, f in enumerate(sent)]
    log.write_text("\n".join(lines) + "\n", encoding="ascii")
    received = tmp_path / "received.log"
    with Program(["candump", "-L", "-n", "50", bus.channel], received) as candump:
        until(lambda: "all" in filters(bus.channel))
        command("canplayer", "-I", str(log), f"{bus.channel}=vcan0")
        assert candump.wait() == 0
    assert [(f.arbitration_id, f.data) for f in frames_in(received)] == [(f.arbitration_id, f.data) for f in sent]


def test_random_frames_of_cangen_are_no_reason_to_act_or_to_stop(bus: BusAddress, tmp_path: Path) -> None:
    with Service(tmp_path, bus=bus, guard=LONG_TIMEOUTS) as service:
        commands = BusPort(bus, [(CURRENT_COMMAND, False)])
        commands.open()
        # the identifiers of a position and of a setpoint with random data of random length; then any identifier
        for identifier in ("110", "120", "r"):
            command("cangen", bus.channel, "-g", "1", "-n", "300", "-I", identifier, "-L", "r", "-D", "r")
        until(lambda: service.logged(printed.WRONG), lambda: service.lines)
        service.others.port.receive(0.0)
        commands.receive(0.0)
        assert commands.receive(0.3) == ()
        commands.close()
        while service.others.port.receive(0.0):
            pass
        service.arm()
        assert service.stop() == 0
