"""The stored logs: what the positioner did when they were recorded, it does today.

`pytest --accept-logs` records them anew, where a change is meant (CONTRIBUTING.md). On one machine a replay is equal to
the bit. Another processor or another version of the solver may round a current otherwise, so here a few commands may
differ by a little: at most 1 % of a log, by at most 0.05 mA, and in nothing but the current.
"""

from __future__ import annotations

import gzip
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import replay_helpers as runs

from positioner.config.reader import load_config
from positioner.replay.compare import Comparison, Difference
from positioner.replay.prepare import PreparedLog, prepare
from positioner.replay.report import describe
from positioner.replay.run import ReplayedCycle, replay_cycles
from positioner.replay.survey import LogKind
from positioner.wire.messages import CanFrame, Cause, CurrentCommand, Mode, PositionerStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.wire.codec import Codec

LOGS = Path(__file__).parents[1] / "logs"
MOST_DIFFERING = 0.01
FARTHEST_MA = 0.05


def _bench(law: str) -> Callable[[Path], tuple[Path, Path]]:
    def record(folder: Path) -> tuple[Path, Path]:
        log, config = runs.write_bench_log(folder, runs.scenario(law, seconds=3.0))
        runs.without_truth(log)
        return log, config

    return record


RECORDED: dict[str, Callable[[Path], tuple[Path, Path]]] = {
    "nmpc": _bench("nmpc"),
    "paper": _bench("paper"),
    "faults": lambda folder: runs.record_faults(folder, runs.scenario(seconds=3.0, auto_arm=False)),
}
"""How each stored log is made."""


@dataclass(frozen=True)
class Replayed:
    """A stored log, computed again."""

    codec: Codec
    prepared: PreparedLog
    replayed_cycles: tuple[ReplayedCycle, ...]


@pytest.fixture(scope="module", params=tuple(RECORDED))
def name(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the name of a stored log, recorded anew where that was asked for."""
    name = str(request.param)
    if request.config.getoption("--accept-logs"):
        log, config = RECORDED[name](tmp_path_factory.mktemp(name))
        LOGS.mkdir(exist_ok=True)
        (LOGS / f"{name}.log.gz").write_bytes(gzip.compress(log.read_bytes(), mtime=0))
        (LOGS / f"{name}.toml").write_bytes(config.read_bytes())
    return name


@pytest.fixture(scope="module")
def replay(name: str) -> Replayed:
    configuration = load_config(LOGS / f"{name}.toml")
    prepared = prepare(LOGS / f"{name}.log.gz", configuration, None)
    replayed_cycles = tuple(replay_cycles(configuration, prepared.cycles(), prepared.table))
    return Replayed(configuration.make_codec(), prepared, replayed_cycles)


def currents(codec: Codec, replayed: ReplayedCycle) -> tuple[CurrentCommand | None, CurrentCommand | None]:
    """Return the recorded and the computed command of a cycle."""

    def command(frames: tuple[CanFrame, ...]) -> CurrentCommand | None:
        messages = (codec.decode(frame)[0] for frame in frames)
        return next((message for message in messages if isinstance(message, CurrentCommand)), None)

    return command(tuple(logged.frame for logged in replayed.recorded.outbox)), command(replayed.computed)


def differences(replay: Replayed) -> list[tuple[float, Difference]]:
    """Return the differences in mA, each with its frames; infinite where more than the current differs."""
    found = []
    for replayed in replay.replayed_cycles:
        comparison = Comparison(replay.codec, exact=True)
        comparison.add(replayed)
        if comparison.first is None:
            continue
        recorded, computed = currents(replay.codec, replayed)
        apart_ma = float("inf")
        if recorded and computed and comparison.first.name == "CURRENT_COMMAND":
            same = (recorded.mode, recorded.motion, recorded.position_counter, recorded.setpoint_counter) == (
                computed.mode, computed.motion, computed.position_counter, computed.setpoint_counter
            )  # fmt: skip
            apart_ma = abs(recorded.current_ma - computed.current_ma) if same else apart_ma
        found.append((apart_ma, comparison.first))
    return found


def test_the_positioner_does_what_it_did(name: str, replay: Replayed) -> None:
    apart = differences(replay)
    allowed = MOST_DIFFERING * replay.prepared.commands
    if len(apart) <= allowed and all(gap_ma <= FARTHEST_MA for gap_ma, _ in apart):
        return
    gap_ma, first = next(((gap, each) for gap, each in apart if gap > FARTHEST_MA), apart[0])
    how_far = f" by {gap_ma:.3f} mA" if gap_ma < float("inf") else ""
    report = (
        f"{len(apart)} cycles of {name}.log.gz differ ({allowed:g} may, in the current alone, by {FARTHEST_MA} mA)",
        f"{first.name} at {first.time_ns / 1e9:.6f} s{how_far}:",
        *describe(replay.codec, first),
        "If this is meant: make accept-logs, and say in the commit why.",
    )
    pytest.fail("\n".join(report), pytrace=False)


def test_a_stored_log_holds_every_command_of_three_seconds(name: str, replay: Replayed) -> None:
    kinds = {"nmpc": LogKind.LOCKSTEP, "paper": LogKind.LOCKSTEP, "faults": LogKind.RECORD}
    assert replay.prepared.kind is kinds[name]
    assert not replay.prepared.log.cut
    assert 2800 <= replay.prepared.commands <= 3000
    assert (LOGS / f"{name}.log.gz").stat().st_size < 120_000


def test_the_log_of_faults_met_every_mode_and_cause() -> None:
    configuration = load_config(LOGS / "faults.toml")
    codec = configuration.make_codec()
    prepared = prepare(LOGS / "faults.log.gz", configuration, None)
    modes: Counter[Mode] = Counter()
    causes: set[Cause] = set()
    saved: set[bool] = set()
    for logged in (logged for cycle in prepared.cycles() for logged in cycle.outbox):
        message, _ = codec.decode(logged.frame)
        if isinstance(message, CurrentCommand):
            modes[message.mode] += 1
        elif isinstance(message, PositionerStatus):
            causes.add(message.cause)
            saved.add(message.table_saved)
    assert modes[Mode.ACTIVE] > 2000
    assert modes[Mode.HOLD] > 10
    assert modes[Mode.FAILSAFE] > 100
    assert {Cause.NONE, Cause.FEEDBACK_STALE, Cause.SETPOINT_STALE} <= causes
    assert saved == {True, False}
