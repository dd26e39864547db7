"""How a run in real time kept time: late cycles by mode, and the pace of the seconds that nobody disturbed."""

from __future__ import annotations

import os
from dataclasses import replace

import pytest

from positioner.bench import machine_load
from positioner.bench.machine_load import MachineLoad
from positioner.bench.processes import prioritize
from positioner.bench.timing import Answered, Second, answers, timing_lines, timing_of
from positioner.wire.codec import make_codec
from positioner.wire.messages import CanFrame, CurrentCommand, Mode, Motion, StemPosition

CODEC = make_codec()
MS = 1e-3
DUE_S = 0.8 * MS


def reading(number: int, at_s: float) -> tuple[float, CanFrame]:
    return at_s, CODEC.encode(StemPosition(0.08), number)


def command(
    answers_to: int, at_s: float, motion: Motion = Motion.REST, mode: Mode = Mode.ACTIVE
) -> tuple[float, CanFrame]:
    frame = CODEC.encode(CurrentCommand(12.0, answers_to % 256, mode=mode, motion=motion), answers_to)
    return at_s, frame


def run(count: int, delay_s: float = 0.3 * MS, motion: Motion = Motion.REST) -> list[Answered]:
    return [Answered(n * MS, n * MS + delay_s, Mode.ACTIVE, motion) for n in range(count)]


def test_each_reading_has_the_command_that_names_it_across_the_wrap_of_the_counters() -> None:
    frames = [frame for n in range(600) for frame in (reading(n, n * MS), command(n, (n + 0.3) * MS))]
    found = answers(CODEC, reversed(frames))
    assert len(found) == 600
    assert [each.read_s for each in found] == pytest.approx([n * MS for n in range(600)])
    assert {round((each.came_s or 0.0) - each.read_s, 9) for each in found} == {0.3 * MS}


def test_a_reading_that_was_skipped_has_the_motion_of_the_next_command() -> None:
    frames = [reading(n, n * MS) for n in range(5)]
    frames += [command(1, 1.2 * MS), command(3, 3.9 * MS, Motion.MOVE, Mode.HOLD), command(3, 4.5 * MS)]
    found = answers(CODEC, frames)
    assert [each.came_s for each in found] == [1.2 * MS, None, 3.9 * MS]
    assert [each.is_late(DUE_S) for each in found] == [False, True, True]
    assert [(each.mode, each.motion) for each in found[1:]] == [(Mode.HOLD, Motion.MOVE)] * 2


def test_a_damaged_frame_and_commands_without_a_reading_are_left_out() -> None:
    broken = replace(reading(0, 0.0)[1], data=bytes(8))
    assert answers(CODEC, [(0.0, broken), command(7, 0.1 * MS), reading(1, 1 * MS)]) == ()


def test_late_cycles_are_counted_by_motion_and_by_mode() -> None:
    answered = [*run(3), *run(2, 0.9 * MS, Motion.MOVE), Answered(5 * MS, None, Mode.HOLD, Motion.SETTLE)]
    timing = timing_of(answered, [Second(0.0, 2.0)], DUE_S, "SCHED_FIFO")
    assert timing.late == 3
    assert timing.late_by_motion == {"MOVE": 2, "SETTLE": 1}
    assert timing.late_by_mode == {"ACTIVE": 2, "HOLD": 1}


def test_only_quiet_seconds_are_judged() -> None:
    answered = run(3000)
    answered[1500:1600] = [replace(each, came_s=each.read_s + 1.5 * MS) for each in answered[1500:1600]]
    seconds = [Second(0.0, 0.05), Second(1.0, 1.2), Second(2.0, 0.0)]
    timing = timing_of(answered, seconds, DUE_S, "SCHED_FIFO")
    assert timing.whole is not None
    assert timing.quiet is not None
    assert (timing.quiet.seconds, timing.quiet.cycles, timing.quiet.in_time) == (2, 2000, 1.0)
    assert timing.quiet.delay_max_s == pytest.approx(0.3 * MS)
    assert timing.quiet.period_max_s == pytest.approx(1.0 * MS)
    assert timing.whole.in_time == pytest.approx(2900 / 3000)
    assert timing.whole.period_max_s == pytest.approx(2.2 * MS)
    assert timing.whole.period_mean_s == pytest.approx(1.0 * MS, rel=1e-3)
    assert timing.foreign_processors == pytest.approx(1.25 / 3)


def test_a_second_of_which_the_host_took_a_part_is_not_judged() -> None:
    timing = timing_of(run(2000), [Second(0.0, 0.0, stolen_s=0.01), Second(1.0, 0.0)], DUE_S, "SCHED_FIFO")
    assert timing.quiet is not None
    assert (timing.quiet.seconds, timing.quiet.cycles) == (1, 1000)


def test_without_a_quiet_second_nothing_is_judged_and_the_text_says_so() -> None:
    timing = timing_of(run(100), [Second(0.0, 1.5)], DUE_S, "SCHED_OTHER")
    assert timing.quiet is None
    first, second, *_ = timing_lines(timing, MS)
    assert first == "late cycles: 0"
    assert second == "not judged: in each second others used the processors (1.50 processors on average)"


def test_the_lines_name_part_delay_and_period() -> None:
    lines = timing_lines(timing_of([*run(999), Answered(0.999, None)], [Second(0.0, 0.0)], DUE_S, "SCHED_FIFO"), MS)
    assert lines[0] == "late cycles: 1 (1 NONE; 1 INIT)"
    assert lines[1] == "quiet seconds: 1; 99.9 % of 1000 commands within 0.8 ms"
    assert lines[2] == "  delay 0.30 ms, 99 % 0.30, longest 0.30; period 1.0000, longest 1.00 sample periods"


def test_a_run_without_an_answer_has_no_pace() -> None:
    timing = timing_of([], [], DUE_S, "SCHED_FIFO")
    assert (timing.whole, timing.quiet, timing.late, timing.foreign_processors) == (None, None, 0, 0.0)


def test_the_load_of_others_is_what_is_busy_beyond_the_bench(monkeypatch: pytest.MonkeyPatch) -> None:
    stat_s, used_s = iter([(100.0, 3.0), (100.9, 3.0), (102.6, 3.02)]), iter([5.0, 5.6, 6.0])
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(machine_load, "_idle_and_stolen_s", lambda: next(stat_s))
    monkeypatch.setattr(MachineLoad, "_used_s", lambda _self: next(used_s))
    load = MachineLoad(7_000_000_000, [])
    for now_ns in (7_500_000_000, 8_000_000_000, 8_999_999_999, 9_000_000_000):
        load.look(now_ns)
    # 2 s of processor time, 0.9 s idle, 0.6 s the bench's own; then 1.7 s idle and 0.4 s own
    assert [second.begin_s for second in load.seconds] == [0.0, 1.0]
    assert [second.foreign_processors for second in load.seconds] == pytest.approx([0.5, 0.0])
    assert [second.stolen_s for second in load.seconds] == pytest.approx([0.0, 0.02])


def test_the_bench_counts_itself_and_its_children() -> None:
    load = MachineLoad(0, [os.getpid()])
    assert os.getpid() in load._pids
    before_s = load._used_s()
    sum(range(2_000_000))
    assert load._used_s() > before_s > 0.0
    assert machine_load._used_by(2**22 + 7) == 0.0
    assert machine_load._children(2**22 + 7) == []
    assert str(os.cpu_count()) in machine_load.machine()


def test_a_priority_that_the_system_refuses_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int, int]] = []

    def allow(pid: int, policy: int, parameter: os.sched_param) -> None:
        asked.append((pid, policy, parameter.sched_priority))

    def refuse(*_arguments: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", allow)
    assert prioritize(7, 50)
    assert prioritize(0, 0)
    reset = os.SCHED_RESET_ON_FORK
    assert asked == [(7, os.SCHED_FIFO | reset, 50), (0, os.SCHED_OTHER | reset, 0)]
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert not prioritize(7, 50)
