"""A bench from end to end: emulator and daemon as processes on one bus, and all its files."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import can
import matplotlib.image as mpl_image
import numpy as np
import pytest
from daemon_helpers import TIMEOUT_S, own_address

from positioner.bench import metrics, runner
from positioner.bench import play as play_module
from positioner.bench.host import Host
from positioner.bench.inprocess import run_in_process
from positioner.bench.play import BenchOptions
from positioner.bench.processes import BenchProcess
from positioner.bench.runner import run_bench
from positioner.bench.scenario import load_scenario
from positioner.bus.port import BusPort
from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.errors import BenchError, ConfigurationError, ExitCode
from positioner.store import access
from positioner.wire.codec import make_codec
from positioner.wire.messages import CanFrame, CurrentCommand, Mode, PlantTruth, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.bench.result import Result
    from positioner.bench.scenario import Scenario

pytestmark = pytest.mark.bus
SHORT = """
name = "short"
title = "two setpoints, a fifth of a second each"
setpoints_mm = [73.0, 80.0]
dwell_s = 0.2
seed = 7
"""
REAL_TIME = """
name = "slow"
title = "one second at 100 Hz"
law = "nmpc"
sample_period_s = 0.01
setpoint_period_s = 0.05
setpoints_mm = [73.0, 80.0]
dwell_s = 0.5
plant = { deadman_s = 20.0 }
guard = { feedback_hold_periods = 800, feedback_failsafe_periods = 8000, setpoint_hold_s = 0, setpoint_failsafe_s = 0 }
"""
FILES = ("result.json", "trend.png", "bus.log", "trace.csv", "valve.toml", "plant.toml", "positioner.log")
CANDUMP = re.compile(r"\(\d+\.\d{6}\) vcan0 1[0-7]0#([0-9A-F]{2}){8}( [RT])?")


@dataclass(frozen=True)
class Played:
    """A run: its scenario, its result, the copy of its files, and the lines that it wrote."""

    scenario: Scenario
    result: Result
    files: Path
    lines: tuple[str, ...]


def written(folder: Path, text: str) -> Path:
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return path


def play(
    scenario: Scenario,
    out: Path,
    aside: Path,
    *,
    state: Path | None = None,
    lockstep: bool = True,
    picture: bool = False,
) -> Played:
    """Return the run of `scenario`; a picture takes longer than all the rest, so it is drawn only on request."""
    lines: list[str] = []
    options = BenchOptions(bus=own_address(), lockstep=lockstep, out=out, state=state)
    with pytest.MonkeyPatch.context() as patch:
        if not picture:
            patch.setattr(runner, "draw_trend", lambda *_arguments: None)
            patch.setattr(runner, "draw_moves", lambda *_arguments: None)
        result = run_bench(scenario, options, lines.append)
    shutil.copytree(out, aside)
    return Played(scenario, result, aside, tuple(lines))


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return load_scenario(str(written(tmp_path_factory.mktemp("scenario"), SHORT)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def first(scenario: Scenario, folder: Path) -> Played:
    return play(scenario, folder / "out", folder / "first", picture=True)


@dataclass(frozen=True)
class AtOnce:
    """The first run again, into the same directory, while the command plays it into another directory."""

    played: Played
    status: int
    out: str
    error: str
    files: Path


@pytest.fixture(scope="module")
def at_once(scenario: Scenario, folder: Path, first: Played) -> AtOnce:
    assert first.files.exists()
    process = bench("--scenario", str(written(folder, SHORT)), "--out", "beside", folder=folder)
    played = play(scenario, folder / "out", folder / "second")
    out, error = process.communicate(timeout=300.0)
    return AtOnce(played, process.returncode, out, error, folder / "beside")


@pytest.fixture(scope="module")
def second(at_once: AtOnce) -> Played:
    return at_once.played


def frames_of(log: Path) -> list[tuple[float, CanFrame]]:
    with can.LogReader(log) as reader:
        return [(m.timestamp, CanFrame(m.arbitration_id, bytes(m.data), m.is_extended_id)) for m in reader]


def test_a_run_writes_all_its_files(first: Played) -> None:
    assert {name for name in FILES if (first.files / name).stat().st_size > 0} == set(FILES)
    values = json.loads((first.files / "result.json").read_text(encoding="utf-8"))
    assert values["scenario"]["name"] == "short"
    assert len(values["dwells"]) == 2
    assert values["run"]["clock"] == "lockstep"
    assert values["table_before"]["recorded"] == 0
    assert values["table_after"]["recorded"] == access.dump(first.files / "state").table.sequence > 0
    assert len((first.files / "trace.csv").read_text(encoding="utf-8").splitlines()) == 1 + 400


@pytest.mark.parametrize("name", ["trend", "moves"])
def test_the_picture_is_a_picture(first: Played, name: str) -> None:
    pixels = mpl_image.imread(first.files / f"{name}.png")
    assert "</svg>" in (first.files / f"{name}.svg").read_text("utf-8")
    height, width, _ = pixels.shape
    assert 1200 <= width <= 4000
    assert 0.5 <= height / width <= 2.0
    colours = np.unique(pixels[::4, ::4, :3].astype(float) @ (1.0, 256.0, 65536.0))
    assert len(colours) > 50
    assert 0.005 < float((pixels[..., :3].min(axis=2) < 0.9).mean()) < 0.6


def test_every_frame_of_the_log_reads_back_and_is_the_candump_format(first: Played) -> None:
    log = first.files / "bus.log"
    codec = make_codec()
    kinds = [type(codec.decode(frame)[0]) for _, frame in frames_of(log)]
    counts = {kind: kinds.count(kind) for kind in kinds}
    assert (counts[PlantTruth], counts[StemPosition], counts[CurrentCommand], counts[Setpoint]) == (400, 400, 400, 40)
    assert kinds[:4] == [Setpoint, PlantTruth, StemPosition, CurrentCommand]
    assert all(CANDUMP.fullmatch(line) for line in log.read_text(encoding="ascii").splitlines())
    stamps = [stamp for stamp, _ in frames_of(log)]
    assert stamps == sorted(stamps)
    assert stamps[0] == 0.0
    assert stamps[-1] == pytest.approx(0.399)


def test_two_runs_of_one_seed_are_the_same_to_the_byte_but_for_the_run_itself(first: Played, second: Played) -> None:
    for name in ("bus.log", "trace.csv", "plant.toml"):
        assert (first.files / name).read_bytes() == (second.files / name).read_bytes(), name
    one, other = (json.loads((played.files / "result.json").read_text()) for played in (first, second))
    assert one.pop("run") != other.pop("run")
    assert one == other


def test_a_fresh_run_starts_empty_and_keeps_the_former_table(first: Played, second: Played) -> None:
    assert not any("table" in line for line in first.lines)
    assert second.result.table_before.recorded == 0
    (line,) = (line for line in second.lines if "table" in line)
    (backup,) = (second.files / "state" / "backups").iterdir()
    assert backup.name in line


def test_the_processes_compute_the_same_as_the_loop_without_them(first: Played, tmp_path: Path) -> None:
    run = run_in_process(first.scenario)
    run.recording.write_log(tmp_path / "bus.log")
    assert (tmp_path / "bus.log").read_bytes() == (first.files / "bus.log").read_bytes()
    dwells = metrics.dwell_metrics(run.recording.trace, first.scenario.dwell_edges_s, first.result.span_mm * 1e-3)
    assert dwells == first.result.dwells
    assert access.dump(first.files / "state").table == run.table


def test_the_configuration_of_a_run_finds_its_table_from_any_directory(
    at_once: AtOnce, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # `positioner bench --out beside` wrote it from elsewhere, with a relative path
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    config = str(at_once.files / "valve.toml")
    assert main(["table", "dump", "--config", config, "--format", "json"]) == ExitCode.OK
    assert json.loads(capsys.readouterr().out)["valve"] == "bench"
    assert load_config(at_once.files / "valve.toml").state_directory == at_once.files / "state"


def test_a_run_with_a_state_starts_from_its_table(first: Played, tmp_path: Path) -> None:
    state = tmp_path / "kept"
    shutil.copytree(first.files / "state", state)
    played = play(first.scenario, tmp_path / "out", tmp_path / "aside", state=state)
    assert played.result.table_before == first.result.table_after
    assert played.result.table_after.recorded > first.result.table_after.recorded
    assert not (tmp_path / "out" / "state").exists()
    learned = access.dump(first.files / "state").table
    assert run_in_process(first.scenario, learned).table == access.dump(state).table


def test_a_run_in_real_time_closes_the_loop(tmp_path: Path) -> None:
    scenario = load_scenario(str(written(tmp_path, REAL_TIME)))
    start_s = time.monotonic()
    played = play(scenario, tmp_path / "out", tmp_path / "aside", lockstep=False, picture=True)
    assert time.monotonic() - start_s > 1.0
    assert played.result.run.clock == "real-time"
    codec = make_codec()
    frames = [frame for _, frame in frames_of(played.files / "bus.log") if not frame.is_extended]  # notes are
    messages = [codec.decode(frame)[0] for frame in frames]
    commands = [message for message in messages if isinstance(message, CurrentCommand)]
    readings = [message for message in messages if isinstance(message, StemPosition)]
    assert 90 <= len(readings) <= 200
    assert 2 <= len(commands) <= len(readings)  # a busy machine takes readings in batches, and answers each batch once
    assert {command.mode for command in commands} == {Mode.ACTIVE}
    assert max(reading.position_m for reading in readings) > 0.05
    assert (played.files / "trend.png").stat().st_size > 10_000


def test_a_short_run_at_1_khz_ends_active_loses_nothing_and_counts_its_late_cycles(tmp_path: Path) -> None:
    patient = REAL_TIME[REAL_TIME.index("plant = ") :]
    scenario = load_scenario(str(written(tmp_path, SHORT.replace("0.2", "1.0") + 'law = "nmpc"\n' + patient)))
    played = play(scenario, tmp_path / "out", tmp_path / "aside", lockstep=False)
    assert played.result.modes[-1].mode is Mode.ACTIVE
    assert played.result.scenario.control == {"command_delay_s": pytest.approx(0.0008)}
    timing = played.result.run.timing
    assert timing is not None
    assert timing.whole is not None
    assert timing.late == sum(timing.late_by_motion.values()) == sum(timing.late_by_mode.values())
    assert timing.whole.cycles >= 1000  # from the first answer on, which a busy machine delays
    codec = make_codec()
    received = [codec.decode(frame) for _, frame in frames_of(played.files / "bus.log") if not frame.is_extended]
    counters = [counter or 0 for message, counter in received if isinstance(message, StemPosition)]
    assert {(after - before) % 256 for before, after in pairwise(counters)} == {1}  # none was lost, however late
    assert "queue was full" not in (played.files / "positioner.log").read_text(encoding="utf-8")


@pytest.mark.parametrize("victim", ["positioner", "plant-emulator"])
def test_a_process_that_dies_during_the_run_is_one_line(
    victim: str, scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    children: list[BenchProcess] = []

    class Marked(BenchProcess):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            children.append(self)

    def receive(self: Host, timeout_s: float) -> bool:
        if self._recording.complete > 50:
            next(child for child in children if child.name == victim).process.kill()
        return received(self, timeout_s)

    received = Host._receive
    monkeypatch.setattr(play_module, "BenchProcess", Marked)
    monkeypatch.setattr(Host, "_receive", receive)
    with pytest.raises(BenchError, match=rf"^{victim} ended with status -9: .*\(log: .*{victim}.log\)$") as caught:
        play(scenario, tmp_path / "out", tmp_path / "aside")
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code is ExitCode.FAILURE
    assert [child.process.poll() is not None for child in children] == [True, True]
    assert not (tmp_path / "out" / "result.json").exists()


def bench(*arguments: str, folder: Path) -> subprocess.Popen[str]:
    """Start `positioner bench`."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    return subprocess.Popen(
        [sys.executable, "-m", "positioner", "bench", *arguments],
        cwd=folder,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def test_two_benches_at_once_do_not_disturb_each_other(first: Played, at_once: AtOnce) -> None:
    assert at_once.status == ExitCode.OK, at_once.error
    for files in (at_once.played.files, at_once.files):
        assert (files / "bus.log").read_bytes() == (first.files / "bus.log").read_bytes()


def test_the_command_prints_its_bus_its_figures_and_its_folder(at_once: AtOnce) -> None:
    assert re.match(r"bus (udp_multicast|socketcan):\S+: (embedded, never leaves|a virtual CAN)", at_once.error)
    assert at_once.out.startswith("short: two setpoints, a fifth of a second each\nlaw paper, seed 7, period 1 ms")
    assert at_once.error.endswith(
        "\nbeside: result.json, bus.log, trend and moves (.png, .svg); the learned table is in beside/state\n"
    )
    assert max(map(len, at_once.out.splitlines())) <= 100


def test_a_bench_that_is_stopped_ends_its_processes(tmp_path: Path) -> None:
    address = own_address()
    port = BusPort(address)
    port.open()
    path = written(tmp_path, SHORT.replace("dwell_s = 0.2", "dwell_s = 3000.0"))
    process = bench("--scenario", str(path), "--bus", str(address), "--out", "out", folder=tmp_path)
    try:
        deadline_s = time.monotonic() + TIMEOUT_S
        while not port.receive(0.1):
            assert time.monotonic() < deadline_s
            assert process.poll() is None
        again = main(["bench", "--scenario", str(path), "--out", str(tmp_path / "out")])
        process.send_signal(signal.SIGTERM)
        _, error = process.communicate(timeout=TIMEOUT_S)
        assert process.returncode == 130
        assert "Traceback" not in error
        while port.receive(0.3):
            assert time.monotonic() < deadline_s + TIMEOUT_S
        assert again == ExitCode.TEMPORARY
    finally:
        process.kill()
        port.close()


@pytest.mark.parametrize(
    ("arguments", "status", "expected"),
    [
        (["--scenario", "paper-vale"], ExitCode.USAGE, "scenario 'paper-vale' is unknown; did you mean 'paper-valve'?"),
        (["--scenario", "absent.toml"], ExitCode.CONFIG, "absent.toml: file: cannot be read: No such file"),
        (["--bus", "vcan0"], ExitCode.CONFIG, "bus 'vcan0' is not INTERFACE:CHANNEL"),
        (["--bus", "socketcan:vcan77"], ExitCode.UNAVAILABLE, "bus socketcan:vcan77 cannot be opened"),
        (["--out", "/proc/nothing"], ExitCode.IO, "/proc/nothing: cannot be written: No such file or directory"),
        (["--seed", "-1"], ExitCode.USAGE, "--seed"),
        (["--dwell", "0"], ExitCode.CONFIG, "--dwell: dwell_s = 0.0: must be greater than 0 s"),
        (
            ["--dwell", "0.015"],
            ExitCode.CONFIG,
            "--dwell: dwell_s = 0.015: must be a whole multiple of setpoint_period_s",
        ),
        (
            ["--dwell", "2", "--setpoints", "ramp:10"],
            ExitCode.USAGE,
            "--dwell is for setpoints that stand still; these move",
        ),
    ],
)
def test_what_cannot_be_played_ends_in_one_line_and_a_status(
    arguments: list[str], status: ExitCode, expected: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    try:
        code = main(["bench", "--out", str(tmp_path / "out"), *arguments])
    except SystemExit as wrong:  # argparse's own way
        code = int(str(wrong.code))
    assert code == status
    assert expected in capsys.readouterr().err.splitlines()[-1]


def test_an_unknown_law_is_answered_with_the_nearest_one(tmp_path: Path) -> None:
    scenario = load_scenario(str(written(tmp_path, SHORT + 'law = "papper"\n')))
    with pytest.raises(ConfigurationError, match=r"control.law = 'papper': is no law; did you mean 'paper'\?"):
        run_bench(scenario, BenchOptions(bus=own_address(), lockstep=True, out=tmp_path, state=None), str)


def children() -> set[str]:
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split())


@pytest.fixture(autouse=True)
def nothing_is_left_running() -> Iterator[None]:
    """No process of a bench outlives it; multiprocessing keeps one of its own from other tests."""
    before = children()
    yield
    assert children() <= before
