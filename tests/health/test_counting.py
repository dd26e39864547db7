"""What the counters count, by hand: turning points, travel, time, histograms and events."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest

from positioner.cycle.events import Controlled, Event, MoveBegan
from positioner.cycle.trust_events import PushFailed
from positioner.health.classes import DEVIATION_EDGES_PERCENT, TRAVEL_EDGES_PERCENT, counted, empty
from positioner.health.counters import Counters, CounterSettings
from positioner.health.counters_document import counters_from, counters_in
from positioner.health.counters_report import as_values, count_rows, histograms
from positioner.health.counting import Counting, begin, count
from positioner.health.observed import ObservedCycle
from positioner.health.settings import HealthTable
from positioner.health.stress import stress
from positioner.health.turns import Turns
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision
from positioner.laws.move_reason import MoveReason
from positioner.valve.state import StemState
from positioner.wire.messages import Cause, Mode

SETTINGS = CounterSettings(
    span_m=0.1, travel_min_m=0.0, sample_period_s=0.01, noise_of_reading=0.0, noise_of_span=0.0005
)
PERIOD_US = 10_000


def cycle(
    number: int,
    position_m: float | None = None,
    *,
    mode: Mode = Mode.ACTIVE,
    stuck: bool | None = None,
    setpoint_m: float = 0.05,
    events: tuple[Event, ...] = (),
) -> ObservedCycle:
    controlled = None
    if stuck is not None and position_m is not None:
        stem = StemState(position_m, 0.0, stuck, 1.0)
        decision = Decision(12.0, Bounds(0.0, 0.0, 4.0, 20.0))
        controlled = Controlled(0.0, setpoint_m, position_m, stem, decision, 12.0, mode, 0)
        events = (*events, controlled)
    return ObservedCycle(number * PERIOD_US, mode, Cause.NONE, position_m, None, None, controlled, events)


def played(positions_m: list[float], settings: CounterSettings = SETTINGS) -> Counters:
    """Return the counters after readings of a stem that rests for 0.4 s at each position."""
    counting = begin(Counters())
    readings = [position_m for position_m in positions_m for _ in range(40)]
    for number, position_m in enumerate(readings):
        count(settings, counting, cycle(number, position_m))
    return counting.so_far


@pytest.mark.parametrize(
    ("positions", "reversals", "spans"),
    [
        ([0.0, 5.0, 2.0, 8.0], 2, [5.0, 3.0]),
        ([0.0, 0.9, 0.0], 0, []),
        ([0.0, 3.0, 2.5, 4.0, 3.5, 6.0], 0, []),
        ([5.0, 0.0, 1.1, 0.0], 2, [5.0, 1.1]),
    ],
)
def test_a_reversal_is_counted_at_the_farthest_place_and_only_beyond_the_dead_band(
    positions: list[float], reversals: int, spans: list[float]
) -> None:
    turns, found = Turns(positions[0], positions[0]), []
    for position in positions:
        turns, span = turns.moved(position, 1.0)
        found += [] if span is None else [span]
    assert len(found) == reversals
    assert found == pytest.approx(spans)


def test_travel_is_the_way_of_the_stem_and_two_spans_are_a_full_stroke() -> None:
    counters = played([0.02, 0.05, 0.03, 0.07])
    # a stretch may hold readings from before and after a move: it lies between, and loses at most one dead band
    assert counters.travel_m == pytest.approx(0.03 + 0.02 + 0.04, abs=2.5e-4)
    assert counters.full_strokes(0.1) == pytest.approx(0.45, abs=0.002)
    assert (counters.reversals, counters.cycles) == (2, 2)


def test_a_cycle_needs_one_percent_of_the_span_and_a_change_of_direction_a_quarter() -> None:
    counters = played([0.02, 0.05, 0.0495, 0.0501, 0.04])
    assert counters.reversals == 3
    assert counters.cycles == 1
    assert sum(counters.spans) == 1
    assert counters.spans[6] == 1, "30 % of the span"


@pytest.mark.parametrize(("noise_of_reading", "noise_of_span"), [(0.02, 0.0), (0.0, 0.0005)])
def test_noise_alone_counts_nothing(noise_of_reading: float, noise_of_span: float) -> None:
    settings = replace(SETTINGS, noise_of_reading=noise_of_reading, noise_of_span=noise_of_span)
    sigma_m = noise_of_reading * 0.08 + noise_of_span * 0.1
    chance = random.Random(7)  # noqa: S311 - no secret
    counting = begin(Counters())
    for number in range(60_000):
        count(settings, counting, cycle(number, chance.gauss(0.08, sigma_m)))
    counters = counting.so_far
    assert (counters.travel_m, counters.reversals, counters.cycles) == (0.0, 0, 0)
    assert settings.dead_band_m(0.01, 0.08) == pytest.approx(max(0.001, 4.0 * sigma_m))


def test_time_is_counted_under_the_mode_that_held_and_in_whole_microseconds() -> None:
    counting = begin(Counters())
    modes = [Mode.READY] * 5 + [Mode.ACTIVE] * 30 + [Mode.HOLD] * 3 + [Mode.ACTIVE] * 10
    for number, mode in enumerate(modes):
        count(SETTINGS, counting, cycle(number, 0.05, mode=mode, events=()))
    mode_us = counting.so_far.mode_us
    assert mode_us[Mode.READY] == 5 * PERIOD_US
    assert mode_us[Mode.HOLD] == 3 * PERIOD_US
    assert mode_us[Mode.ACTIVE] == 30 * PERIOD_US, "what came after HOLD is counted when the next tenth is over"
    assert counting.so_far.total_us == 38 * PERIOD_US


def test_the_short_histograms_are_of_the_last_hundred_seconds() -> None:
    counting = begin(Counters())
    for number in range(15_000):
        count(SETTINGS, counting, cycle(number, 0.0512 if number < 7_000 else 0.0212, stuck=True, setpoint_m=0.05))
    counters = counting.so_far
    assert sum(counters.travel) == sum(counters.deviation) > 140
    told = as_values(SETTINGS, counters)["histograms"]
    assert sum(told["travel_last_100"]["counts"]) == sum(told["deviation_last_100"]["counts"]) == 100
    assert told["travel_last_100"]["counts"][5] == pytest.approx(80, abs=1), "20 to 25 %"
    assert told["travel_last_100"]["counts"][11] == pytest.approx(20, abs=1), "50 to 55 %"
    assert counters_from(counters_in(counters)) == counters


@pytest.mark.parametrize("given", [[22], [0] * 101, [1.0], "1", [-1]])
def test_a_short_histogram_that_is_none_is_refused(given: object) -> None:
    with pytest.raises(ValueError, match="travel_recent"):
        counters_from({**counters_in(some()), "travel_recent": given})


def test_the_dead_bands_are_those_of_the_configuration() -> None:
    wide = replace(SETTINGS, cycle_band_of_span=0.05, travel_band_of_span=0.02)
    counters = played([0.02, 0.05, 0.047, 0.06, 0.02], wide)
    assert (counters.cycles, counters.reversals) == (1, 3)


def test_the_packing_spends_its_life_by_the_spans_of_the_cycles() -> None:
    wear = HealthTable(allowed_cycles=((0.1, 1e6), (1.0, 1e4))).wear
    # 1e6·(span/0.1)^-2 between the points
    assert [1.0 / wear[at] for at in (0, 1, 9, 19, 20)] == pytest.approx([1e6, 1e6, 4e4, 1e4, 1e4])
    spans = [0] * 21
    spans[1], spans[9] = 1000, 400
    assert stress(wear, spans) == pytest.approx(1000 / 1e6 + 400 / 4e4)
    settings, counters = replace(SETTINGS, wear=wear), replace(some(), spans=tuple(spans))
    assert as_values(settings, counters)["stress_factor"] == pytest.approx(0.011)
    assert count_rows(settings, counters)[-1] == ("packing, life spent", "1.1", "%", "")
    assert as_values(SETTINGS, counters)["stress_factor"] is None
    assert HealthTable().wear == ()


@pytest.mark.parametrize("allowed", [((0.0, 1e5),), ((0.5, 1e5), (0.4, 1e4)), ((0.5, 1e4), (0.6, 1e5)), ((2.0, 1e5),)])
def test_allowed_cycles_that_cannot_be_are_refused(allowed: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(ValueError, match="allowed_cycles"):
        HealthTable(allowed_cycles=allowed)


def test_the_time_of_a_test_procedure_is_function_check_and_not_active() -> None:
    counting, testing = begin(Counters()), replace(SETTINGS, testing=True)
    for number, mode in enumerate([Mode.READY] * 5 + [Mode.ACTIVE] * 30 + [Mode.HOLD] * 3):
        count(testing, counting, cycle(number, 0.05, mode=mode, events=()))
    counters = counting.so_far
    assert (counters.mode_us[Mode.READY], counters.mode_us[Mode.ACTIVE]) == (5 * PERIOD_US, 0)
    assert counters.checked_us == 30 * PERIOD_US
    assert counters.total_us == 35 * PERIOD_US
    assert ("time in FUNCTION_CHECK", "0.00", "h", "") in count_rows(testing, counters)
    assert as_values(testing, counters)["function_check_s"] == pytest.approx(0.3)


@pytest.mark.parametrize("testing", [False, True])
def test_a_test_procedure_leaves_no_sample_in_the_deviation_and_its_travel_counts(testing: bool) -> None:
    counting = begin(Counters())
    for number in range(300):
        count(replace(SETTINGS, testing=testing), counting, cycle(number, 0.05, stuck=True))
    counters = counting.so_far
    assert (sum(counters.deviation), len(counters.deviation_recent)) == ((0, 0) if testing else (2, 2))
    assert sum(counters.travel) == 2


def test_a_test_procedure_is_no_time_under_control_in_which_the_stem_sticks() -> None:
    counting, testing = begin(Counters()), replace(SETTINGS, testing=True)
    for number in range(300):
        count(testing, counting, cycle(number, 0.05, stuck=number % 100 < 50))
    counters = counting.so_far
    assert (counters.controlled_us, counters.stuck_us, counters.slips, counters.sticks) == (0, 0, 0, 0)
    assert ("sticks", "0", "", "not under control yet") in count_rows(testing, counters)
    assert as_values(testing, counters)["stuck_share"] is None


def test_a_histogram_shows_the_classes_from_the_first_to_the_last_that_hold_something() -> None:
    travel, spans = [0] * 22, [0] * 21
    travel[0], travel[2], travel[21], spans[20] = 15, 30, 7, 1
    counters = replace(some(), travel=tuple(travel), travel_recent=(2, 2, 21), spans=tuple(spans))
    (_, position), _, (head, cycles) = histograms(counters)
    assert position[:3] == [("< 0", "15", "0", "#" * 15), ("0 to 5", "0", "0", ""), ("5 to 10", "30", "2", "#" * 30)]
    assert (position[-1], len(position)) == (("≥ 100", "7", "1", "#" * 7), 22)
    assert (head, cycles) == (("span between reversals, % of the span", "cycles", ""), [("≥ 100", "1", "#" * 30)])


def test_counters_of_an_earlier_version_are_taken_over() -> None:
    section = counters_in(some())
    for name in ("checked_us", "travel_recent", "deviation_recent"):
        del section[name]
    assert counters_from(section) == replace(some(), travel_recent=(), deviation_recent=())
    assert counters_from({**counters_in(some()), "table_moves": 3}) == some(), "it counted what no version counts now"


def test_empty_cycles_in_between_change_no_time() -> None:
    dense, sparse = begin(Counters()), begin(Counters())
    for number in range(200):
        one = cycle(number, 0.05 if number % 50 == 0 else None, mode=Mode.FAILSAFE)
        count(SETTINGS, dense, one)
        if number in {0, 199}:
            count(SETTINGS, sparse, one)
    assert dense.counters.mode_us[Mode.FAILSAFE] == pytest.approx(199 * PERIOD_US, abs=100_000)
    assert sparse.counters.mode_us[Mode.FAILSAFE] == 199 * PERIOD_US


def test_slips_sticks_and_the_time_stuck_are_counted_where_a_law_knows_them() -> None:
    counting = begin(Counters())
    states = [True] * 40 + [False] * 10 + [True] * 50 + [None] * 20 + [False] * 10
    for number, stuck in enumerate(states):
        mode = Mode.READY if stuck is None else Mode.ACTIVE
        count(SETTINGS, counting, cycle(number, 0.05, mode=mode, stuck=stuck))
    count(SETTINGS, counting, cycle(len(states), 0.05, mode=Mode.READY))
    counters = counting.so_far
    assert (counters.slips, counters.sticks) == (1, 1), "nobody knows how the stem went from rest to sliding in READY"
    assert counters.stuck_us == 90 * PERIOD_US
    assert counters.controlled_us == 110 * PERIOD_US


def test_moves_and_failed_pushes_are_counted() -> None:
    events = (MoveBegan(MoveReason(0.01, 12.0, 0.06)), MoveBegan(MoveReason(-0.01, 8.0, 0.05)))
    counting = begin(Counters())
    count(SETTINGS, counting, cycle(0, 0.05, stuck=True, events=events))
    count(SETTINGS, counting, cycle(1, 0.05, stuck=True, events=(PushFailed(2, 1.0),)))
    counters = counting.so_far
    assert (counters.moves, counters.failed_pushes) == (2, 1)


def test_the_histograms_are_sampled_once_a_second() -> None:
    counting = begin(Counters())
    for number in range(1020):
        count(SETTINGS, counting, cycle(number, 0.0512, stuck=True, setpoint_m=0.05))
    counters = counting.so_far
    assert sum(counters.travel) == sum(counters.deviation) == 10
    assert counters.travel[11] == 10, "50 to 55 %"
    assert counters.deviation[DEVIATION_EDGES_PERCENT.index(-1.0)] == 10, "-2 to -1 %"


def test_time_at_the_ends_of_the_travel_is_counted() -> None:
    counters = played([0.0] * 10 + [0.03] * 10 + [0.003] * 10 + [0.1] * 10)
    tenths = [each // 100_000 for each in (counters.closed_us, counters.near_closed_us, counters.open_us)]
    assert tenths == pytest.approx([40, 40, 38], abs=3)


@pytest.mark.parametrize(("value", "at"), [(-1.0, 0), (0.0, 1), (4.999, 1), (5.0, 2), (100.0, 21), (1e9, 21)])
def test_a_class_holds_its_lower_edge(value: float, at: int) -> None:
    histogram = counted(empty(TRAVEL_EDGES_PERCENT), TRAVEL_EDGES_PERCENT, value)
    assert histogram.index(1) == at
    assert sum(histogram) == 1


def some() -> Counters:
    return played([0.02, 0.05, 0.03, 0.07])


def test_the_document_gives_the_counters_back_to_the_bit() -> None:
    assert counters_from(counters_in(some())) == some()
    assert counters_from(counters_in(Counters())) == counters_from(None) == Counters()


@pytest.mark.parametrize(
    ("name", "value"),
    [("slips", -1), ("slips", 1.0), ("slips", True), ("travel_m", "1"), ("travel", [1]), ("turns", [0.0, 0.0, 2])],
)
def test_a_section_that_was_not_written_so_is_refused(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=name):
        counters_from({**counters_in(some()), name: value})
    with pytest.raises(ValueError, match="not as this version"):
        counters_from({name: value})


def test_a_start_goes_on_where_the_last_one_was_saved() -> None:
    """Cut anywhere: what was counted before is kept, and only the open stretch and its time are lost."""
    readings = [0.05 + 0.03 * math.sin(number / 60.0) for number in range(3000)]
    whole, cut = begin(Counters()), begin(Counters())
    for number, position_m in enumerate(readings):
        count(SETTINGS, whole, cycle(number, position_m))
        if number % 160 == 0:
            cut = _restarted(cut)
        count(SETTINGS, cut, cycle(number, position_m))
    assert cut.so_far.observed == whole.so_far.observed == 3000
    assert cut.so_far.starts == 20
    assert cut.so_far.cycles == whole.so_far.cycles > 10
    assert cut.so_far.travel_m == pytest.approx(whole.so_far.travel_m, rel=0.01)


def _restarted(counting: Counting) -> Counting:
    return begin(counters_from(counters_in(counting.so_far)))
