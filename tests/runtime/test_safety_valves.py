"""Several valves in one daemon: whatever fails for one of them, the frames of the others stay the same to the bit."""

from __future__ import annotations

import os
import resource
import signal
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest
from several_loop import OTHER_BUS, PERIOD_NS, SeveralLoop

from positioner.bus.raw_frame import ROOM_WITHIN_S
from positioner.config.schema import Configuration
from positioner.errors import AlreadyRunningError, AnotherControllerError, ExitCode
from positioner.runtime import session as session_module
from positioner.store import access, lock
from positioner.wire.codec import make_codec
from positioner.wire.messages import Cause, CurrentCommand, Mode, PositionerStatus
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from positioner.runtime.session import Session
    from positioner.wire.messages import CanFrame

OTHERS = ("FV-1", "FV-2", "FV-3")
FAILING = "FV-4"
ALL = (*OTHERS, FAILING)
FAILS_AT, END = 120, 240


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[CanFrame]]:
    """What the positioner sends to each of three valves without a fourth."""
    with SeveralLoop(tmp_path_factory.mktemp("three"), OTHERS) as loop:
        loop.run_to(END)
        assert loop.logged("WARNING") == []
        return frames_of(loop)


def frames_of(loop: SeveralLoop) -> dict[str, list[CanFrame]]:
    """Return the frames to each of the three until the command for the last sample."""
    return {name: up_to(loop.plants[name].codec, loop.plants[name].sent) for name in OTHERS}


def up_to(codec: Any, frames: list[CanFrame]) -> list[CanFrame]:
    """Return the frames up to the command before which `END` readings were sent."""
    commands = 0
    for number, frame in enumerate(frames):
        commands += isinstance(codec.decode(frame)[0], CurrentCommand)
        if commands == END - 1:
            return frames[: number + 1]
    raise AssertionError(commands)


def modes(loop: SeveralLoop, name: str) -> set[tuple[Mode, Cause]]:
    return {(m.mode, m.cause) for m in loop.plants[name].messages() if isinstance(m, PositionerStatus)}


def test_the_three_valves_move_and_learn(undisturbed: dict[str, list[CanFrame]]) -> None:
    for number, frames in enumerate(undisturbed.values()):
        codec = make_codec(WireSettings(id_offset=0x80 * number))
        messages = [codec.decode(frame)[0] for frame in frames]
        assert len({m.current_ma for m in messages if isinstance(m, CurrentCommand)}) > 3
        assert max(m.learned_count for m in messages if isinstance(m, PositionerStatus)) > 0


def test_a_fourth_valve_changes_nothing_for_the_others(undisturbed: dict[str, list[CanFrame]], tmp_path: Path) -> None:
    with SeveralLoop(tmp_path, ALL) as loop:
        loop.run_to(END)
        assert frames_of(loop) == undisturbed
        assert modes(loop, FAILING) == {(Mode.ACTIVE, Cause.NONE)}
    assert loop.code is ExitCode.OK
    assert [access.dump(tmp_path / "state" / name).valve_id for name in ALL] == list(ALL)


def raising(*_arguments: object, **_options: object) -> Any:
    raise ValueError("no such valve")


def test_a_law_that_raises_fails_safe_and_the_others_go_on(
    undisturbed: dict[str, list[CanFrame]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with SeveralLoop(tmp_path, ALL) as loop:
        loop.run_to(FAILS_AT)
        monkeypatch.setattr(type(loop.sessions[FAILING].setup.law), "decide", only_for(loop.sessions[FAILING]))
        loop.run_to(END)
        assert frames_of(loop) == undisturbed
        assert (Mode.FAILSAFE, Cause.LAW_FAILED) in modes(loop, FAILING)
        assert loop.logged("FV-4: mode ACTIVE -> FAILSAFE (law failed)")
        assert [line for line in loop.logged("law") if not line.startswith("FV-4: ")] == []


def only_for(session: Session) -> Callable[..., Any]:
    """Return a `decide` that raises for the law of one session, and is the law's own for the others."""
    law = session.setup.law
    real = type(law).decide

    def decide(self: Any, *arguments: Any, **options: Any) -> Any:
        return raising() if self is law else real(self, *arguments, **options)

    return decide


def test_a_cycle_that_fails_unexpectedly_starts_its_valve_again_not_armed_and_the_others_go_on(
    undisturbed: dict[str, list[CanFrame]], tmp_path: Path
) -> None:
    with SeveralLoop(tmp_path, ALL) as loop:
        loop.run_to(FAILS_AT)
        session = loop.sessions[FAILING]
        session.setup = replace(session.setup, guard=replace(session.setup.guard, auto_arm=False))
        learned, real = session.state.table, session._trace.cycle
        session._trace.cycle = raising  # type: ignore[method-assign]
        loop.run_to(FAILS_AT + 5, *OTHERS)
        session._trace.cycle = real  # type: ignore[method-assign]
        loop.plants[FAILING].publish()
        loop.run_to(END, *OTHERS)
        assert frames_of(loop) == undisturbed
        assert loop.logged("FV-4: internal error: ValueError: no such valve in ")
        assert session.state.guard.mode is Mode.READY
        assert session.state.table.sequence >= learned.sequence


def test_a_full_disk_of_one_valve_is_shown_by_that_valve_and_the_others_go_on(
    undisturbed: dict[str, list[CanFrame]], tmp_path: Path
) -> None:
    with SeveralLoop(tmp_path, ALL) as loop:
        writer = loop.sessions[FAILING].table.writer._child.process.pid
        _, most = resource.prlimit(writer, resource.RLIMIT_FSIZE)
        resource.prlimit(writer, resource.RLIMIT_FSIZE, (512, most))
        loop.run_to(END)
        while not loop.logged("table cannot be saved"):
            loop.sessions[FAILING]._poll_due_s = 0.0  # the writer takes real time, and in lockstep no time passes
            loop.run_to(loop.plants[FAILING].sample + 1)
        loop.run_to(loop.plants[FAILING].sample + 110)
        assert frames_of(loop) == undisturbed
        told = [line.split(" cannot be saved")[0] for line in loop.logged("cannot be saved")]
        assert any("the stiction table" in line for line in told)
        assert len(set(told)) == len(told), "each is told once"
        assert {line[:5] for line in told} == {"FV-4:"}
        saved = {name: last_status(loop, name).table_saved for name in ALL}
        assert saved == {"FV-1": True, "FV-2": True, "FV-3": True, FAILING: False}
    assert loop.code is ExitCode.IO
    tables = {name: access.dump(tmp_path / "state" / name).table for name in OTHERS}
    assert tables == {name: loop.sessions[name].state.table for name in OTHERS}


def last_status(loop: SeveralLoop, name: str) -> PositionerStatus:
    return [m for m in loop.plants[name].messages() if isinstance(m, PositionerStatus)][-1]


def test_a_lost_sensor_of_one_valve_leaves_the_others_alone(
    undisturbed: dict[str, list[CanFrame]], tmp_path: Path
) -> None:
    with SeveralLoop(tmp_path, ALL) as loop:
        loop.run_to(FAILS_AT)
        loop.plants[FAILING].is_silent = True
        loop.run_to(END, *OTHERS)
        assert frames_of(loop) == undisturbed
        assert loop.plants[FAILING].sample < END


@pytest.mark.parametrize("together", [(), ("FV-3",)])
def test_a_bus_that_goes_down_leaves_the_valves_on_another_bus_alone(
    together: tuple[str, ...], undisturbed: dict[str, list[CanFrame]], tmp_path: Path
) -> None:
    with SeveralLoop(tmp_path, ALL, on_other_bus=(FAILING, *together)) as loop:
        loop.run_to(FAILS_AT)
        loop.buses[OTHER_BUS].is_cut = True
        rest = [name for name in OTHERS if name not in together]
        loop.run_to(END, *rest)
        found = {name: up_to(loop.plants[name].codec, loop.plants[name].sent) for name in rest}
        assert found == {name: undisturbed[name] for name in rest}
        assert loop.logged("bus virtual:two is down: Network is down")
        loop.buses[OTHER_BUS].is_cut = False
        loop.time.sleep(1.0)
        loop.plants[FAILING].publish()
        loop.run_to(FAILS_AT + 20, FAILING)
        assert loop.logged("bus virtual:two is there again")


def test_another_controller_ends_its_valve_and_not_the_others(
    undisturbed: dict[str, list[CanFrame]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with SeveralLoop(tmp_path, ALL) as loop:
        loop.run_to(FAILS_AT)
        error = AnotherControllerError("not started: another controller")
        monkeypatch.setattr(loop.sessions[FAILING]._other, "check", lambda *_a, **_o: exec_raise(error))
        loop.run_to(END, *OTHERS)
        assert frames_of(loop) == undisturbed
        assert loop.plants[FAILING].sample <= FAILS_AT + 2
        assert loop.logged("another controller") == [
            "FV-4: not started: another controller; this valve is not controlled any more"
        ]


def exec_raise(error: Exception) -> None:
    raise error


def test_the_error_of_the_last_valve_ends_the_daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with SeveralLoop(tmp_path, ("FV-1", "FV-2")) as loop:
        loop.run_to(5)
        for session in loop.sessions.values():
            error = AnotherControllerError(f"of {session.announcer.name}")
            monkeypatch.setattr(session._other, "check", lambda *_a, error=error, **_o: exec_raise(error))
        with pytest.raises(AnotherControllerError, match="of FV-2"):
            loop.run_to(10)
        assert loop.logged("not controlled any more") == ["FV-1: of FV-1; this valve is not controlled any more"]


def test_a_state_directory_that_another_process_holds_refuses_the_start_and_names_the_valve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = lock.acquire
    monkeypatch.setattr(lock, "acquire", lambda directory, *_timeout_and_report: real(directory, 0.0))
    held = tmp_path / "state" / FAILING
    held.mkdir(parents=True)
    descriptor = real(held, 0.0)
    with pytest.raises(AlreadyRunningError, match=f"^valve FV-4: {held}: in use by process"):
        SeveralLoop(tmp_path, ALL)
    os.close(descriptor)
    for name in ALL:  # their table writers have ended
        os.close(real(tmp_path / "state" / name, 0.0))


def test_a_law_that_cannot_be_made_refuses_the_start_and_names_the_valve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = Configuration.make_law
    monkeypatch.setattr(
        Configuration,
        "make_law",
        lambda self, *, plays=False: raising() if self.valve.id == FAILING else real(self, plays=plays),
    )
    with pytest.raises(ValueError, match=r"^valve FV-4: no such valve$"):
        SeveralLoop(tmp_path, ALL)
    for name in ALL:
        with lock.held(tmp_path / "state" / name, 0.0):
            pass


def test_the_silence_of_one_valve_is_timed_by_the_clock_and_not_by_the_frames_of_the_others(tmp_path: Path) -> None:
    with SeveralLoop(tmp_path, ALL, lockstep=False) as loop:
        loop.run_to(FAILS_AT)
        plant = loop.plants[FAILING]
        lost_ns, before = loop.time.now_ns, len(plant.sent)
        plant.is_silent = True
        loop.run_to(FAILS_AT + 60, *OTHERS)
        logged = zip(loop.lines, loop.logged_ns, strict=True)
        after = {line: (at_ns - lost_ns) / PERIOD_NS for line, at_ns in logged if line.startswith("FV-4: mode")}
        # after three periods without a reading and after ten, looked at every period
        assert 3.0 < after["FV-4: mode ACTIVE -> HOLD (feedback stale)"] <= 4.1
        assert 10.0 < after["FV-4: mode HOLD -> FAILSAFE (feedback stale)"] <= 11.1
        sent = list(zip(plant.messages(), plant.sent_ns, strict=True))[before:]
        repeated_ns = [at_ns for message, at_ns in sent if isinstance(message, CurrentCommand)]
        assert len(repeated_ns) >= 5
        assert {round((second - first) / PERIOD_NS) for first, second in pairwise(repeated_ns)} <= {10, 11}
        commands = [m for name in OTHERS for m in loop.plants[name].messages() if isinstance(m, CurrentCommand)]
        assert {command.mode for command in commands} == {Mode.ACTIVE}


def test_each_command_answers_the_newest_reading_of_its_own_valve_at_once(tmp_path: Path) -> None:
    with SeveralLoop(tmp_path, ALL, lockstep=False) as loop:
        loop.run_to(FAILS_AT)
        for plant in loop.plants.values():
            answered = [m.position_counter for m in plant.messages() if isinstance(m, CurrentCommand)]
            assert answered == list(range(len(answered)))
            assert plant.sample - len(answered) <= 1


def test_a_frame_for_one_of_several_valves_waits_for_no_room_in_a_full_transmit_queue(tmp_path: Path) -> None:
    with SeveralLoop(tmp_path / "two", ("FV-1", "FV-2"), ("FV-2",)) as loop:
        assert {session.port.room_within_s for session in loop.daemon.sessions} == {0.0}
    with SeveralLoop(tmp_path / "one", ("FV-1",)) as loop:
        assert loop.daemon.sessions[0].port.room_within_s == ROOM_WITHIN_S


def test_all_tables_are_saved_at_the_same_time_and_one_that_hangs_delays_the_end_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_module, "CLOSE_TIMEOUT_S", 2.0)
    begun: list[bool] = []
    close = session_module.Session.close

    def seen(session: session_module.Session, timeout_s: float) -> str | None:
        begun.append(all(each.table.writer._is_closing for each in loop.sessions.values()))
        return close(session, timeout_s)

    monkeypatch.setattr(session_module.Session, "close", seen)
    with SeveralLoop(tmp_path, ALL) as loop:
        loop.run_to(FAILS_AT)
        hanging = [loop.sessions[name].table.writer._child.process for name in (OTHERS[0], FAILING)]
        for process in hanging:
            process.send_signal(signal.SIGSTOP)
    for process in hanging:
        process.send_signal(signal.SIGCONT)
        process.wait(60.0)
    assert loop.code is ExitCode.IO
    assert begun == [True] * len(ALL)  # all save while the first one is waited for
    assert {line[:5] for line in loop.logged("table writer")} == {"FV-1:", "FV-4:"}
    tables = {name: access.dump(tmp_path / "state" / name).table for name in ALL}
    assert tables == {name: loop.sessions[name].state.table for name in ALL}
