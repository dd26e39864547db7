"""The memory that a replay takes: `make long-replay` prints it for two logs, one many times as long as the other.

Each is the log that another node on the bus would have written: readings, a setpoint for each tenth reading, and
commands that echo them. The replay looks ahead in it, finds that every command differs, and writes trace and picture.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.wire.codec import make_codec
from positioner.wire.messages import CurrentCommand, HostRequest, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator

_CONFIGURATION = """\
[valve]
id = "long"
preset = "paper"

[bus]
interface = "virtual"
channel = "none"

[control]
law = "pi"
sample_period_s = 0.001

[guard]
auto_arm = true

[state]
directory = "unused"
"""
_CHILD = """\
import json, sys, time
from positioner.cli.main import main
from positioner.replay.output import OutputFolder

def peak_mib():
    # of this program alone: ru_maxrss would begin with the memory of the process that started it
    with open("/proc/self/status", encoding="ascii") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) / 1024.0

def noted(folder, title):
    undrawn_mib.append(peak_mib())
    draw(folder, title)

undrawn_mib, draw, OutputFolder.draw = [], OutputFolder.draw, noted
status = main(sys.argv[1:])
print(json.dumps([int(status), *undrawn_mib, peak_mib(), time.process_time()]))
"""
_SAMPLES_PER_SETPOINT = 10
_LATE_S = 0.00042
_DAY_FRAMES = 190_000_000


@dataclass(frozen=True, slots=True)
class Taken:
    """The cost of a replay: its peaks of memory in MiB, without and with the picture, and its processor time in s.

    The picture is drawn at the end, from a limited number of points; its memory would hide the peak before it.
    """

    frames: int
    undrawn_mib: float
    peak_mib: float
    cpu_s: float
    text: str


def lines() -> Iterator[str]:
    """Yield the frames of an endless log at 1 kHz, in candump's format."""
    codec = make_codec()
    sample = 0
    while True:
        setpoint = sample // _SAMPLES_PER_SETPOINT
        frames = [(0.0, codec.encode(StemPosition(0.08), sample % 256))]
        if sample % _SAMPLES_PER_SETPOINT == 0:
            frames.insert(0, (0.0, codec.encode(Setpoint(0.08, HostRequest.ARM), setpoint % 256)))
        command = CurrentCommand(12.0, position_counter=sample % 256, setpoint_counter=setpoint % 256)
        frames.append((_LATE_S, codec.encode(command, sample % 256)))
        for late_s, frame in frames:
            stamp_s = 1.7e9 + sample * 1e-3 + late_s
            yield f"({stamp_s:.6f}) vcan0 {frame.arbitration_id:03X}#{frame.data.hex()}\n"
        sample += 1


def replay(frames: int, folder: Path) -> Taken:
    """Return the cost of the replay of a log of `frames` frames, in a process of its own."""
    log, config = folder / f"{frames}.log", folder / "valve.toml"
    config.write_text(_CONFIGURATION, encoding="utf-8")
    with log.open("w", encoding="ascii") as file:
        file.writelines(islice(lines(), frames))
    command = (sys.executable, "-c", _CHILD, "replay", log, "--config", config, "--out", folder / "out")
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    log.unlink()
    status, undrawn_mib, peak_mib, cpu_s = json.loads(done.stdout.splitlines()[-1])
    if status != 1:
        raise AssertionError(done.stdout + done.stderr)
    return Taken(frames, undrawn_mib, peak_mib, cpu_s, done.stdout)


def main() -> None:
    """Print both figures, and what a day's log at 1 kHz would take."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000, help="of the longer log")
    longer = parser.parse_args().frames
    with tempfile.TemporaryDirectory() as folder:
        short, long = (replay(frames, Path(folder)) for frames in (longer // 10, longer))
    for taken in (short, long):
        sys.stdout.write(
            f"{taken.frames} frames: {taken.undrawn_mib:.1f} MiB, with the picture {taken.peak_mib:.1f} MiB, "
            f"{taken.cpu_s:.0f} s of a processor\n"
        )
    growth_bytes = (long.undrawn_mib - short.undrawn_mib) * 2**20 / (long.frames - short.frames)
    day_mib = long.peak_mib + growth_bytes * _DAY_FRAMES / 2**20
    sys.stdout.write(f"{growth_bytes:.2f} bytes a frame; a day at 1 kHz, extrapolated: {day_mib:.0f} MiB\n")


if __name__ == "__main__":
    main()
