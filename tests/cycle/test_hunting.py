"""A stem that swings without an end is told, whatever the law; one that is moved, corrected or noisy is not."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest
from loop_helpers import Loop

from positioner.cycle.events import ModeChanged
from positioner.cycle.hunting import (
    FEWEST,
    LASTS_S,
    PAUSE_S,
    QUICK_OF_SPAN,
    SWING_OF_SPAN,
    Hunting,
    Hunts,
    Mean,
    Swings,
    track_hunting,
)
from positioner.cycle.state import CycleState
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Estimate, Observation
from positioner.values import replace
from positioner.valve.parameters import ValveParameters
from positioner.valve.state import StemState
from positioner.wire.messages import Cause, Health, Mode

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.cycle.events import Event
    from positioner.valve.stiction import StictionTable

VALVE = ValveParameters(id="paper")
SPAN_M = VALVE.span_m
PERIODS_S = (0.001, 0.005, 0.01, 0.02)
HERE_M = 0.07


class Watch:
    """Readings one after another, with the command that the law has sent."""

    def __init__(self, period_s: float, noise_of_reading: float = 0.0, held_s: float = 0.0) -> None:
        self.period_s, self.noise, self.held = period_s, noise_of_reading, max(1, round(held_s / period_s))
        self.known: Hunting | None = None
        self.chance = random.Random(1)  # noqa: S311 - noise that can be repeated, no secret
        self.sample, self.draw = 0, 0.0

    def told_s(
        self,
        duration_s: float,
        stem_m: Callable[[float], float],
        setpoint_m: Callable[[float], float] = lambda _: HERE_M,
        current_ma: Callable[[float], float] | None = None,
    ) -> float | None:
        """Return when hunting was first told, None if it was not; the command follows the stem where none is given."""
        first = None
        for number in range(round(duration_s / self.period_s)):
            time_s = number * self.period_s
            self.draw = self.chance.gauss(0.0, 1.0) if self.sample % self.held == 0 else self.draw
            self.sample += 1
            true_m = stem_m(time_s)
            sent_ma = VALVE.balance_current_ma(true_m) if current_ma is None else current_ma(time_s)
            read_m = true_m * (1.0 + self.noise * self.draw)
            self.known = track_hunting(
                VALVE, self.known, read_m, setpoint_m(time_s), self.period_s, self.period_s, sent_ma
            )
            if first is None and self.tells:
                first = time_s
        return first

    @property
    def tells(self) -> bool:
        return self.known is not None and self.known.swings.told


def square(half_s: float, swing_m: float) -> Callable[[float], float]:
    """Return a stem that jumps to and fro, `half_s` at each place."""
    return lambda time_s: HERE_M + (0.5 if int(time_s / half_s) % 2 else -0.5) * swing_m


def wave(half_ma: float) -> Callable[[float], float]:
    """Return a command that goes to and fro."""
    to_and_fro = square(0.4, 2.0 * half_ma)
    return lambda time_s: 12.0 + to_and_fro(time_s)


def sine(period_s: float, swing_m: float, middle_m: float = HERE_M) -> Callable[[float], float]:
    return lambda time_s: middle_m + 0.5 * swing_m * math.sin(2.0 * math.pi * time_s / period_s)


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("half_s", [0.1, 0.25, 0.5])
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_a_stem_that_swings_without_an_end_is_told_within_five_seconds(
    period_s: float, half_s: float, noise: float
) -> None:
    told_s = Watch(period_s, noise).told_s(8.0, square(half_s, 0.08 * SPAN_M))
    assert told_s is not None
    assert LASTS_S < told_s <= 5.0 + half_s + 0.1  # it begins with the first jump, after half a period


@pytest.mark.parametrize("half_s", [0.8, 1.2, 1.4])
def test_a_slow_limit_cycle_is_told_after_five_whole_swings(half_s: float) -> None:
    told_s = Watch(0.01, 0.02).told_s(18.0, square(half_s, 0.06 * SPAN_M))
    assert told_s == pytest.approx((FEWEST + 1) * half_s, abs=0.15)


def test_a_swing_counts_from_three_percent_of_the_span_on() -> None:
    for share, told in ((0.9, False), (1.1, True)):
        swing_m = share * SWING_OF_SPAN * SPAN_M
        assert (Watch(0.001).told_s(8.0, square(0.4, swing_m)) is not None) is told


def test_excursions_of_two_samples_at_long_periods_are_swings() -> None:
    """A stem with no friction at 20 ms: it leaves its place by 17 mm twice a second, for two samples."""

    def stem_m(time_s: float) -> float:
        away = round(time_s / 0.02) % 25
        return 0.056 + {0: 0.017, 1: 0.011}.get(away, 0.0)

    told_s = Watch(0.02, 0.02).told_s(8.0, stem_m)
    assert told_s is not None
    assert told_s <= 5.0


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("samples", [2, 3])
@pytest.mark.parametrize("period_s", PERIODS_S[1:])
def test_a_stem_that_turns_at_every_second_sample_is_told(period_s: float, samples: int, noise: float) -> None:
    told_s = Watch(period_s, noise).told_s(8.0, square(samples * period_s, 0.13 * SPAN_M), current_ma=wave(1.0))
    assert told_s is not None
    assert LASTS_S < told_s <= 5.0


def test_swings_that_the_mean_does_not_show_count_from_what_the_quick_mean_shows_of_them() -> None:
    shown = math.tanh(0.01 / (2.0 * 0.0075))  # of a square with a half period of 10 ms, by a filter of 7.5 ms
    for share, told in ((0.9, False), (1.1, True)):
        swing_m = share * QUICK_OF_SPAN * SPAN_M / shown
        stem_m = square(0.01, swing_m)
        assert (Watch(0.0001).told_s(6.0, stem_m, current_ma=wave(1.0)) is not None) is told


@pytest.mark.parametrize(("noise", "held_s"), [(0.0, 0.0), (0.02, 0.0), (0.02, 0.01)])
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_noise_of_a_resting_stem_is_no_swing_even_where_the_command_goes_to_and_fro(
    period_s: float, noise: float, held_s: float
) -> None:
    assert Watch(period_s, noise, held_s).told_s(30.0, lambda _: HERE_M, current_ma=wave(1.0)) is None


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_noise_twice_as_large_is_no_swing_where_the_command_rests(period_s: float) -> None:
    assert Watch(period_s, 0.04).told_s(30.0, lambda _: HERE_M) is None


def test_what_no_command_moves_is_no_hunting() -> None:
    swing_m = 0.08 * SPAN_M
    for half_ma, told in ((0.0, False), (0.1, False), (0.2, True)):  # the spring asks for 0.6 mA over 3 % of span
        assert (Watch(0.005).told_s(10.0, square(0.4, swing_m), current_ma=wave(half_ma)) is not None) is told, half_ma


def test_a_setpoint_that_moves_is_followed_and_no_hunting() -> None:
    sine_m = sine(1.0, 0.2 * SPAN_M)
    steps = square(0.6, 0.1 * SPAN_M)
    for path_m in (sine_m, steps, lambda time_s: 0.06 + 0.001 * time_s):
        assert Watch(0.01, 0.02).told_s(20.0, path_m, path_m) is None


def test_a_slow_ramp_and_a_small_sine_of_the_setpoint_are_no_hunting() -> None:
    for path_m in (sine(1.0, 0.014 * SPAN_M), lambda time_s: 0.06 + 0.0005 * time_s):
        assert Watch(0.01, 0.01).told_s(30.0, path_m, path_m) is None


def test_hunting_around_a_setpoint_that_moves_a_little_is_told() -> None:
    told_s = Watch(0.01).told_s(8.0, square(0.3, 0.1 * SPAN_M), sine(2.0, 0.01 * SPAN_M, HERE_M))
    assert told_s is not None
    assert told_s <= 5.4


@pytest.mark.parametrize("half_s", [0.1, 0.4])
def test_corrections_that_end_are_no_hunting(half_s: float) -> None:
    """Nine reversals in 4 s, as behind a lag that nobody has told, or many; then the stem rests."""
    swings = square(half_s, 0.1 * SPAN_M)
    assert Watch(0.01, 0.02).told_s(20.0, lambda time_s: swings(time_s) if time_s < 4.0 else HERE_M) is None


def test_corrections_with_long_rests_between_them_are_no_hunting() -> None:
    assert Watch(0.01, 0.02).told_s(60.0, square(PAUSE_S + 0.2, 0.1 * SPAN_M)) is None


def test_hunting_is_over_when_the_stem_has_rested_and_not_when_the_setpoint_moves() -> None:
    watch, swings = Watch(0.01), square(0.3, 0.1 * SPAN_M)
    assert watch.told_s(6.0, swings) is not None
    watch.told_s(2.0, lambda time_s: swings(time_s) + 0.02, lambda _: HERE_M + 0.02)
    assert watch.tells
    watch.told_s(PAUSE_S - 0.2, lambda _: HERE_M + 0.02, lambda _: HERE_M + 0.02)
    assert watch.tells
    watch.told_s(0.8, lambda _: HERE_M + 0.02, lambda _: HERE_M + 0.02)
    assert not watch.tells


def test_hunting_ends_while_the_setpoint_goes_on_moving() -> None:
    watch = Watch(0.01)
    assert watch.told_s(6.0, square(0.3, 0.1 * SPAN_M)) is not None
    path_m = sine(1.0, 0.2 * SPAN_M)
    watch.told_s(3.0, path_m, path_m)
    assert not watch.tells


def test_count_and_amplitude_are_those_of_the_swings() -> None:
    watch = Watch(0.001)
    watch.told_s(6.0, square(0.3, 0.1 * SPAN_M))
    assert watch.known is not None
    assert watch.known.swings.mean_m == pytest.approx(0.1 * SPAN_M, rel=0.02)
    assert watch.known.swings.count == 18  # of 19 jumps in 6 s the first begins it
    assert Swings(HERE_M, HERE_M).mean_m == 0.0


def test_without_a_command_nothing_is_known() -> None:
    mean = Mean(HERE_M, Swings(HERE_M, HERE_M), HERE_M, 0.0, 0.0, 12.0, 12.0)
    assert track_hunting(VALVE, Hunting(mean, mean), HERE_M, HERE_M, 0.01, 0.01, None) is None


# one reading more

STEP_S = 0.5
LEAST_M = SWING_OF_SPAN * SPAN_M
LEAST_MA = 0.5 * SWING_OF_SPAN * VALVE.span_m * VALVE.spring_rate_n_per_m / VALVE.force_gain_n_per_ma


def stepped(known: Mean, setpoint_m: float = HERE_M, sent_ma: float = 12.0) -> Mean:
    """Return what the mean shows after one reading more, `STEP_S` later, that does not move it."""
    hunting = track_hunting(VALVE, Hunting(known, known), known.position_m, setpoint_m, STEP_S, 0.01, sent_ma)
    assert hunting is not None
    return hunting.mean


def at(position_m: float, swings: Swings, farthest_m: float = HERE_M, quiet_s: float = 0.25) -> Mean:
    return Mean(position_m, swings, farthest_m, 1.0, quiet_s, 12.0, 12.0)


def test_the_first_reading_is_where_the_stem_rests() -> None:
    mean = Mean(0.06, Swings(HERE_M, 0.06), 0.06, 0.0, 0.0, 12.0, 12.0)
    assert track_hunting(VALVE, None, 0.06, HERE_M, 0.01, 0.01, 12.0) == Hunting(mean, mean)
    assert stepped(mean).swings == mean.swings


@pytest.mark.parametrize("direction", [1, -1])
def test_a_stem_that_leaves_its_place_has_a_direction_and_no_reversal_yet(direction: int) -> None:
    swings = Swings(HERE_M, HERE_M)
    known = stepped(at(HERE_M + 1.1 * direction * LEAST_M, swings))
    assert known.swings == Swings(HERE_M, HERE_M, direction, 12.0, 12.0)
    assert known.farthest_m == known.position_m
    assert (known.swung_s, known.quiet_s) == (0.0, 0.0)
    farther_m = known.position_m + direction * LEAST_M
    farther = stepped(replace(known, position_m=farther_m))
    assert (farther.swings, farther.farthest_m) == (known.swings, farther_m)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_stem_turns_at_the_farthest_place_and_its_way_there_counts_only_under_commands(direction: int) -> None:
    swings = Swings(HERE_M, HERE_M, direction, 12.0, 12.0, 3, 0.03)
    turns = at(HERE_M, swings, HERE_M + 1.1 * direction * LEAST_M)
    undriven = stepped(turns)
    assert undriven.swings == Swings(HERE_M, turns.farthest_m, -direction, 12.0, 12.0, 3, 0.03)
    assert undriven.quiet_s == 0.25 + STEP_S
    driven = stepped(replace(turns, low_ma=11.0))
    assert driven.swings.count == 4
    assert driven.swings.sum_m == pytest.approx(0.03 + 1.1 * LEAST_M)
    assert driven.quiet_s == 0.0


@pytest.mark.parametrize("swings", [Swings(0.0, 0.0), Swings(0.0, LEAST_M, 1), Swings(0.0, -LEAST_M, -1)], ids=str)
def test_a_way_of_just_three_percent_of_the_span_is_no_swing(swings: Swings) -> None:
    for direction in (1, -1):
        if swings.direction != direction:
            assert stepped(at(direction * LEAST_M, swings, 0.0), 0.0).swings == swings


@pytest.mark.parametrize(("high_ma", "count"), [(LEAST_MA, 1), (0.99 * LEAST_MA, 0)])
def test_commands_that_differ_by_half_of_what_the_spring_asks_for_drive_a_swing(high_ma: float, count: int) -> None:
    turns = Mean(HERE_M, Swings(HERE_M, HERE_M, 1), HERE_M + 0.02, 1.0, 0.0, 0.0, 0.0)
    assert stepped(turns, sent_ma=high_ma).swings.count == count


@pytest.mark.parametrize(
    ("count", "swung_s", "told"), [(FEWEST, LASTS_S, True), (FEWEST, LASTS_S - 0.01, False), (FEWEST - 1, 60.0, False)]
)
def test_ten_reversals_in_just_the_least_time_are_told(count: int, swung_s: float, told: bool) -> None:
    turns = at(HERE_M, Swings(HERE_M, HERE_M, 1, 11.0, 12.0, count - 1), HERE_M + 0.02)
    assert stepped(replace(turns, swung_s=swung_s - STEP_S)).swings.told is told


def test_a_setpoint_that_moves_begins_the_swings_anew_and_what_is_told_keeps_their_size_and_the_time_since() -> None:
    swings = Swings(HERE_M, HERE_M, 1, 12.0, 12.0, 4, 0.04)
    moved = stepped(at(0.06, swings), 0.06)
    assert moved == Mean(0.06, Swings(0.06, 0.06), 0.06, 0.0, 0.0, 12.0, 12.0)
    told = stepped(at(0.06, replace(swings, told=True)), 0.06)
    assert told.swings == Swings(0.06, 0.06, count=1, sum_m=0.01, told=True)
    assert told == Mean(0.06, told.swings, 0.06, 0.0, 0.25 + STEP_S, 12.0, 12.0)
    left = stepped(replace(told, position_m=0.08), 0.06)
    assert left.swings.direction == 1
    assert left.quiet_s >= told.quiet_s  # a stem that has left its place has not yet turned


@pytest.mark.parametrize(
    ("setpoint_m", "quiet_s", "goes_on", "told"),
    [
        (0.25 * SWING_OF_SPAN * SPAN_M, 1.0, True, True),
        (-0.25 * SWING_OF_SPAN * SPAN_M, 1.0, True, True),
        (0.26 * SWING_OF_SPAN * SPAN_M, 1.0, False, True),
        (0.0, PAUSE_S, True, True),
        (0.02, PAUSE_S, False, True),
        (0.0, PAUSE_S + 0.01, False, False),
    ],
)
def test_a_setpoint_stands_up_to_a_quarter_of_a_swing_and_a_pause_lasts_up_to_its_limit(
    setpoint_m: float, quiet_s: float, goes_on: bool, told: bool
) -> None:
    swings = Swings(0.0, 0.0, 1, count=4, sum_m=0.04, told=True)
    after = stepped(at(0.0, swings, 0.0, quiet_s - STEP_S), setpoint_m).swings
    assert (after.count == 4, after.told) == (goes_on, told)


def test_the_line_for_the_log_has_all_sizes_in_mm() -> None:
    assert str(Hunts(12, 4.96, 0.0803, 0.0995)).startswith(
        "the stem hunts: 12 reversals in 5.0 s, 80.3 mm each, around its setpoint of 99.5 mm: "
    )


# through the whole cycle


@dataclass(frozen=True, slots=True)
class Swinging:
    """A law that pushes the stem to and fro, whatever it reads."""

    half_s: float
    name: str = "swinging"

    def begin(self, measured_m: float) -> float:
        return measured_m

    def estimate(self, memory: float, observation: Observation) -> tuple[float, Estimate]:
        return memory, Estimate(StemState(observation.measured_m, 0.0, False, 1.0))

    def decide(
        self, memory: float, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[float, Decision]:
        del stem, table
        rest_s = observation.time_s % (2.0 * self.half_s)
        current_ma = 19.0 if rest_s < self.half_s else 5.0
        return memory, Decision(current_ma, Bounds(0.0, 0.0, 4.0, 20.0))


def swinging(half_s: float, period_s: float = 0.02, **changes: Any) -> Loop:
    loop = Loop(
        law="pi", sample_period_s=period_s, setpoint_period_s=0.02, plant={"valve": {"initial_position_m": 0.08}}
    )
    loop.setup = replace(loop.setup, law=Swinging(half_s), **changes)
    return loop


def told_at(loop: Loop, duration_s: float, setpoint_m: float = 0.08) -> tuple[float | None, list[Event]]:
    for number in range(round(duration_s / loop.period_s)):
        loop.run(loop.period_s, setpoint_m)
        if loop.state.guard.cause is Cause.HUNTING:
            return number * loop.period_s, loop.events
    return None, loop.events


@pytest.mark.parametrize("period_s", [0.001, 0.01, 0.02])
def test_a_law_that_hunts_is_told_once_and_out_of_specification(period_s: float) -> None:
    loop = swinging(0.3, period_s)
    told_s, events = told_at(loop, 7.0)
    assert told_s is not None
    assert LASTS_S < told_s < 5.2
    guard = loop.state.guard
    assert (guard.mode, guard.health(table_saved=True)) == (Mode.ACTIVE, Health.OUT_OF_SPECIFICATION)
    loop.run(2.0, 0.08)
    (hunts,) = loop.events_of(Hunts)
    assert "reversals in 4." in str(hunts)
    assert str(hunts).endswith("measure the valve: positioner identify")
    assert [str(event) for event in events if isinstance(event, ModeChanged)][-1].endswith("(hunting)")


def test_a_test_procedure_that_swings_the_stem_does_not_hunt() -> None:
    assert told_at(swinging(0.3, testing=True), 7.0)[0] is None


def test_where_no_error_is_checked_no_hunting_is() -> None:
    loop = swinging(0.3)
    loop.setup = replace(loop.setup, guard=replace(loop.setup.guard, deviation_of_span=0.0))
    assert told_at(loop, 7.0)[0] is None


def test_what_was_known_ends_with_control() -> None:
    loop = swinging(0.3)
    assert told_at(loop, 7.0)[0] is not None
    loop.to_positioner = lambda frames: frames[:-3] if len(frames) > 3 else ()  # no reading comes any more
    loop.run(1.0, 0.08)
    assert loop.state.guard.mode is Mode.FAILSAFE
    assert loop.state.hunting is None
    assert CycleState().hunting is None


def test_a_law_that_swings_a_stem_without_friction_ninety_times_a_second_is_told_and_stays_so() -> None:
    plant = {"valve": {"static_friction_n": 0.0, "coulomb_friction_n": 0.0, "initial_position_m": 0.05}}
    loop = Loop("constant-reinforcement", seed=3, sample_period_s=0.005, setpoint_period_s=0.02, plant=plant)
    told_s, _ = told_at(loop, 8.0, 0.07)
    assert told_s is not None
    assert told_s < 5.0
    for _ in range(10):
        loop.run(0.5, 0.07)
        assert loop.state.guard.cause is Cause.HUNTING


@pytest.mark.parametrize(("plant", "period_s"), [("paper", 0.02), ("friction-20", 0.01), ("stochastic", 0.02)])
def test_nmpc_on_a_valve_that_it_knows_a_little_wrongly_does_not_hunt(plant: str, period_s: float) -> None:
    loop = Loop(sample_period_s=period_s, setpoint_period_s=0.02, plant={"preset": plant})
    for place_m in (0.07, 0.083, 0.078, 0.087, 0.073):
        assert told_at(loop, 6.0, place_m)[0] is None
    assert not loop.events_of(Hunts)
