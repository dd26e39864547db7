"""A procedure inside the daemon's own loop and guard, in virtual time, with an emulated valve behind the ports."""

from __future__ import annotations

import gc
import json
import re
import signal
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import write_configuration
from plant_world import PlantWorld

from positioner.bus.address import BusAddress
from positioner.bus.port import Ports
from positioner.cli.main import main
from positioner.cli.stroke_test import stroke_test_of
from positioner.commissioning import results
from positioner.commissioning.experiment import Experiment
from positioner.commissioning.procedure import ProcedureLimits, Progress, load_remedy
from positioner.commissioning.stroke.report import as_json
from positioner.commissioning.stroke.result import stroke_result
from positioner.config.reader import load_config
from positioner.errors import ExitCode
from positioner.host.words import state_in_words
from positioner.replay.procedure import outcome_in
from positioner.runtime.procedure_run import ProcedureError, ProcedureRun
from positioner.runtime.session import RunOptions
from positioner.wire.messages import Cause, CurrentCommand, Health, HostRequest, PositionerStatus, StemPosition

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from positioner.commissioning.procedure import Procedure
    from positioner.config.schema import Configuration
    from positioner.laws.law import Observation

PERIOD_S = 0.02
SPAN_M = 0.127


class Run:
    """One procedure in virtual time, the experiment of `identify` if no other is made."""

    def __init__(
        self,
        folder: Path,
        make: Callable[[Configuration], Procedure[Any]] | None = None,
        record: Path | None = None,
        **tables: Any,
    ) -> None:
        tables = {**tables, "control": {"sample_period_s": PERIOD_S}}
        path = write_configuration(folder, BusAddress(interface="virtual", channel="none"), **tables)
        self.configuration = configuration = load_config(path)
        limits = ProcedureLimits.of(configuration.valve, configuration.guard)
        experiment = make(configuration) if make else Experiment.of(configuration.valve, limits, PERIOD_S)
        self.world = PlantWorld(round(PERIOD_S * 1e9), configuration.make_codec())
        self.progress: list[Progress] = []
        self.run = ProcedureRun(
            configuration,
            RunOptions(record=record),
            experiment,
            self.progress.append,
            Ports(self.world, self.world.open),
        )
        self.start_m = self.where_m

    @property
    def where_m(self) -> float:
        return self.world.device.plant.stem.position_m

    def until_end(self, most: int = 400_000, each: Callable[[int], object] = lambda _: None) -> None:
        for number in range(most):
            each(number)
            self.run._cycle()
            if self.run._stopping:
                break
        assert self.run._stopping
        self.run._close()

    def messages(self, kind: type[Any]) -> list[Any]:
        return [sent.message for sent in self.world.sent if isinstance(sent.message, kind)]


def test_the_experiment_runs_in_the_loop_to_its_end_and_the_status_says_function_check(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.until_end()
    memory = run.run.result()
    assert len(memory.stretches) == 1 + 6 + 10 + 8 + 40
    assert abs(run.where_m - run.start_m) < 0.005 * SPAN_M
    statuses = run.messages(PositionerStatus)
    assert {status.health for status in statuses} == {Health.FUNCTION_CHECK}
    health = run.run.sessions[0].health.state
    assert health is not None
    assert health.watch.trends.alarms == ()  # the stem is away from its setpoint for long: nothing pursues it
    counters = health.counting.so_far
    assert (sum(counters.deviation), counters.deviation_recent) == (0, ())
    assert sum(counters.travel) > 100  # one a second
    assert state_in_words(statuses[-1]) == "ACTIVE: a test procedure moves the valve (NE 107: function check)"
    currents = [message.current_ma for message in run.messages(CurrentCommand)]
    assert min(currents) == 4.0
    assert max(currents) == 20.0
    parts = [progress.part for progress in run.progress]
    assert parts == sorted(parts)
    assert parts[-1] == 1.0


def test_an_interrupt_brings_the_stem_back_and_a_second_one_ends_it_at_once(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.until_end(each=lambda number: run.run._stop(2, None) if number == 2_000 else None)
    assert abs(run.where_m - run.start_m) < 0.005 * SPAN_M
    with pytest.raises(
        ProcedureError, match=r"^identify: stopped by a person; at the last reading the stem was 0\.\d mm"
    ):
        run.run.result()


def test_a_second_interrupt_ends_it_at_once(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.until_end(2_010, each=lambda number: run.run._stop(2, None) if number in {2_000, 2_003} else None)
    told = error_of(run)
    assert told.startswith("identify: stopped by a person; stopped at once by a second signal; at the last reading")
    assert distance_mm(told) == pytest.approx(abs(run.where_m - run.start_m) * 1e3, abs=0.5)
    assert distance_mm(told) > 1.0  # it had not come back, and nothing says that it had


class Interrupted:
    """A procedure in the course of whose decision a signal comes, at this observation of it."""

    def __init__(self, procedure: Procedure[Any], at: int) -> None:
        self._procedure, self._at, self.seen = procedure, at, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._procedure, name)

    def advance(self, memory: Any, observation: Observation) -> tuple[Any, float]:
        self.seen += 1
        if self.seen == self._at:
            signal.raise_signal(signal.SIGTERM)
        return self._procedure.advance(memory, observation)


@pytest.mark.parametrize("at", [1, 2_000])
def test_a_signal_within_a_cycle_always_ends_the_procedure(tmp_path: Path, at: int) -> None:
    made: list[Interrupted] = []

    def interrupted(configuration: Configuration) -> Any:
        limits = ProcedureLimits.of(configuration.valve, configuration.guard)
        made.append(Interrupted(Experiment.of(configuration.valve, limits, PERIOD_S), at))
        return made[0]

    run = Run(tmp_path, interrupted)
    run.run.run()
    assert at <= made[0].seen < at + 3_000
    assert abs(run.where_m - run.start_m) < 0.005 * SPAN_M
    assert error_of(run).startswith("identify: stopped by a person")


def test_a_signal_before_it_begins_ends_it(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.world.plant_silent = True
    run.until_end(20, each=lambda number: run.run._stop(2, None) if number == 3 else None)
    assert error_of(run) == "identify: stopped before it began"


def test_nothing_but_a_session_writes_its_state(tmp_path: Path) -> None:
    run = Run(tmp_path).run
    (session,) = run.sessions
    with pytest.raises(AttributeError):
        session.state = session.state  # type: ignore[misc]
    run._close()


def error_of(run: Run) -> str:
    with pytest.raises(ProcedureError) as caught:
        run.run.result()
    return str(caught.value)


def distance_mm(told: str) -> float:
    (found,) = re.findall(r"the stem was (\d+\.\d) mm from its start", told)
    return float(found)


def test_a_procedure_that_raises_has_no_result(tmp_path: Path) -> None:
    run = Run(tmp_path)
    law: Any = run.run.sessions[0].setup.law

    def fails(*_: Any) -> Any:
        raise ZeroDivisionError

    def break_it(number: int) -> None:
        if number == 2_000:
            object.__setattr__(
                law, "procedure", SimpleNamespace(advance=fails, begin=law.procedure.begin, name="identify")
            )

    run.until_end(each=break_it)
    assert error_of(run).startswith("identify: ")


@pytest.mark.parametrize(
    ("late", "cause", "told"),
    [
        (0, Cause.FEEDBACK_STALE, ""),
        (0, Cause.PERIOD_WRONG, "where other programs kept the machine busy (no cycle of the positioner was late)"),
        (1, Cause.FEEDBACK_STALE, "where other programs kept the machine busy (1 late cycle and 2 stalls)"),
        (5, Cause.ACTUATOR_FAILED, "where other programs kept the machine busy (5 late cycles and 2 stalls)"),
    ],
)
def test_an_end_that_a_busy_machine_may_have_caused_names_the_remedy(late: int, cause: Cause, told: str) -> None:
    found = load_remedy(cause, late, 2 if late else 0)
    assert found.partition(":")[0] == told
    for remedy in ("`nice`", "a longer control.sample_period_s", "--clock lockstep") if told else ():
        assert remedy in found


def test_position_frames_at_another_period_end_it_with_the_remedy(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.world.period_ns *= 2
    run.until_end()
    told = error_of(run)
    assert told.startswith("identify: the guard reports: period wrong; at the last reading the stem was ")
    assert told.endswith("--clock lockstep for both")
    assert distance_mm(told) == pytest.approx(abs(run.where_m - run.start_m) * 1e3, abs=0.5)


def test_while_the_record_is_evaluated_an_interrupt_ends_the_command(tmp_path: Path) -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    run = Run(tmp_path)
    run.run._stopping = True
    run.run.run()
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
    assert gc.isenabled()


def test_lost_feedback_ends_it_by_the_guard(tmp_path: Path) -> None:
    run = Run(tmp_path)

    def silence(number: int) -> None:
        run.world.plant_silent = run.world.plant_silent or number == 1_000

    run.until_end(each=silence)
    told = error_of(run)
    assert "ended by the guard: FAILSAFE, feedback stale; at the last reading the stem was " in told
    assert distance_mm(told) > 1.0


def test_a_host_that_disarms_ends_it(tmp_path: Path) -> None:
    run = Run(tmp_path)
    codec = run.world.codec
    from positioner.wire.messages import Setpoint  # noqa: PLC0415

    def disarm(number: int) -> None:
        if number in {1_000, 1_001}:
            run.world._deliver(Setpoint(0.08, HostRequest.DISARM), number - 1_000)

    run.until_end(each=disarm)
    assert codec is not None
    with pytest.raises(ProcedureError, match="ended by the guard: READY, disarmed"):
        run.run.result()


def test_without_feedback_it_does_not_begin_and_says_why(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.world.plant_silent = True
    run.until_end()
    with pytest.raises(ProcedureError, match="did not begin within 10 s: waiting for feedback"):
        run.run.result()
    assert run.messages(StemPosition) == []


def _silent(run: Run, number: int, begin: int, end: int) -> None:
    run.world.plant_silent = begin <= number < end


def _asked(run: Run, number: int) -> None:
    from positioner.wire.messages import Setpoint  # noqa: PLC0415

    if number >= 500 and number % 10 == 0:
        run.world._deliver(Setpoint(0.07), number // 10)


@pytest.mark.parametrize(
    ("each", "verdict", "cause"),
    [
        (lambda _run, _number: None, "passed", ""),
        (lambda run, number: _silent(run, number, 500, 510), "aborted", "stopped by the guard or a person"),
        (
            lambda run, number: _silent(run, number, 500, 10**9),
            "aborted",
            "ended by the guard: FAILSAFE, feedback stale",
        ),
        (_asked, "aborted", "new setpoint"),
    ],
    ids=["to its end", "feedback missing", "feedback lost", "new setpoint"],
)
def test_a_stroke_test_and_its_record_give_the_same_result(
    tmp_path: Path, each: Callable[[Run, int], None], verdict: str, cause: str
) -> None:
    run = Run(tmp_path, stroke_test_of, tmp_path / "test.log")
    run.until_end(each=lambda number: each(run, number))
    configuration = run.configuration
    valve, settings = configuration.valve, configuration.stroke_test
    live = stroke_result(run.run.memory, run.run.ended_because, valve, settings, PERIOD_S)
    assert (live.verdict, live.cause) == (verdict, cause)
    memory, ended_by = outcome_in(tmp_path / "test.log", configuration, stroke_test_of(configuration))
    again = stroke_result(memory, ended_by, valve, settings, PERIOD_S)
    assert as_json(again, valve, settings) == as_json(live, valve, settings)
    if "FAILSAFE" not in cause:
        assert abs(run.where_m - (0.07 if cause == "new setpoint" else run.start_m)) < 0.01 * SPAN_M


def test_the_command_prints_the_result_of_a_record_keeps_a_finished_one_and_writes_its_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, page = tmp_path / "test.log", tmp_path / "page.html"
    run = Run(tmp_path, stroke_test_of, log)
    run.until_end()
    arguments = ["stroke-test", "--config", str(tmp_path / "valve.toml"), "--from", str(log)]
    assert main([*arguments, "--json", "--as-reference", "--report", str(page)]) == ExitCode.OK
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == "passed"
    assert "The stroke test was passed." in page.read_text(encoding="utf-8")
    (kept,) = results.kept(tmp_path / "state", "stroke-test")
    assert kept.document == told
    assert main(arguments) == ExitCode.OK
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "FV-101: stroke test passed"
    (mean,) = [line for line in lines if line.startswith("breakaway, mean")]
    _, unit, now, before, change = re.split(" {2,}", mean)
    assert (unit, now, change) == ("N", before, "0.0\N{NARROW NO-BREAK SPACE}%")
    assert "earns no safety integrity level" in lines[-1]


def test_the_command_ends_with_status_1_where_the_test_was_ended_and_keeps_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "test.log"
    run = Run(tmp_path, stroke_test_of, log)
    run.until_end(each=lambda number: _asked(run, number))
    arguments = ["stroke-test", "--config", str(tmp_path / "valve.toml"), "--from", str(log), "--as-reference"]
    assert main(arguments) == ExitCode.FAILURE
    assert capsys.readouterr().out.startswith("FV-101: stroke test aborted: new setpoint")
    assert results.kept(tmp_path / "state", "stroke-test") == ()


def test_health_is_not_counted_again_from_the_record_of_a_procedure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "test.log"
    run = Run(tmp_path, stroke_test_of, log)
    run.until_end(each=lambda number: _asked(run, number))
    assert main(["health", "--config", str(tmp_path / "valve.toml"), "--from", str(log)]) == ExitCode.IO
    assert "test.log: holds a test procedure, whose health was counted while it ran" in capsys.readouterr().err


def test_a_stroke_test_that_was_ended_is_not_compared_with_the_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "test.log"
    arguments = ["stroke-test", "--config", str(tmp_path / "valve.toml"), "--from", str(log), "--as-reference"]
    Run(tmp_path, stroke_test_of, log).until_end()
    assert main(arguments) == ExitCode.OK
    log.unlink()
    run = Run(tmp_path, stroke_test_of, log)
    run.until_end(each=lambda number: _asked(run, number))
    capsys.readouterr()
    assert main(arguments[:-1]) == ExitCode.FAILURE
    told = capsys.readouterr().out
    assert "stroke test aborted: new setpoint" in told
    assert "\N{EN DASH}" not in told
