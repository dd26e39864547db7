"""The straight line: frames in, frames out, step by step; the same frames give the same frames."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import load_scenario
from positioner.cycle.alarms import packed
from positioner.cycle.counters import Counters
from positioner.cycle.deviation import NO_DEVIATION, Deviates
from positioner.cycle.events import (
    Controlled,
    Event,
    ForeignCommand,
    LawFellBack,
    Learned,
    LinesDropped,
    ModeChanged,
)
from positioner.cycle.input import CycleInput
from positioner.cycle.sent import NONE_SENT
from positioner.cycle.state import CycleState, Setup
from positioner.cycle.step import step
from positioner.cycle.timing_events import LawLate
from positioner.cycle.trust_events import ActingChanged, PushFailed
from positioner.guard.settings import FailsafeAction, GuardSettings
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Estimate, Observation
from positioner.valve.parameters import ValveParameters
from positioner.valve.state import StemState
from positioner.valve.stick_slip import edge_lessons
from positioner.valve.stiction import Direction, LearnedSample, Quantity, StictionTable
from positioner.wire.codec import make_codec
from positioner.wire.messages import (
    CanFrame,
    Cause,
    Counted,
    CurrentCommand,
    Health,
    HostRequest,
    Mode,
    Motion,
    PositionerAlarms,
    PositionerCount,
    PositionerStatus,
    Setpoint,
    StemPosition,
)
from positioner.wire.settings import MessageSettings, WireSettings

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

CODEC = make_codec()
VALVE = ValveParameters(id="paper")
PERIOD_S = 0.001
MS = 1_000_000
WIDE = Bounds(-10.0, 10.0, 4.0, 20.0)
RESTING = StemState(0.08, 0.0, stuck=True, direction=1.0)
SLIDING = StemState(0.08, 0.1, stuck=False, direction=1.0)


class ScriptedLaw:
    """Estimates the stems of a script, answers 10 mA and a thousandth more each time, and keeps its observations."""

    name = "scripted"

    def __init__(self, stems: Iterable[StemState] = (), fallback: str = "") -> None:
        self.stems = iter(stems)
        self.stem = RESTING
        self.fallback = fallback
        self.shown: list[Observation] = []
        self.begun_m: list[float] = []
        self.fails = False

    def begin(self, measured_m: float) -> int:
        self.begun_m.append(measured_m)
        return 0

    def estimate(self, memory: int, observation: Observation) -> tuple[int, Estimate]:
        self.shown.append(observation)
        before, self.stem = self.stem, next(self.stems, RESTING)
        return memory, Estimate(self.stem, edge_lessons(before, self.stem, observation.applied_ma))

    def decide(
        self, memory: int, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[int, Decision]:
        del stem, observation, table
        if self.fails:
            raise RuntimeError("scripted")
        return memory + 1, Decision(10.0 + 0.001 * memory, WIDE, Motion.MOVE, passes=1, fallback=self.fallback)


class Exchange:
    """A positioner, and scripted frames for it: one position frame each millisecond."""

    def __init__(
        self, law: ScriptedLaw | None = None, guard: GuardSettings | None = None, *, learns: bool = True
    ) -> None:
        self.law = law or ScriptedLaw()
        self.setup = Setup(CODEC, VALVE, guard or GuardSettings(auto_arm=True), self.law, PERIOD_S, learns)
        self.state = CycleState()
        self.now_ns = 1000 * MS
        self.counter = 0
        self.setpoints = 0
        self.events: list[Event] = []

    def step(self, *frames: CanFrame, elapsed_ns: int = MS, **given: Any) -> tuple[CanFrame, ...]:
        self.now_ns += elapsed_ns
        self.state, outbox, events = step(self.setup, self.state, CycleInput(frames, self.now_ns, **given))
        self.events += events
        return outbox

    def sample(
        self, position_m: float = 0.08, echo: int | None = None, setpoint: Setpoint | None = None, **given: Any
    ) -> tuple[CanFrame, ...]:
        # without an `echo`, the plant has obeyed the newest command
        newest = self.state.output.sent.last
        counter = 0 if newest is None else newest.counter
        frames = [CODEC.encode(StemPosition(position_m, counter if echo is None else echo), self.counter)]
        self.counter += 1
        if setpoint is not None:
            frames.insert(0, CODEC.encode(setpoint, self.setpoints))
            self.setpoints += 1
        return self.step(*frames, **given)

    def events_of(self, kind: type[Event]) -> list[Event]:
        return [event for event in self.events if isinstance(event, kind)]


def commands(outbox: Iterable[CanFrame]) -> list[tuple[CurrentCommand, int | None]]:
    decoded = (CODEC.decode(frame) for frame in outbox)
    return [(message, counter) for message, counter in decoded if isinstance(message, CurrentCommand)]


def test_a_scripted_exchange_gives_these_frames() -> None:
    exchange = Exchange(guard=GuardSettings())
    exchange.step(CODEC.encode(Setpoint(0.087), 255))
    seen = [
        exchange.sample(0.08),
        exchange.sample(0.08, setpoint=Setpoint(0.087, HostRequest.ARM)),
        exchange.sample(0.0801, echo=0),
        exchange.sample(0.0802, echo=1, setpoint=Setpoint(0.087, HostRequest.DISARM)),
    ]
    assert [[(frame.arbitration_id, frame.data.hex()) for frame in outbox] for outbox in seen] == [
        # CRC, counter, READY, FUNCTION_CHECK, waiting for arm, not armed, saved
        [(0x140, "a061003182000000")],
        # CRC, counter, 10000 µA, answers reading 1, obeys setpoint 0, ACTIVE and MOVE; then ACTIVE, GOOD, armed, saved
        [(0x100, "255a001027010022"), (0x140, "2c460102c0000000")],
        [(0x100, "454b011127020022")],
        [],
    ]


def test_a_cycle_answers_each_reading_with_a_command_that_names_it() -> None:
    exchange = Exchange()
    for sample in range(300):
        ((command, counter),) = commands(exchange.sample(setpoint=Setpoint(0.087) if sample == 5 else None))
        assert counter == sample % 256
        assert command.position_counter == sample % 256
        assert command.current_ma == pytest.approx(10.0 + 0.001 * sample, abs=5e-4)
        assert (command.mode, command.motion) == (Mode.ACTIVE, Motion.MOVE)


def test_without_a_reading_nothing_is_sent_while_feedback_is_young() -> None:
    exchange = Exchange()
    exchange.sample()
    assert exchange.step(elapsed_ns=3 * MS) == ()
    assert exchange.step(CODEC.encode(Setpoint(0.08), 0), elapsed_ns=0) == ()


def test_in_hold_and_failsafe_the_last_command_is_repeated_every_ten_milliseconds() -> None:
    exchange = Exchange()
    exchange.sample()
    assert commands(exchange.step(elapsed_ns=4 * MS)) == []
    ((held, _),) = commands(exchange.step(elapsed_ns=6 * MS))
    assert (held.mode, held.current_ma, held.motion) == (Mode.HOLD, 10.0, Motion.NONE)
    assert commands(exchange.step(elapsed_ns=9 * MS)) == []
    ((safe, _),) = commands(exchange.step(elapsed_ns=MS))
    assert (safe.mode, safe.current_ma) == (Mode.FAILSAFE, 4.0)
    assert len(commands(exchange.step(elapsed_ns=10 * MS))) == 1


def test_a_command_without_a_new_reading_goes_on_naming_the_last_one() -> None:
    exchange = Exchange()
    for _ in range(8):
        exchange.sample()
    exchange.step(CODEC.encode(StemPosition(-0.5), 8))  # refused: it lies outside the travel
    ((held, _),) = commands(exchange.step(elapsed_ns=9 * MS))
    ((safe, _),) = commands(exchange.step(elapsed_ns=10 * MS))
    assert [(each.mode, each.position_counter) for each in (held, safe)] == [(Mode.HOLD, 7), (Mode.FAILSAFE, 7)]


def test_a_table_from_outside_takes_the_place_of_the_present_one_and_stays() -> None:
    setup = Setup(CODEC, VALVE, GuardSettings(), ScriptedLaw(), PERIOD_S)
    other = StictionTable().record(Quantity.STICK_SPEED, 0.08, Direction.OPENING, 0.01)
    before = CycleState()
    replaced, _, _ = step(setup, before, CycleInput((), 1 * MS, table=other))
    after, _, _ = step(setup, replaced, CycleInput((), 2 * MS))
    assert (before.table, replaced.table, after.table) == (StictionTable(), other, other)


def test_the_status_is_sent_ten_times_a_second_from_the_first_reading_on_and_at_once_when_it_is_armed() -> None:
    exchange = Exchange(guard=GuardSettings())
    stamps_ms = []
    for sample in range(1000):
        request = HostRequest.ARM if sample >= 50 else HostRequest.NONE
        outbox = exchange.sample(setpoint=Setpoint(0.08, request) if sample % 10 == 0 else None)
        if any(frame.arbitration_id == 0x140 for frame in outbox):
            stamps_ms.append(sample)
    assert stamps_ms == [0, *range(50, 1000, 100)]


def test_before_the_first_reading_nothing_is_sent_and_unarmed_beside_another_controller_no_status() -> None:
    silent = Exchange(guard=GuardSettings())
    for _ in range(300):
        assert silent.step(CODEC.encode(Setpoint(0.08), 0)) == ()
    beside = Exchange(guard=GuardSettings())
    for counter in range(200):
        foreign = CODEC.encode(CurrentCommand(9.5), counter)
        assert beside.step(foreign, CODEC.encode(StemPosition(0.08), counter)) == ()
    beside.counter = 200
    alone = [beside.sample() for _ in range(1300)]
    stamps_ms = [sample for sample, outbox in enumerate(alone) if outbox]
    assert stamps_ms == list(range(1000, 1300, 100))  # a foreign command is remembered for a second


def test_the_status_reports_mode_health_and_counts() -> None:
    exchange = Exchange(ScriptedLaw([RESTING, SLIDING, RESTING], fallback="no plan"))
    exchange.state = replace(exchange.state, counters=Counters(fallbacks=255))
    bad = replace(CODEC.encode(StemPosition(0.08), 0), data=bytes(8))
    exchange.step(bad)
    for _ in range(101):
        outbox = exchange.sample(table_saved=False)
    expected = PositionerStatus(Mode.ACTIVE, Cause.NONE, Health.MAINTENANCE_REQUIRED, True, False, 100, 1, 2)
    status, count = outbox[-2:]
    assert CODEC.decode(status) == (expected, 1)
    assert CODEC.decode(count) == (PositionerCount(Counted.WRONG_CRC, 1), 1)


def test_alarms_of_the_valve_follow_the_status_and_raise_its_health() -> None:
    exchange = Exchange()
    for _ in range(50):
        assert all(frame.arbitration_id != 0x142 for frame in exchange.sample())
    alarms = packed(Health.OUT_OF_SPECIFICATION, 0x0081, 0x0080)
    sent = [frame for _ in range(101) for frame in exchange.sample(alarms=alarms)]
    status, told = (next(each for each in sent if each.arbitration_id == number) for number in (0x140, 0x142))
    shown, _ = CODEC.decode(status)
    assert isinstance(shown, PositionerStatus)
    assert shown.health is Health.OUT_OF_SPECIFICATION
    assert CODEC.decode(told)[0] == PositionerAlarms(Health.OUT_OF_SPECIFICATION, 2, 0x0081, 0x0080)
    sent = [frame for _ in range(101) for frame in exchange.sample(alarms=0)]
    over = [CODEC.decode(frame)[0] for frame in sent if frame.arbitration_id in {0x140, 0x142}]
    assert [each.health for each in over if isinstance(each, PositionerStatus)] == [Health.GOOD]
    assert PositionerAlarms(Health.GOOD, 0, 0, 0) in over


def test_a_guard_that_is_worse_than_the_alarms_keeps_its_health() -> None:
    exchange = Exchange(guard=GuardSettings(auto_arm=True, feedback_hold_periods=5))
    alarms = packed(Health.MAINTENANCE_REQUIRED, 1, 1)
    for _ in range(20):
        exchange.sample(alarms=alarms)
    sent = [frame for _ in range(300) for frame in exchange.step(alarms=alarms)]
    shown = [CODEC.decode(frame)[0] for frame in sent if frame.arbitration_id == 0x140]
    assert shown
    assert all(isinstance(each, PositionerStatus) and each.health > Health.MAINTENANCE_REQUIRED for each in shown)


def test_a_late_cycle_is_counted_reported_once_and_changes_no_current() -> None:
    exchange, punctual = Exchange(), Exchange()
    for sample in range(102):
        frames, others = exchange.sample(late_ns=1_500_000 if sample == 50 else 0), punctual.sample()
        assert frames[0] == others[0]
    (event,) = exchange.events_of(LawLate)
    assert str(event).startswith("a cycle took 1.5 ms, longer than the period of 1 ms: give the positioner")
    assert exchange.state.counters.by_cause == {Counted.LAW_LATE: 1}
    for _ in range(20):
        exchange.sample(late_ns=1_500_000)
    assert exchange.state.guard.cause is Cause.LAW_LATE


def test_lines_of_the_log_that_were_dropped_are_counted_once() -> None:
    exchange = Exchange()
    exchange.sample()
    exchange.sample(lines_dropped=7)
    exchange.sample()
    assert exchange.events_of(LinesDropped) == [LinesDropped(count=7)]
    assert exchange.state.counters.by_cause == {Counted.LINE_DROPPED: 7}


class Pusher(ScriptedLaw):
    """Asks for 20 mA at every reading."""

    def decide(
        self, memory: int, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[int, Decision]:
        del stem, observation, table
        return memory, Decision(20.0, WIDE)


def test_a_frozen_sensor_leads_to_hold_and_failsafe_with_its_cause_and_arming_starts_again() -> None:
    exchange = Exchange(Pusher(), GuardSettings(auto_arm=True, frozen_s=0.2505))
    modes = []
    for _ in range(270):
        exchange.sample(0.05)
        modes.append((exchange.state.guard.mode, exchange.state.guard.cause))
    frozen = Cause.FEEDBACK_FROZEN
    # the first sample arms; 250 periods under a command later the time is not yet up, after 251 it is
    assert modes[:254] == [(Mode.ACTIVE, Cause.NONE)] * 254
    assert modes[254:261] == [(Mode.HOLD, frozen)] * 7
    assert modes[261:] == [(Mode.FAILSAFE, frozen)] * 9
    assert exchange.state.output.last_ma == 4.0
    exchange.sample(0.05, setpoint=Setpoint(0.06, HostRequest.NONE))
    exchange.sample(0.05, setpoint=Setpoint(0.06, HostRequest.ARM))
    assert exchange.state.guard.mode is Mode.ACTIVE


def test_a_stem_that_moves_under_the_same_command_is_not_frozen() -> None:
    exchange = Exchange(Pusher(), GuardSettings(auto_arm=True, frozen_s=0.1505, setpoint_hold_s=0.0))
    for sample in range(1000):
        exchange.sample(0.05 + 1e-8 * (sample // 100))
    assert exchange.state.guard.mode is Mode.ACTIVE


def test_the_plants_echo_shows_which_current_acted() -> None:
    exchange = Exchange()
    for echo in (None, 0, 0, 2, 1):
        exchange.sample(echo=echo)
    applied = [seen.applied_ma for seen in exchange.law.shown]
    # before the first command the spring is balanced; an echo of an older command is believed
    assert applied == pytest.approx([VALVE.balance_current_ma(0.08), 10.0, 10.0, 10.002, 10.001])


def test_an_echo_of_what_was_never_sent_means_the_last_command() -> None:
    exchange = Exchange()
    exchange.sample()
    exchange.sample(echo=200)
    assert exchange.law.shown[-1].applied_ma == 10.0


def test_each_counter_names_the_newest_command_that_had_it() -> None:
    exchange = Exchange()
    for _ in range(300):
        exchange.sample()
    known = [each for each in range(256) if exchange.state.output.sent.named(each, 256) is not None]
    assert known == [each for each in range(256) if each != 44]
    # 44 is forgotten, so that the last one counts; 43 is the newest, of 299; 60 is still known
    for echo, sample in ((44, 299), (43, 299), (60, 60)):
        exchange.sample(echo=echo)
        assert exchange.law.shown[-1].applied_ma == pytest.approx(10.0 + 0.001 * sample, abs=1e-9)


def test_a_node_that_names_the_same_command_for_too_long_is_reported_and_so_is_its_end() -> None:
    exchange = Exchange()
    for echo in (None, *([0] * 110), None, None):
        exchange.sample(echo=echo)
    assert [str(event)[:40] for event in exchange.events_of(ActingChanged)] == [
        "the valve's node takes no command of our",
        "commands act on the valve again: the law",
    ]
    assert len(exchange.law.begun_m) == 2


ECHOLESS_DBC = """VERSION ""
BU_: PLANT POSITIONER
BO_ 512 POS: 8 PLANT
 SG_ Pos : 0|32@1+ (0.001,0) [0|0] "mm" POSITIONER
"""


def test_without_an_echo_the_last_command_acted(tmp_path: Path) -> None:
    path = tmp_path / "echoless.dbc"
    path.write_text(ECHOLESS_DBC, encoding="utf-8")
    signals = MessageSettings(message="POS", signals={"position_m": "Pos"})
    codec = make_codec(WireSettings(dbc=path, stem_position=signals))
    exchange = Exchange()
    exchange.setup = replace(exchange.setup, codec=codec)
    for _ in range(3):
        exchange.step(codec.encode(StemPosition(0.08), 0))
    assert [seen.applied_ma for seen in exchange.law.shown] == pytest.approx([12.598, 10.0, 10.001], abs=1e-3)


def test_a_setpoint_is_held_until_the_next_one() -> None:
    exchange = Exchange()
    exchange.sample(0.0795)
    exchange.sample(0.0795, setpoint=Setpoint(0.087))
    exchange.sample(0.0795)
    exchange.sample(0.0795, setpoint=Setpoint(0.2))
    exchange.sample(0.0795, setpoint=Setpoint(0.073))
    # before the first one, the stem is held where it was found
    assert [seen.setpoint_m for seen in exchange.law.shown] == pytest.approx([0.0795, 0.087, 0.087, 0.087, 0.073])


def test_in_hold_the_law_goes_on_with_the_setpoint_it_has() -> None:
    exchange = Exchange()
    exchange.sample(0.08, setpoint=Setpoint(0.087))
    for _ in range(600):
        ((command, _),) = commands(exchange.sample())
    assert (command.mode, command.motion) == (Mode.HOLD, Motion.MOVE)
    assert command.current_ma == pytest.approx(10.6)
    assert exchange.law.shown[-1].setpoint_m == pytest.approx(0.087)
    assert len(exchange.law.begun_m) == 1


@pytest.mark.parametrize(("position_m", "held_m"), [(-0.01, 0.0), (0.15, 0.1397)])
def test_where_control_begins_beyond_the_travel_a_stop_is_the_setpoint(position_m: float, held_m: float) -> None:
    exchange = Exchange()
    exchange.sample(position_m)
    assert exchange.law.shown[0].setpoint_m == held_m
    assert exchange.law.begun_m == [position_m]


def test_an_error_that_stays_is_reported_once_shown_in_the_status_and_ends_where_control_ends() -> None:
    exchange = Exchange()
    sent: list[CanFrame] = []
    for sample in range(2500):
        setpoint = Setpoint(0.092) if sample % 100 == 0 else None
        sent += exchange.sample(0.08, (exchange.state.output.command_counter - 1) % 256, setpoint)
    (deviates,) = exchange.events_of(Deviates)
    assert str(deviates).startswith("deviation: the stem is 12.0 mm below its setpoint of 92.0 mm and came no nearer")
    status = [message for message, _ in map(CODEC.decode, sent) if isinstance(message, PositionerStatus)][-1]
    assert (status.mode, status.cause, status.health) == (Mode.ACTIVE, Cause.DEVIATION, Health.OUT_OF_SPECIFICATION)
    exchange.step(elapsed_ns=11 * MS)
    exchange.sample()
    assert exchange.state.guard.mode is Mode.FAILSAFE
    assert exchange.state.deviation == NO_DEVIATION


def test_lost_frames_count_in_the_laws_time() -> None:
    exchange = Exchange()
    exchange.sample()
    exchange.counter += 2
    exchange.sample()
    assert [seen.elapsed_s for seen in exchange.law.shown] == pytest.approx([0.001, 0.003])
    assert [seen.time_s for seen in exchange.law.shown] == pytest.approx([0.0, 0.001])
    assert exchange.state.control.time_s == pytest.approx(0.004)


def test_edges_are_learned_counted_and_reported() -> None:
    exchange = Exchange(ScriptedLaw([RESTING, SLIDING, SLIDING, RESTING]))
    for _ in range(4):
        exchange.sample()
    slip = LearnedSample(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.OPENING, 10.0)
    stop = LearnedSample(Quantity.STICK_SPEED, 0.08, Direction.OPENING, 0.1)
    assert exchange.events_of(Learned) == [Learned(slip, 1), Learned(stop, 2)]
    assert (exchange.state.table.sequence, exchange.state.counters.learned) == (2, 2)
    assert "learned breakaway_current_ma = 10 at 80.00 mm, opening" in str(exchange.events[-5])


def test_a_dry_run_learns_nothing() -> None:
    exchange = Exchange(ScriptedLaw([RESTING, SLIDING, RESTING]), learns=False)
    for _ in range(3):
        exchange.sample()
    assert exchange.events_of(Learned) == []
    assert exchange.state.table.sequence == 0


def test_what_was_learned_before_a_law_failed_is_kept_where_it_was_reported() -> None:
    exchange = Exchange(ScriptedLaw([RESTING, SLIDING]))
    exchange.sample()
    exchange.law.fails = True
    ((command, _),) = commands(exchange.sample())
    assert command.current_ma == 10.0
    assert len(exchange.events_of(Learned)) == exchange.state.table.sequence == exchange.state.counters.learned == 1
    (fallback,) = exchange.events_of(LawFellBack)
    assert str(fallback) == "law fell back: scripted failed: RuntimeError: scripted"


def test_after_a_failure_the_law_starts_again_and_nothing_is_learned_from_the_gap() -> None:
    exchange = Exchange(ScriptedLaw([SLIDING, SLIDING, RESTING]))
    exchange.sample()
    exchange.law.fails = True
    exchange.sample()
    exchange.law.fails = False
    exchange.sample()
    assert len(exchange.law.begun_m) == 2
    assert exchange.events_of(Learned) == []
    assert exchange.state.guard.law.failures == 0


def test_a_law_that_falls_back_reports_why_and_still_counts_as_working() -> None:
    exchange = Exchange(ScriptedLaw(fallback="no plan"))
    for _ in range(30):
        exchange.sample()
    assert exchange.state.counters.fallbacks == 30
    assert exchange.state.guard.mode is Mode.ACTIVE
    assert exchange.events_of(LawFellBack) == [LawFellBack("no plan")] * 30


def test_disarming_ends_control_and_forgets_the_commands() -> None:
    exchange = Exchange(guard=GuardSettings())
    exchange.sample(setpoint=Setpoint(0.08))
    exchange.sample(setpoint=Setpoint(0.08, HostRequest.ARM))
    assert exchange.state.control.memory is not None
    assert commands(exchange.sample(setpoint=Setpoint(0.08, HostRequest.DISARM))) == []
    control, sent = exchange.state.control, exchange.state.output.sent
    assert (control.memory, control.stem, sent) == (None, None, NONE_SENT)
    assert [str(event) for event in exchange.events_of(ModeChanged)] == [
        "mode INIT -> READY (waiting for arm)",
        "mode READY -> ACTIVE (none)",
        "mode ACTIVE -> READY (disarmed)",
    ]


@pytest.mark.parametrize("rate_ma_per_s", [0.0, 0.3])
def test_our_own_command_that_the_bus_brings_back_is_not_foreign(rate_ma_per_s: float) -> None:
    exchange = Exchange(guard=GuardSettings(auto_arm=True, max_rate_ma_per_s=rate_ma_per_s))  # steps of less than a bit
    exchange.sample()
    (doubled,) = (frame for frame in exchange.sample() if frame.arbitration_id == 0x100)
    for _ in range(3):
        exchange.step(doubled)
        exchange.sample()
    assert exchange.events_of(ForeignCommand) == []
    assert exchange.state.guard.mode is Mode.ACTIVE
    ((own, counter),) = commands([doubled])
    for other in (
        CODEC.encode(own, (counter or 0) + 100),
        CODEC.encode(replace(own, current_ma=own.current_ma + 3e-3), 1),
    ):
        fresh = Exchange()
        fresh.sample()
        fresh.sample()
        fresh.step(other)
        assert len(fresh.events_of(ForeignCommand)) == 1
        assert fresh.state.guard.mode is Mode.READY


def test_a_second_daemon_that_sends_the_same_is_found_when_it_sends_something_else() -> None:
    exchange = Exchange(guard=GuardSettings(auto_arm=True, setpoint_hold_s=0.0, setpoint_failsafe_s=0.0))
    doubled = exchange.sample()
    for cycle in range(3000):
        exchange.step(*(frame for frame in doubled if frame.arbitration_id == 0x100 and cycle % 2))
        doubled = exchange.sample()
    assert exchange.events_of(ForeignCommand) == []
    exchange.step(CODEC.encode(CurrentCommand(9.5), 77))
    assert (exchange.state.guard.mode, exchange.state.guard.cause) == (Mode.READY, Cause.FOREIGN_COMMAND)


@pytest.mark.parametrize(("of_five", "found_after"), [(5, range(40, 60)), (4, range(200, 300)), (3, range(0))])
def test_a_second_daemon_that_keeps_sending_the_same_is_found_and_a_bus_that_doubles_is_not(
    of_five: int, found_after: range
) -> None:
    exchange = Exchange(guard=GuardSettings(auto_arm=True, setpoint_hold_s=0.0, setpoint_failsafe_s=0.0))
    doubled, cycles = exchange.sample(), 0
    while exchange.state.guard.arming.armed and cycles < 3000:
        exchange.step(*(frame for frame in doubled if frame.arbitration_id == 0x100 and cycles % 5 < of_five))
        doubled, cycles = exchange.sample(), cycles + 1
    assert cycles in (found_after or range(3000, 3001))
    assert len(exchange.events_of(ForeignCommand)) == (1 if found_after else 0)


def test_lines_that_the_log_lost_are_counted_once() -> None:
    exchange = Exchange()
    exchange.sample()
    exchange.sample(lines_dropped=3)
    exchange.sample()
    assert exchange.state.counters.by_cause[Counted.LINE_DROPPED] == 3


def test_a_rate_limit_goes_on_over_disarming() -> None:
    # 10 mA/s; FAILSAFE is at 4 mA, and a law that wants 20 mA is disarmed and armed again in 11 ms
    exchange = Exchange(Pusher(), GuardSettings(max_rate_ma_per_s=10.0, setpoint_hold_s=0.0))
    exchange.sample(setpoint=Setpoint(0.08))
    exchange.sample(setpoint=Setpoint(0.08, HostRequest.ARM))
    exchange.step(elapsed_ns=20 * MS)
    assert (exchange.state.guard.mode, exchange.state.output.last_ma) == (Mode.FAILSAFE, 4.0)
    for _ in range(10):
        exchange.sample(setpoint=Setpoint(0.08, HostRequest.DISARM))
    assert exchange.state.output.last_ma is None
    ((command, _),) = commands(exchange.sample(setpoint=Setpoint(0.08, HostRequest.ARM)))
    assert command.mode is Mode.ACTIVE
    assert command.current_ma == pytest.approx(4.0 + 10.0 * 0.011, abs=1e-3)
    ((command, _),) = commands(exchange.sample())
    assert command.current_ma == pytest.approx(4.0 + 10.0 * 0.012, abs=1e-3)


def test_a_rate_limit_starts_at_what_balances_the_spring() -> None:
    exchange = Exchange(guard=GuardSettings(auto_arm=True, max_rate_ma_per_s=100.0))
    ((first, _),) = commands(exchange.sample())
    assert first.current_ma == pytest.approx(12.598 - 0.1, abs=1e-3)
    ((second, _),) = commands(exchange.sample())
    assert second.current_ma == pytest.approx(12.598 - 0.2, abs=1e-3)


def test_a_failsafe_that_holds_before_any_command_stays_inside_the_limits() -> None:
    # armed in a batch without a reading, then feedback ends: there is no last command, and 1 cm balances at 1.57 mA
    exchange = Exchange(guard=GuardSettings(failsafe_action=FailsafeAction.KEEP_CURRENT))
    exchange.sample(0.01, setpoint=Setpoint(0.01))
    exchange.step(CODEC.encode(Setpoint(0.01, HostRequest.ARM), 1))
    outbox = exchange.step(elapsed_ns=20 * MS)
    ((command, _),) = commands(outbox)
    assert (command.mode, command.current_ma) == (Mode.FAILSAFE, 4.0)


def test_every_closed_cycle_is_reported() -> None:
    exchange = Exchange()
    exchange.sample(0.0795, setpoint=Setpoint(0.087))
    exchange.sample(0.0795)
    first, second = (event for event in exchange.events if isinstance(event, Controlled))
    assert [first.time_s, second.time_s] == pytest.approx([0.001, 0.002])
    assert [first.setpoint_m, first.measured_m] == pytest.approx([0.087, 0.0795])
    assert (first.current_ma, first.mode) == (10.0, Mode.ACTIVE)


def test_the_same_frames_give_the_same_frames() -> None:
    scenario = replace(load_scenario("paper-valve"), dwell_s=0.15, visits=1)
    first, second = run_in_process(scenario), run_in_process(scenario)
    frames = [frame for _, _, frame in first.recording.frames]
    assert frames == [frame for _, _, frame in second.recording.frames]
    assert first.table == second.table

    # replay: the input of the recorded run, once more into a fresh positioner with the initial table
    configuration = configure(scenario)
    codec = configuration.make_codec()
    setup = Setup(codec, configuration.valve, configuration.guard, configuration.make_law(), scenario.sample_period_s)
    state = CycleState(table=StictionTable(cell_width_m=configuration.control.table_cell_m))
    replayed: list[CanFrame] = []
    recorded = [frame for frame in frames if frame.arbitration_id in {0x100, 0x140, 0x141}]
    inbox: list[CanFrame] = []
    sample = 0
    for frame in frames:
        if frame.arbitration_id in {0x120, 0x110}:
            inbox.append(frame)
        if frame.arbitration_id == 0x110:
            sample += 1
            state, outbox, _ = step(
                setup, state, CycleInput(tuple(inbox), round(sample * scenario.sample_period_s * 1e9))
            )
            replayed += outbox
            inbox = []
    assert len(recorded) > 450
    assert replayed == recorded
    assert state.table == first.table


class FailedPusher(ScriptedLaw):
    """A law that has found its third push in a row to have failed, and now rests."""

    def decide(
        self, memory: int, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[int, Decision]:
        memory, decision = super().decide(memory, stem, observation, table)
        return memory, replace(decision, failed_pushes=3, rest_s=2.0)


def test_a_push_that_failed_is_reported_with_the_rest_that_follows_and_counted() -> None:
    exchange = Exchange(FailedPusher())
    exchange.sample()
    assert exchange.events_of(PushFailed) == [PushFailed(3, 2.0)]
    assert exchange.state.counters.by_cause[Counted.PUSH_FAILED] == 1
