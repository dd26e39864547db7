"""The guide docs/commission.md, command by command, with the emulated valve in virtual time behind the ports.

The host of the guide is in the virtual world, too; `tests/cli/test_quick_start.py` walks the real one.
"""

from __future__ import annotations

import argparse
import gc
import os
import re
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from plant_world import PlantWorld

from plant_emulator.cli.plant_options import add_plant_options, plant_of
from plant_emulator.device import initial_device
from positioner.bus.port import Ports
from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.errors import ExitCode
from positioner.runtime import daemon
from positioner.wire.messages import HostRequest, Setpoint

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "commission.md").read_text(encoding="utf-8")
COMMANDS = [
    line for block in re.findall(r"^```sh\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE) for line in block.splitlines()
]
SAMPLES_PER_SETPOINT = 5
RUN_S = 20.0


class GuideWorld(PlantWorld):
    """The emulated valve, and a host once it has a setpoint; it ends the daemon with Ctrl-C when time is up."""

    wanted_m: float | None = None
    ends_ns = 0

    def _live_until(self, end_ns: int) -> None:
        while self._next_ns <= end_ns:
            super()._live_until(self._next_ns)
            if self.wanted_m is not None and self.sample % SAMPLES_PER_SETPOINT == 0:
                request = HostRequest.ARM if self.setpoints > 2 * SAMPLES_PER_SETPOINT else HostRequest.NONE
                self._deliver(Setpoint(self.wanted_m, request), self.setpoints)
                self.setpoints += 1
            if self.ends_ns and self.now_ns >= self.ends_ns:
                self.ends_ns = 0
                signal.raise_signal(signal.SIGINT)
        super()._live_until(end_ns)


class Walk:
    """The reader's machine: the folder in which the commands are typed, and the world behind the bus."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, capture: pytest.CaptureFixture[str]) -> None:
        self.folder, self._patch, self._capture = folder, patch, capture
        patch.chdir(folder)
        patch.setenv("XDG_STATE_HOME", str(folder / "home"))
        patch.setattr("positioner.cli.procedure.lock_memory", lambda: None)
        patch.setattr("positioner.cli.run.lock_memory", lambda: None)
        self.world = GuideWorld(round(load_config(ROOT / "examples" / "fv101.toml").control.sample_period_s * 1e9))

    def copy(self, line: str) -> None:
        """Copy the configuration."""
        program, source, target = shlex.split(line)
        assert program == "cp"
        shutil.copy(ROOT / source, self.folder / target)

    def plant(self, line: str) -> None:
        """Put the plant of the guide's emulator into the world."""
        parser = argparse.ArgumentParser()
        add_plant_options(parser)
        parser.add_argument("--bus")
        parser.add_argument("--period", type=float)
        options = parser.parse_args(shlex.split(line)[2:])
        assert round(options.period * 1e9) == self.world.period_ns
        self.world.settings = plant_of(options)
        self.world.device = initial_device(self.world.settings, 1)

    def done(self, line: str, *, wanted_m: float | None = None) -> tuple[int, str]:
        """Type a command of the positioner; return its status and what it printed."""
        program, *arguments = shlex.split(line)
        assert program == ".venv/bin/positioner"
        world = self.world
        world.codec = load_config(Path("fv101.toml")).make_codec()
        world.queue.clear()
        world.sent.clear()
        world.wanted_m = wanted_m
        world.ends_ns = world.now_ns + round(RUN_S * 1e9) if wanted_m is not None else 0
        self._capture.readouterr()
        with handlers_kept():
            self._patch.setattr(daemon, "Ports", lambda: Ports(world, world.open))
            code = main(arguments)
        return code, self._capture.readouterr().out


@contextmanager
def handlers_kept() -> Iterator[None]:
    """Restore what the loop of a daemon sets for its process."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
        for number, handler in kept.items():
            signal.signal(number, handler)


def expected_after(line: str) -> list[str]:
    """Return the lines that the guide shows below a command."""
    below = PAGE.partition(f"{line}\n```\n")[2]
    shown = re.match(r"\n```text\n(.*?)^```$", below, re.DOTALL | re.MULTILINE)
    return shown.group(1).splitlines() if shown else []


def label_of(line: str) -> str:
    """Return what a line begins with, before its figures."""
    return re.split(r"[-+]?\d|  +|─+", line.strip())[0].strip()


def test_a_reader_of_the_guide_commissions_a_valve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plant, copy, *procedures, run, host, health, report = COMMANDS
    assert [line.split()[1] for line in procedures] == ["identify", "signature", "step-test", "stroke-test"]
    walk = Walk(tmp_path, monkeypatch, capsys)
    walk.copy(copy)
    walk.plant(plant)
    for line in procedures:
        code, output = walk.done(line)
        assert code == ExitCode.OK, output
        check_shown(line, output)
    share = float(host.rpartition("set ")[2].removesuffix("%")) / 100.0
    wanted_m = share * load_config(Path("fv101.toml")).valve.span_m
    code, _ = walk.done(run, wanted_m=wanted_m)
    assert code == ExitCode.OK
    assert abs(walk.world.device.plant.stem.position_m - wanted_m) < 0.002
    code, output = walk.done(health)
    assert code == ExitCode.OK
    check_shown(health, output)
    (friction,) = [line for line in output.splitlines() if line.startswith("sliding friction ")]
    low, high = (float(each) for each in re.findall(r"[-+−]?[\d.]+", friction.replace("−", "-"))[1:3])
    assert low <= 0.0 <= high, friction  # nothing has changed since the signature
    code, _ = walk.done(report)
    assert code == ExitCode.OK
    for name in ("signature.html", "step-test.html", "stroke-test.html", "fv101.html"):
        assert "FV-101" in (tmp_path / name).read_text(encoding="utf-8")


def check_shown(line: str, output: str) -> None:
    """Check that each line that the guide shows is printed, whatever its figures are."""
    labels = [label_of(each) for each in expected_after(line)]
    assert len(labels) > 3, line
    printed = {label_of(each) for each in output.splitlines()}
    assert [label for label in labels if label not in printed] == []


@pytest.mark.bus
def test_in_lockstep_the_guides_emulator_serves_one_procedure_after_another(tmp_path: Path) -> None:
    channel = f"guide{secrets.token_hex(8)}"
    text = (ROOT / "examples" / "fv101.toml").read_text(encoding="utf-8")
    (tmp_path / "fv101.toml").write_text(text.replace('"fv101"', f'"{channel}"'), encoding="utf-8")
    lockstep = "`--clock lockstep` to the emulator's command of step 1 and to those of steps 2 to 4"
    assert lockstep in PAGE.replace("\n", " ")
    plant, copy, *procedures = COMMANDS[:5]
    assert copy.startswith("cp ")
    step_test = f"{procedures[-1].partition('--sizes')[0]} --sizes 5 --repeats 1 --wait 1 --ladder 0"

    def words(line: str) -> list[str]:
        program, *arguments = shlex.split(line.replace("embedded:fv101", f"embedded:{channel}"))
        return [str(Path(sys.executable).parent / Path(program).name), *arguments, "--clock", "lockstep"]

    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path / "home")}
    with subprocess.Popen(words(plant), stderr=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stderr is not None
            assert "waits at sample 1" in emulator.stderr.readline()  # nobody was there for its first reading
            for _ in range(2):
                done = subprocess.run(
                    words(step_test), cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
                )
                assert done.returncode == ExitCode.OK, done.stderr
                assert "5 up      1/1" in done.stdout
        finally:
            emulator.terminate()
