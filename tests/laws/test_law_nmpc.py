"""The law `quasi-static`: its belief and its rests in closed form, and the loop on valves that it is told wrongly."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from loop_helpers import Loop

from positioner.bench.inprocess import InProcessRun, run_in_process
from positioner.bench.scenario import Scenario
from positioner.config.reader import parse_config
from positioner.cycle.events import LawFellBack, MoveBegan
from positioner.laws.estimator_settings import EstimatorSettings
from positioner.laws.law import Observation
from positioner.laws.nmpc.belief import Landing, ValveBelief, belief_of
from positioner.laws.nmpc.factory import nmpc_law
from positioner.laws.nmpc.kept import lesson_of, taught
from positioner.laws.nmpc.landing import inertia_m
from positioner.laws.nmpc.law import NmpcLaw
from positioner.laws.nmpc.memory import Move, NmpcMemory
from positioner.laws.nmpc.move import Limits, Stage, Stem, Step, boost_samples, can_follow, is_worth_it, steps_to
from positioner.laws.nmpc.rest import NO_REST, Noise, Rest
from positioner.values import replace
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.gaussian import gaussian_of
from positioner.valve.parameters import ValveParameters
from positioner.valve.pressure import pressure_model
from positioner.valve.rollout import plant_of
from positioner.valve.state import StemState
from positioner.valve.stiction import Quantity, StictionTable
from positioner.wire.messages import Cause, CurrentCommand

if TYPE_CHECKING:
    from positioner.wire.messages import CanFrame

VALVE = ValveParameters(id="paper")
GAIN = VALVE.force_gain_n_per_ma
SPRING, SLIDING, STATIC = 52538.0 / GAIN, 1423.0 / GAIN, 1707.7 / GAIN
JUMP_M = (1707.7 - 1423.0) / 52538.0
LIMITS = Limits(4.0, 20.0, 0.0, 0.1397)
SETPOINTS_MM = (73.0, 87.0, 80.0, 76.0, 77.0, 90.0, 66.0, 80.0)


def scenario(period_s: float = 1e-3, dwell_s: float = 1.5, seed: int = 3, **tables: dict[str, object]) -> Scenario:
    return Scenario(
        name="test",
        title="test",
        law="quasi-static",
        seed=seed,
        sample_period_s=period_s,
        setpoint_period_s=round(10.0 * period_s, 9),
        setpoints_mm=SETPOINTS_MM,
        dwell_s=dwell_s,
        plant={"preset": "paper", **tables.get("plant", {})},
        valve=dict(tables.get("valve", {})),
        estimator=dict(tables.get("estimator", {})),
    )


def errors_pct(run: InProcessRun, played: Scenario) -> list[float]:
    """Return the mean |error| in the last 0.3 s of each dwell, in percent of span."""
    path_m, last = run.recording.true_position_m, round(0.3 / played.sample_period_s)
    found = []
    for number, setpoint_mm in enumerate(played.setpoints_mm):
        end = (number + 1) * played.samples_per_dwell
        found.append(float(np.abs(path_m[end - last : end] - setpoint_mm * 1e-3).mean()) / 1.27e-3)
    return found


# -- what is kept over a restart


def test_the_landings_that_a_table_has_kept_are_believed_again() -> None:
    table, configured = StictionTable(), belief_of(VALVE)
    for place_m, direction in ((0.07, 1.0), (0.09, -1.0), (0.08, 1.0), (0.07, -1.0)):
        pressure_ma = configured.landing_ma(place_m, direction) + 0.4 + 0.2 * direction  # other bench set and friction
        lesson = lesson_of(configured, Landing(place_m, direction, pressure_ma), VALVE)
        assert lesson.value == pytest.approx(-(0.4 + 0.2 * direction) / SPRING)
        table = table.learned(lesson)
    belief = taught(configured, table, VALVE, 1e-5)
    assert belief.offset_ma == pytest.approx(configured.offset_ma + 0.4, abs=0.1)
    assert belief.landing_ma(0.075, 1.0) == pytest.approx(configured.landing_ma(0.075, 1.0) + 0.6, abs=0.03)
    assert belief.landing_ma(0.085, -1.0) == pytest.approx(configured.landing_ma(0.085, -1.0) + 0.2, abs=0.03)
    assert taught(configured, StictionTable(), VALVE, 1e-5) == configured


@pytest.mark.parametrize("valve", ["paper", "real-valve"])
def test_the_table_is_believed_from_its_time_on(valve: str) -> None:
    text = f'[valve]\nid = "v"\npreset = "{valve}"\n[control]\nsample_period_s = 0.01\ntable_from_s = 3.0\n'
    configuration = parse_config(text, "valve.toml", Path())
    law = configuration.make_law()
    assert isinstance(law, NmpcLaw)
    configured = belief_of(configuration.valve)
    landing = Landing(0.08, 1.0, configured.landing_ma(0.08, 1.0) + 0.4)
    table, memory = StictionTable().learned(lesson_of(configured, landing, configuration.valve)), law.begin(0.08)
    for time_s, believes in ((0.0, False), (2.99, False), (3.0, True)):
        observation = Observation(0.08, 12.0, 0.01, 0.08, time_s)
        memory, estimate = law.estimate(memory, observation)
        memory, _ = law.decide(memory, estimate.stem, observation, table)
        assert (memory.has_read, memory.belief != configured) == (believes, believes)


@pytest.mark.parametrize(
    "told",
    [
        {"coulomb_friction_n": 1000.0, "static_friction_n": 1200.0, "bench_set_n": 300.0},
        {"coulomb_friction_n": 1700.0, "static_friction_n": 2100.0},
        {"spring_rate_n_per_m": 45000.0},
        {"bench_set_n": 400.0},
    ],
)
def test_a_valve_that_is_told_wrongly_is_known_after_a_restart(told: dict[str, object]) -> None:
    played = scenario(0.005, valve=told)
    first = run_in_process(played)
    assert {key.quantity for key, _ in first.table} == {Quantity.LANDING_BIAS}
    again = run_in_process(played, first.table)
    end, setpoint_m = played.samples_per_dwell, SETPOINTS_MM[0] * 1e-3
    before_mm, after_mm = (
        1e3 * float(np.abs(run.recording.true_position_m[:end] - setpoint_m).mean()) for run in (first, again)
    )  # over the first dwell
    assert 1.2 < before_mm < 6.5
    assert 0.4 < after_mm < 1.1
    assert after_mm < 0.55 * before_mm
    moves_before, moves_after = (sum(isinstance(each, MoveBegan) for each in run.events) for run in (first, again))
    assert 8 <= moves_after < moves_before < 30


# -- the belief


def test_a_landing_is_a_line_of_spring_offset_and_sliding_friction() -> None:
    belief = belief_of(VALVE)

    assert belief.landing_ma(0.08, 1.0) == pytest.approx(SPRING * 0.08 + SLIDING, rel=1e-12)
    assert belief.landing_ma(0.08, -1.0) == pytest.approx(SPRING * 0.08 - SLIDING, rel=1e-12)
    assert belief.jump_m == pytest.approx(JUMP_M, rel=1e-12)


def true_landings(spring: float, offset: float, sliding: float) -> list[Landing]:
    places = [(0.06, 1.0), (0.09, -1.0), (0.075, 1.0), (0.07, -1.0), (0.085, 1.0), (0.065, -1.0), (0.08, 1.0)]
    return [Landing(x, s, spring * x + offset + s * sliding) for x, s in places]


@pytest.mark.parametrize(("spring", "offset", "sliding"), [(1.0, 0.0, 1.0), (1.2, 0.4, 0.8), (0.85, -0.5, 1.2)])
def test_landings_at_several_places_both_ways_show_spring_offset_and_friction(
    spring: float, offset: float, sliding: float
) -> None:
    belief = belief_of(VALVE)
    for landing in true_landings(spring * SPRING, offset, sliding * SLIDING) * 3:
        belief = belief.after_move().landed(landing, 1e-10, 0.0)

    assert belief.spring_ma_per_m == pytest.approx(spring * SPRING, rel=0.02)
    assert belief.sliding_ma == pytest.approx(sliding * SLIDING, rel=0.03)
    for place, direction in ((0.06, 1.0), (0.088, -1.0)):
        expected_ma = spring * SPRING * place + offset + direction * sliding * SLIDING
        assert belief.landing_ma(place, direction) == pytest.approx(expected_ma, abs=0.1)


def test_the_belief_is_as_sure_as_it_is_right() -> None:
    """NEES: squared errors over their variances, of 100 valves drawn from the prior, are 1 on average."""
    chance = np.random.default_rng(5)
    squares = []
    for _ in range(100):
        spring, offset, sliding = (
            SPRING * (1.0 + 0.12 * chance.normal()),
            0.7 * chance.normal(),
            SLIDING + (0.15 * SLIDING + 0.03) * chance.normal(),
        )
        belief = belief_of(VALVE)
        for landing in true_landings(spring, offset, sliding):
            seen = Landing(landing.position_m, landing.direction, landing.pressure_ma + 0.0313 * chance.normal())
            belief = belief.landed(seen, 1e-12, 0.0)
        error = np.array([spring, offset, sliding]) - np.array(belief.numbers.mean[:3])
        covariance = np.array(belief.numbers.covariance).reshape(7, 7)[:3, :3]
        squares.append(float(error @ np.linalg.solve(covariance, error)) / 3.0)

    assert 0.5 < float(np.mean(squares)) < 1.6


@pytest.mark.parametrize(("share", "differs"), [(0.8, False), (1.0, False), (1.25, False), (1.6, True), (0.55, True)])
def test_a_valve_differs_from_its_configuration_where_it_is_certainly_another_one(share: float, differs: bool) -> None:
    belief, spring = belief_of(VALVE), share * belief_of(VALVE).spring_ma_per_m
    sliding, offset = belief.sliding_ma, belief.offset_ma
    for place_m, direction in [(0.03, 1.0), (0.09, 1.0), (0.05, -1.0), (0.1, 1.0), (0.02, -1.0), (0.07, 1.0)] * 3:
        pressure_ma = spring * place_m + offset + direction * sliding
        belief = belief.after_move().landed(Landing(place_m, direction, pressure_ma), 1e-10, 1e-4)
    assert belief.differs is differs


def test_a_force_that_comes_is_no_spring() -> None:
    belief = belief_of(VALVE)
    for landing in true_landings(SPRING, 0.0, SLIDING) * 2:
        belief = belief.landed(landing, 1e-10, 0.0)
    before = belief.spring_ma_per_m

    belief = belief.landed(Landing(0.08, 1.0, SPRING * 0.08 + SLIDING + 1.5), 1e-10, 0.0)

    assert belief.offset_ma == pytest.approx(1.5, abs=0.4)
    assert belief.spring_ma_per_m == pytest.approx(before, rel=0.02)
    assert belief.landings == ()


def known_valve() -> ValveBelief:
    belief = belief_of(VALVE)
    for landing in true_landings(SPRING, 0.0, SLIDING) * 2:
        belief = belief.landed(landing, 1e-10, 0.0)
    return belief


def test_friction_that_has_changed_is_told_from_a_force_by_a_landing_the_other_way() -> None:
    belief, sliding = known_valve(), SLIDING - 1.0
    for _ in range(2):
        for direction in (1.0, -1.0):
            landing = Landing(0.08, direction, SPRING * 0.08 + direction * sliding)
            belief = belief.landed(landing, 1e-10, 0.0)
    assert belief.sliding_ma == pytest.approx(sliding, abs=0.1)
    assert belief.offset_ma == pytest.approx(0.0, abs=0.2)


def test_what_moved_a_stem_under_a_current_that_stood_still_is_nothing_but_a_force() -> None:
    moved = Landing(0.08, -1.0, SPRING * 0.08 - SLIDING + 2.0)
    after = [known_valve().landed(moved, 1e-10, 0.0, is_force=is_force) for is_force in (True, False)]
    assert abs(after[0].sliding_ma - SLIDING) < 0.02 < abs(after[1].sliding_ma - SLIDING)
    assert after[0].landing_ma(0.08, -1.0) == pytest.approx(moved.pressure_ma, abs=0.3)


@pytest.mark.parametrize(("short_ma", "is_other"), [(0.3, False), (3.0, True)])
def test_a_push_in_vain_far_beyond_what_frees_a_stem_shows_a_force_or_friction(short_ma: float, is_other: bool) -> None:
    before = known_valve()
    pushed_ma = before.freeing_ma(0.08, 1.0) + short_ma
    after = before.held(0.08, 1.0, pushed_ma)
    assert (after.landings == ()) is is_other
    more_ma, friction_ma = after.offset_ma - before.offset_ma, after.static_ma - before.static_ma
    assert 0.5 * short_ma < abs(more_ma) + friction_ma < short_ma + 1.8
    if is_other:
        assert more_ma == pytest.approx(friction_ma, rel=0.35)  # as likely the one as the other
        assert after.sliding_ma == pytest.approx(SLIDING, abs=0.1)
        assert after.held(0.08, -1.0, after.freeing_ma(0.08, -1.0) - 2.0).static_ma > after.static_ma + 0.5


def test_a_push_that_frees_a_stem_as_it_should_says_nothing_new_however_often() -> None:
    belief = belief_of(VALVE)
    strong_ma, weak_ma = (belief.freeing_ma(0.08, 1.0) + more_ma for more_ma in (2.0, -0.5))
    for _ in range(20):
        belief = belief.after_move().freed(0.08, 1.0, strong_ma)
    assert belief.static_ma == STATIC == pytest.approx(belief_of(VALVE).static_ma)
    assert belief.freed(0.08, 1.0, weak_ma).static_ma < STATIC - 0.1


def test_a_stem_that_ran_into_a_stop_would_have_landed_there_or_beyond() -> None:
    belief, stop_m = replace(belief_of(VALVE), other=None), 0.1397
    expected_ma = belief.landing_ma(stop_m, 1.0)
    after = belief.ran_on(Landing(stop_m, 1.0, expected_ma - 1.5))
    assert expected_ma - 3.6 < after.landing_ma(stop_m, 1.0) < expected_ma - 1.5
    assert belief.ran_on(Landing(stop_m, 1.0, expected_ma + 4.0)) == belief  # it was to run on
    low_ma = belief.landing_ma(0.0, -1.0)
    assert belief.ran_on(Landing(0.0, -1.0, low_ma + 1.5)).landing_ma(0.0, -1.0) > low_ma + 1.5


@pytest.mark.parametrize("setpoints_mm", [(80.0, 93.0, 92.0, 93.0), (80.0, 61.0, 62.0, 61.0)])
@pytest.mark.parametrize("law", ["quasi-static", "nmpc"])
def test_a_stem_that_overshoots_into_a_stop_is_not_sent_there_again(law: str, setpoints_mm: tuple[float, ...]) -> None:
    """It is told a third more friction, so a landing would be beyond the stop."""
    stops = {"travel_min_m": 0.058, "travel_max_m": 0.096}
    lag = {"actuator": {"fill_time_constant_s": 0.02, "vent_time_constant_s": 0.02}} if law == "nmpc" else {}
    told = {"static_friction_n": 1.33 * 1707.7, "coulomb_friction_n": 1.33 * 1423.0, **stops, **lag}
    true: dict[str, object] = {"valve": {**stops, "initial_position_m": 0.08}, **lag}
    played = replace(scenario(valve=told, plant=true), law=law, setpoints_mm=setpoints_mm)
    run = run_in_process(played)
    assert max(errors_pct(run, played)[2:]) < 0.5
    at_stop = (run.recording.true_position_m < 0.0581) | (run.recording.true_position_m > 0.0959)
    assert np.count_nonzero(np.diff(at_stop.astype(int)) == 1) < 3  # times that it is sent there


def test_a_stem_that_did_not_move_has_more_static_friction_than_the_push() -> None:
    belief = belief_of(VALVE)
    pushed_ma = 1.3 * STATIC

    after = belief.held(0.08, 1.0, belief.balance_ma(0.08) + pushed_ma)

    assert after.static_ma > belief.static_ma
    assert after.jump_m > belief.jump_m
    assert belief.held(0.08, 1.0, belief.balance_ma(0.08) + 0.2 * STATIC) is not None


def test_half_of_how_sliding_friction_changes_is_believed_of_static_friction_and_the_rest_doubted() -> None:
    belief = replace(belief_of(VALVE), other=None)
    for place, variance in enumerate(belief.numbers.variances):  # a valve that is known
        belief = replace(belief, numbers=belief.numbers.widened(place, -0.9999 * variance))
    for number in range(1, 61):
        sliding_ma, direction = (1.0 + 0.005 * number) * SLIDING, 1.0 if number % 2 else -1.0
        landing = Landing(0.08, direction, SPRING * 0.08 + direction * sliding_ma)
        belief = belief.after_move().landed(landing, 1e-10, 0.0)
    assert belief.sliding_ma == pytest.approx(1.3 * SLIDING, rel=0.02)
    assert belief.static_ma == pytest.approx(1.15 * STATIC, rel=0.03)
    assert 2.0 < (1.3 * STATIC - belief.static_ma) / math.sqrt(belief.numbers.variances[3]) < 3.5


def test_landings_of_before_weigh_less_after_each_move_also_where_none_has_landed_since() -> None:
    belief = replace(belief_of(VALVE), other=None)
    for _ in range(4):
        belief = belief.landed(Landing(0.0725, 1.0, SPRING * 0.0725 + SLIDING), 1e-10, 0.0)
    belief = replace(belief, numbers=belief.numbers.with_mean((SPRING, 0.0, SLIDING - 0.1, STATIC, -7.0, 0.0, 0.0)))
    new_ma = belief.local_ma(0.0725, 1.0)
    for _ in range(40):
        belief = belief.after_move()
    left = 4.0 * 0.95**40
    assert new_ma == pytest.approx(0.1 * 4.0 / 4.3, rel=1e-6)
    assert belief.local_ma(0.0725, 1.0) == pytest.approx(0.1 * left / (left + 0.3), rel=1e-6)


def test_a_move_to_where_friction_is_less_begins_where_its_level_frees_the_stem() -> None:
    belief = replace(belief_of(VALVE), other=None)
    landings = tuple(Landing(0.08, 1.0, belief.landing_ma(0.08, 1.0) - 0.3) for _ in range(6))
    belief, landed = replace(belief, landings=landings), 0
    for here_m in np.linspace(0.05, 0.0795, 60).tolist():
        *away, land = steps_to(belief, LIMITS, here_m, 0.08, 1.0)
        if land.direction > 0.0:
            begins_m, landed = (away[0].target_m if away else here_m), landed + 1
            assert belief.landing_ma(0.08, 1.0) > belief.freeing_ma(begins_m, 1.0)
            assert not can_follow(belief, 0.08 - 1.1 * belief.jump_m - 0.5 * belief.jump_doubt_m, land, 1.0)
    assert 20 < landed <= 60


@pytest.mark.parametrize(("moved_m", "is_bound"), [(-0.004, True), (0.0, True), (0.0015, False)])
def test_a_push_that_moved_the_stem_back_bounds_friction_as_one_in_vain_does(moved_m: float, is_bound: bool) -> None:
    law = law_of()
    begun, level_ma = law.begin(0.08), SPRING * 0.08 + 1.2 * STATIC
    move = Move(Stage.LAND, 1.0, 0.09, level_ma, SPRING * 0.08, SPRING * 0.08, 0.08, 1e-10, 0.0)
    pressure = law.plant.actuator.at_rest(level_ma)
    memory = replace(begun, move=move, pressure=pressure, position_m=0.08 + moved_m, position_m2=1e-10)
    after = law.ends.landed(memory)
    assert (after.failed == 1) is is_bound
    assert (after.belief.static_ma > begun.belief.static_ma + 0.2) is is_bound


def test_nearly_the_same_level_again_pushes_on() -> None:
    move = Move(Stage.LAND, 1.0, 0.09, 14.61, 14.61 + 1e-4, 14.61, 0.07, 0.0, 0.0)
    assert move.pushes == 1.0
    assert replace(move, level_ma=14.5).pushes == -1.0


def test_friction_of_a_place_is_learned_there_and_not_elsewhere() -> None:
    belief = belief_of(VALVE)
    for landing in true_landings(SPRING, 0.0, SLIDING) * 3:
        belief = belief.landed(landing, 1e-10, 0.0)
    for _ in range(4):
        belief = belief.landed(Landing(0.0725, 1.0, SPRING * 0.0725 + SLIDING + 0.05), 1e-10, 0.0)

    assert 0.015 < belief.local_ma(0.0725, 1.0) < 0.08
    assert abs(belief.local_ma(0.0725, -1.0)) < 0.02
    assert abs(belief.local_ma(0.10, 1.0)) < 0.02


# -- the rest


def rested(readings_m: np.ndarray, period_s: float = 1e-3) -> tuple[Rest, list[int]]:
    """Return the rest after these readings, and where it was seen to move."""
    rest, moved = NO_REST, []
    for number, reading_m in enumerate(readings_m):
        rest, full = rest.read(float(reading_m), period_s, period_s)
        if full and rest.moved_m(period_s, 1e-6, 1.0) != 0.0:
            moved.append(number)
            rest = NO_REST
    return rest, moved


def test_a_mean_is_that_of_all_readings_and_noise_alone_is_no_motion() -> None:
    readings_m = 0.08 + 1e-3 * np.random.default_rng(1).normal(size=20_000)

    rest, moved = rested(readings_m)

    assert moved == []
    assert rest.mean_m == pytest.approx(float(readings_m.mean()), rel=1e-12)
    assert rest.blocks == 20_000 // 12


@pytest.mark.parametrize("creep_mm", [2.0, 5.0])
def test_a_stem_that_moves_by_five_sigma_is_seen(creep_mm: float) -> None:
    readings_m = 0.08 + 1e-3 * np.random.default_rng(2).normal(size=2_000)
    readings_m[1_000:] += creep_mm * 1e-3

    _, moved = rested(readings_m)

    assert moved
    assert 1_000 <= moved[0] < 1_000 + 12 * 25


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_noise_is_worth_what_its_correlation_leaves(correlation: float) -> None:
    chance, value, readings_m = np.random.default_rng(3), 0.0, []
    for _ in range(4_000):
        value = correlation * value + math.sqrt(1.0 - correlation**2) * float(chance.normal())
        readings_m.append(0.08 + 4e-4 * value)
    noise = Noise()
    for begin in range(0, 4_000, 1_000):
        rest = NO_REST
        for reading_m in readings_m[begin : begin + 1_000]:
            rest, _ = rest.read(reading_m, 1e-3, 1e-3)
        noise = noise.after(rest)

    variance_m2, worth = noise.of(4e-4)
    assert variance_m2 == pytest.approx(1.6e-7, rel=0.25)
    assert worth == pytest.approx((1.0 + correlation) / (1.0 - correlation), rel=0.35)


# -- the moves


@pytest.mark.parametrize("law", ["nmpc", "quasi-static"])
def test_near_the_end_of_the_travel_a_move_away_pushes_as_hard_as_friction_asks(law: str) -> None:
    valve = {"spring_rate_n_per_m": 39_600.0, "diaphragm_area_m2": 0.075, "coulomb_friction_n": 1_450.0}
    plant = {**valve, "static_friction_n": 2_330.0, "initial_position_m": 0.1192}
    played = scenario(0.01, 2.0, plant={"valve": plant}, valve={**valve, "static_friction_n": 2_200.0})

    played = replace(played, law=law, setpoints_mm=(119.2, 95.0))  # it is first moved up to the end, at 139.7 mm
    run = run_in_process(played, beyond_reach=True)

    assert 0.130 < run.recording.true_position_m.max() <= 0.1397
    assert max(event.decision.failed_pushes for event in run.cycles) == 0
    assert 0.02 < errors_pct(run, played)[1] < 0.3


def test_a_far_setpoint_takes_one_move_and_a_near_one_begins_by_moving_away() -> None:
    belief = belief_of(VALVE)

    far = steps_to(belief, LIMITS, 0.06, 0.09, 1.0)
    near = steps_to(belief, LIMITS, 0.08, 0.081, 1.0)

    assert [step.stage for step in far] == [Stage.LAND]
    assert [step.stage for step in near] == [Stage.AWAY, Stage.LAND]
    away, land = near
    assert land.direction * (land.target_m - away.target_m) > 1.15 * JUMP_M
    assert away.direction == -land.direction


@pytest.mark.parametrize(
    ("error_of_span", "lasts_s", "tries", "expected"),
    [
        (0.004, 0.06, 1, True),
        (0.004, 0.6, 1, False),
        (0.004, 0.06, 2, False),
        (0.004, 0.03, 2, True),
        (0.009, 0.6, 10, True),
        (0.0005, 0.06, 1, False),
    ],
)
def test_a_correction_is_worth_while_where_it_pays_and_makes_the_error_smaller(
    error_of_span: float, lasts_s: float, tries: int, expected: bool
) -> None:
    belief = replace(belief_of(VALVE), other=None)
    for place_m, direction in ((0.06, 1.0), (0.1, -1.0), (0.07, 1.0), (0.065, -1.0), (0.095, 1.0)) * 4:
        landing = Landing(place_m, direction, belief_of(VALVE).landing_ma(place_m, direction))
        belief = belief.landed(landing, 1e-12, 0.0)
    setpoint_m = 0.08 + error_of_span * VALVE.span_m
    steps = steps_to(belief, LIMITS, 0.08, setpoint_m, 1.0)
    assert is_worth_it(belief, steps, 0.08, setpoint_m, VALVE.span_m, lasts_s, tries) is expected


@pytest.mark.parametrize(("error_of_sigma", "expected"), [(1.1, False), (1.3, True)])
def test_a_correction_that_is_braked_by_reading_is_worth_while_by_the_sigma_of_such_stops(
    error_of_sigma: float, expected: bool
) -> None:
    belief, read_m = belief_of(VALVE), 0.001 * VALVE.span_m  # the landing of a quasi-static move is not known so well
    setpoint_m = 0.08 + error_of_sigma * read_m
    steps = steps_to(belief, LIMITS, 0.08, setpoint_m, 1.0)
    assert is_worth_it(belief, steps, 0.08, setpoint_m, VALVE.span_m, 0.01, 1, read_m) is expected
    assert not is_worth_it(belief, steps, 0.08, setpoint_m, VALVE.span_m, 0.01, 1)


def test_no_move_ends_at_a_stop() -> None:
    belief = belief_of(VALVE)

    for setpoint_m, here_m in ((0.139, 0.1385), (0.001, 0.0015)):
        for step in steps_to(belief, LIMITS, here_m, setpoint_m, 1.0):
            assert 0.0 < step.target_m < 0.1397


def test_a_hurried_pressure_stays_short_of_its_level_also_where_the_lag_is_a_fifth_shorter() -> None:
    samples = boost_samples(0.1, 1e-3, whole_ma=12.0, step_ma=6.0, left=0.3)

    # p = 20 - 12 e^(-t/τ) reaches 8 + 0.7·6 = 12.2 mA after τ ln(12/7.8)
    assert samples == pytest.approx(100.0 * math.log(12.0 / 7.8), abs=1.5)
    assert 20.0 - 12.0 * math.exp(-samples / 80.0) < 14.0


def test_mass_carries_a_stem_of_little_viscous_friction_beyond_its_balance() -> None:
    swings_m = []
    for viscous in (612.9, 200.0):
        valve = replace(VALVE, viscous_friction_n_s_per_m=viscous)
        belief, plant = belief_of(valve), plant_of(valve, 1e-3, 0.0)
        level_ma = belief.landing_ma(0.09, 1.0)
        move = Move(Stage.LAND, 1.0, 0.09, level_ma, 11.0, 11.0, 0.07, 0.0, 0.0)
        swings_m.append(inertia_m(plant, belief, pressure_model(valve.actuator, 1e-3).at_rest(11.0), move, 1e-3))

    assert swings_m[0] < 1e-4
    # ζ = 200/(2√(1.361·52538)) = 0.374: e^(-πζ/√(1-ζ²)) = 28 % of the way from the start, 20 mm
    assert swings_m[1] == pytest.approx(0.28 * 0.02, rel=0.05)


@pytest.mark.parametrize(
    ("viscous", "lags", "expected"), [(0.4, 0.0, True), (0.4, 3.9, True), (0.4, 4.1, False), (1.3, 1.0, False)]
)
def test_mass_matters_where_a_stem_is_light_and_the_pressure_quick(viscous: float, lags: float, expected: bool) -> None:
    mass = 1.361 / GAIN
    stem = Stem(mass, 2.0 * viscous * math.sqrt(mass * SPRING))
    assert stem.swings(SPRING, lags * math.sqrt(mass / SPRING)) is expected


def first_slip_ends_short(ratio: float, lags: float, jumps: float) -> float:
    """Return how far short of its balance the first slip ends, in slip jumps: m = K = F_s - F_c = 1, Euler steps."""
    step, position, speed, push = 1e-3, 0.0, 0.0, 1.0  # push: the pressure less F_c, from where it frees the stem
    while jumps - push > 1e-3:
        push += step * (jumps - push) / lags
        speed += step * (push - position - 2.0 * ratio * speed)
        if speed <= 0.0:
            break
        position += step * speed
    return jumps - position


@pytest.mark.parametrize("lags", [10.0, 20.0, 40.0])
@pytest.mark.parametrize("ratio", [0.55, 0.65, 0.75])
def test_a_light_stem_behind_a_slow_pressure_slides_through_from_so_many_slip_jumps_on(
    ratio: float, lags: float
) -> None:
    spring, mass = SPRING, 1.361 / GAIN
    stem = Stem(mass, 2.0 * ratio * math.sqrt(mass * spring))
    jumps = stem.slides_through(spring, lags * math.sqrt(mass / spring))

    assert 1.1 < jumps < 4.0
    assert first_slip_ends_short(ratio, lags, jumps) < 0.03
    assert first_slip_ends_short(ratio, lags, 1.0 + 0.75 * (jumps - 1.0)) > 0.05


@pytest.mark.parametrize(
    ("viscous", "lag_s", "expected"), [(1.0, 0.1, 1.0), (0.3, 0.01, 1.0), (0.0, 0.1, 4.0)], ids=str
)
def test_a_stem_slides_through_where_it_is_damped_or_the_pressure_quick(
    viscous: float, lag_s: float, expected: float
) -> None:
    mass = 1.361 / GAIN
    stem = Stem(mass, 2.0 * viscous * math.sqrt(mass * SPRING))
    assert stem.slides_through(SPRING, lag_s) == expected


def test_a_move_that_must_slide_through_begins_farther_away() -> None:
    belief = belief_of(VALVE)
    for through in (1.0, 2.5):
        away, land = steps_to(belief, LIMITS, 0.08, 0.081, through)
        assert land.direction * (land.target_m - away.target_m) > (through + 0.15) * JUMP_M
    assert [step.stage for step in steps_to(belief, LIMITS, 0.06, 0.076, 1.0)] == [Stage.LAND]
    assert [step.stage for step in steps_to(belief, LIMITS, 0.06, 0.076, 2.5)] == [Stage.AWAY, Stage.LAND]


# -- the loop

QUIET = {"preset": "paper", "sensor": {"noise_of_reading": 0.0005}}


def memory_of(loop: Loop) -> NmpcMemory:
    memory = loop.state.control.memory
    assert isinstance(memory, NmpcMemory)
    return memory


def test_on_the_valve_that_it_is_told_every_dwell_ends_within_a_fifth_of_a_percent() -> None:
    played = scenario()
    run = run_in_process(played)

    found = errors_pct(run, played)
    assert max(found) < 0.3
    assert 0.003 < float(np.mean(found)) < 0.15
    assert not any(isinstance(event, LawFellBack) for event in run.events)


@pytest.mark.parametrize(
    "valve",
    [
        {"spring_rate_n_per_m": 1.2 * 52538.0},
        {"spring_rate_n_per_m": 0.8 * 52538.0},
        {"static_friction_n": 1.25 * 1707.7, "coulomb_friction_n": 1.25 * 1423.0},
        {"static_friction_n": 0.5 * 1707.7, "coulomb_friction_n": 0.5 * 1423.0},
        {"bench_set_n": 400.0},
    ],
)
def test_a_valve_that_is_told_wrongly_is_learned(valve: dict[str, object]) -> None:
    sensor: dict[str, object] = {"noise_of_reading": 0.002}
    played = scenario(2e-3, valve=valve, plant={"sensor": sensor}, estimator=sensor)

    found = errors_pct(run_in_process(played), played)

    assert max(found[2:]) < 1.0
    assert float(np.mean(found[3:])) < 0.4


@pytest.mark.parametrize(
    ("actuator", "told"),
    [
        ({"fill_time_constant_s": 0.1, "vent_time_constant_s": 0.1}, True),
        ({"fill_time_constant_s": 0.05, "vent_time_constant_s": 0.05}, False),
        ({"fill_time_constant_s": 0.02, "vent_time_constant_s": 0.02, "dead_time_s": 0.01}, False),
        ({"converter_time_constant_s": 0.04}, False),
        ({"fill_time_constant_s": 0.3, "vent_time_constant_s": 0.3}, False),
    ],
)
def test_a_lag_costs_time_and_no_place_whether_it_is_configured_or_not(actuator: dict[str, float], told: bool) -> None:
    played = scenario(
        4e-3,
        dwell_s=5.0,
        plant={"actuator": actuator, "sensor": {"noise_of_reading": 0.002}},
        valve={"actuator": actuator} if told else {},
        estimator={"noise_of_reading": 0.002},
    )

    found = errors_pct(run_in_process(played), played)

    assert max(found) < 0.8
    assert float(np.median(found)) < 0.2


@pytest.mark.parametrize("law", ["quasi-static", "nmpc"])
@pytest.mark.parametrize("lag_s", [0.03, 0.1, 0.25])
def test_a_lag_that_is_configured_and_absent_does_no_harm(law: str, lag_s: float) -> None:
    lag = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    played = replace(scenario(4e-3, dwell_s=2.0, valve={"actuator": lag}), law=law)
    run = run_in_process(played)
    first = run.recording.true_position_m[: played.samples_per_dwell]
    assert max(errors_pct(run, played)[1:]) < 1.0
    assert max(first) < 0.09  # of a setpoint of 73 mm: no pressure that is there at once has been hurried on


@pytest.mark.parametrize("period_s", [2e-3, 5e-3, 2e-2])
def test_a_longer_period_is_served_alike(period_s: float) -> None:
    played = scenario(period_s, dwell_s=2.0)

    found = errors_pct(run_in_process(played), played)

    assert max(found) < 1.5
    assert float(np.mean(found)) < 0.5


def test_a_lag_that_was_taken_for_friction_is_a_lag_once_it_is_seen() -> None:
    lag = {"fill_time_constant_s": 0.2, "vent_time_constant_s": 0.2}
    plant = {**QUIET, "actuator": lag, "valve": {"initial_position_m": 0.08}}
    loop = Loop("quasi-static", sample_period_s=0.005, plant=plant)
    static_ma = []
    for _ in range(200):
        loop.run(0.05, 0.079)
        static_ma.append(memory_of(loop).belief.static_ma)
        if memory_of(loop).belief.lag_s:
            break
    assert max(static_ma) > 1.05 * STATIC  # pushes in vain
    assert static_ma[-1] == pytest.approx(STATIC, rel=0.08)
    loop.run(6.0, 0.079)
    assert 0.12 < memory_of(loop).belief.lag_s < 0.3
    assert loop.position_m == pytest.approx(0.079, abs=6e-4)


def test_a_light_stem_behind_a_slow_pressure_stops_where_it_should() -> None:
    light = {"viscous_friction_n_s_per_m": 0.6 * 2.0 * math.sqrt(1.361 * 52538.0)}
    lag = {"actuator": {"fill_time_constant_s": 0.1, "vent_time_constant_s": 0.1}}
    played = scenario(2e-3, dwell_s=3.0, plant={"valve": light, **lag}, valve={**light, **lag})

    assert 0.002 < max(errors_pct(run_in_process(played), played)) < 0.5


def test_a_push_in_vain_says_nothing_of_how_long_moves_last() -> None:
    plant = {**QUIET, "valve": {"static_friction_n": 1e4, "initial_position_m": 0.08}}
    loop = Loop("quasi-static", plant=plant)
    loop.run(3.0, 0.07)
    assert memory_of(loop).belief.static_ma > 1.05 * STATIC  # pushes in vain
    assert memory_of(loop).lasts_s == 0.0


def test_pushes_in_vain_are_believed_for_good_once_a_move_has_shown_that_the_lag_is_as_configured() -> None:
    lag = {"actuator": {"fill_time_constant_s": 0.02, "vent_time_constant_s": 0.02}}
    plant = {**QUIET, **lag, "valve": {"static_friction_n": 2200.0, "initial_position_m": 0.08}}
    loop = Loop("quasi-static", plant=plant, valve=lag)
    was_in_vain = False
    for _ in range(40):
        loop.run(0.05, 0.07)
        was_in_vain = was_in_vain or memory_of(loop).unpushed is not None
    memory = memory_of(loop)
    assert was_in_vain
    assert memory.is_lag_known
    assert memory.belief.lag_s == pytest.approx(0.02)
    assert memory.unpushed is None


def test_a_stem_that_a_force_has_moved_is_brought_back_by_a_move_that_knows_the_force() -> None:
    valve = {"static_friction_n": 900.0, "coulomb_friction_n": 750.0}
    loop = Loop("quasi-static", sample_period_s=0.005, plant={**QUIET, "valve": valve}, valve=valve)
    for setpoint_m in (0.073, 0.087, 0.08):
        loop.run(1.2, setpoint_m)
    before = len(loop.events_of(MoveBegan))
    loop.plant = replace(loop.plant, process=replace(loop.plant.process, force_n=1100.0))
    loop.run(1.2, 0.08)
    assert memory_of(loop).belief.offset_ma == pytest.approx(1100.0 / GAIN, abs=0.35)
    assert len(loop.events_of(MoveBegan)) - before <= 3
    assert loop.position_m == pytest.approx(0.08, abs=6e-4)


def test_a_setpoint_beyond_the_believed_reach_is_tried_also_where_that_reach_ends_near_the_stem() -> None:
    told = {"spring_rate_n_per_m": 61600.0}  # 17 % too much
    believed_m = belief_of(replace(VALVE, spring_rate_n_per_m=61600.0)).reachable_m(0.095, 4.0, 20.0)
    plant = {**QUIET, "valve": {"initial_position_m": 0.085}}
    loop = Loop("nmpc", sample_period_s=0.005, plant=plant, valve=told)
    loop.run(2.0, 0.095)
    assert believed_m == pytest.approx(0.085, abs=5e-4)
    assert loop.position_m == pytest.approx(0.095, abs=1e-3)


def test_a_landing_at_the_end_of_the_reach_is_judged_once_the_pressure_is_there() -> None:
    lag = {"actuator": {"fill_time_constant_s": 0.25, "vent_time_constant_s": 0.25}}
    valve = {"initial_position_m": 0.07}
    loop = Loop("nmpc", sample_period_s=0.005, plant={**QUIET, **lag, "valve": valve}, valve=lag)
    for setpoint_m in (0.08, 0.07, 0.08):
        loop.run(5.0, setpoint_m)
    before = len(loop.events_of(MoveBegan))
    loop.run(8.0, 0.001)
    assert len(loop.events_of(MoveBegan)) - before == 1
    assert loop.position_m == pytest.approx((4.0 + SLIDING) / SPRING, abs=5e-4)  # where 4 mA lets the stem slide


def test_a_new_setpoint_need_not_wait_for_the_end_of_a_landing() -> None:
    law = law_of(lag_s=0.1)
    move = replace(law.begin(0.08).move, stage=Stage.LAND, target_m=0.08, level_ma=16.0, before_ma=12.0)
    resting = replace(law.begin(0.082), move=move, rest=Rest(3, 0.24, 0.0192), setpoint_m=0.08)
    asked = replace(resting, setpoint_m=0.1, is_new=True)
    near_ma = [law.judge.near_ma(memory) for memory in (resting, asked)]
    assert near_ma == [pytest.approx(0.1 * SPRING * away_m) for away_m in (0.002, 0.018)]


def returned(law: NmpcLaw, moved_m: float, level_ma: float, push: float) -> tuple[NmpcMemory, NmpcMemory]:
    """Return the memory before and after a stem at 80 mm has moved while the pressure returned to a level."""
    begun = law.begin(0.08)
    before_ma = begun.belief.landing_ma(0.08, push)
    move = Move(Stage.RETURN, push, 0.08, level_ma, before_ma, before_ma, 0.08, 1e-10, 0.0)
    at_rest = replace(begun, move=move, pressure=law.plant.actuator.at_rest(level_ma))
    return at_rest, law.ends.landed(replace(at_rest, position_m=0.08 + moved_m, position_m2=1e-10))


def test_a_stem_that_slides_back_with_the_pressure_has_less_friction_or_a_force() -> None:
    middle_ma = belief_of(VALVE).balance_ma(0.08)
    law, moved_m = law_of(), -0.95 * SLIDING / SPRING  # nearly as far as one without friction
    before, after = returned(law, moved_m, middle_ma, 1.0)
    assert after.belief.landing_ma(0.08 + moved_m, -1.0) == pytest.approx(middle_ma, abs=0.35)
    assert before.belief.offset_ma + SLIDING < after.belief.offset_ma < before.belief.offset_ma + 2.0 * SLIDING
    assert after.move.direction == -1.0
    known = after.belief.landed(Landing(0.08, 1.0, middle_ma + 0.05 * SLIDING), 1e-10, 0.0)  # a landing tells the two
    assert known.sliding_ma < 0.4 * SLIDING
    assert known.offset_ma == pytest.approx(0.0, abs=1.5)


@pytest.mark.parametrize(("moved_m", "learns"), [(-0.003, False), (0.002, False), (0.02, True)])
def test_a_stem_that_moves_against_the_pressure_was_moved_by_a_force(moved_m: float, learns: bool) -> None:
    before, after = returned(law_of(), moved_m, belief_of(VALVE).balance_ma(0.08), 1.0)
    assert (after.belief != before.belief) is learns
    if learns:
        assert after.belief.offset_ma < before.belief.offset_ma - 4.0
        assert after.belief.static_ma == pytest.approx(before.belief.static_ma, abs=0.02)


def test_a_force_that_comes_while_the_pressure_returns_is_known_at_the_next_move() -> None:
    valve = {"static_friction_n": 900.0, "coulomb_friction_n": 750.0}
    loop = Loop("quasi-static", sample_period_s=0.005, plant={**QUIET, "valve": valve}, valve=valve)
    loop.run(1.2, 0.073)
    while memory_of(loop).move.stage is not Stage.RETURN:
        loop.run(0.005, 0.08)
    loop.plant = replace(loop.plant, process=replace(loop.plant.process, force_n=1100.0))
    loop.run(1.0, 0.08)
    assert memory_of(loop).belief.offset_ma == pytest.approx(1100.0 / GAIN, abs=0.35)
    assert loop.position_m == pytest.approx(0.08, abs=6e-4)


@pytest.mark.parametrize(("is_lag_known", "left"), [(True, 0.7**3), (False, 1.0)])
def test_what_a_force_has_made_rests_wait_for_is_taken_back(is_lag_known: bool, left: float) -> None:
    law = law_of()
    memory = replace(law.begin(0.08), later_s=0.5, is_lag_known=is_lag_known)
    for _ in range(3):
        memory = law.judge.settled(replace(memory, rest=Rest(3, 0.24, 0.0192)))
    assert memory.later_s == pytest.approx(0.5 * left)


@pytest.mark.parametrize(("way_m", "sigma_m", "moves"), [(5e-4, 1e-3, False), (5e-4, 6e-4, True), (8e-4, 1e-2, True)])
def test_a_new_setpoint_is_left_where_a_move_to_it_would_probably_end_farther_away(
    way_m: float, sigma_m: float, moves: bool
) -> None:
    law = law_of()
    begun = law.begin(0.08)
    numbers = gaussian_of(begun.belief.numbers.mean, (1e-3, sigma_m * SPRING, *[1e-3] * 4))
    belief = replace(begun.belief, numbers=numbers, scatter_ma2=1e-6)
    memory, moved = standing(law, replace(begun, belief=belief, setpoint_m=0.08), 0.08, 0.08 + way_m, 0.3)
    assert (moved > 0) is moves
    assert not memory.is_new


@pytest.mark.parametrize(("rested_s", "learns"), [(0.01, False), (0.1, True)])
def test_a_stem_that_a_force_has_just_moved_teaches_nothing_where_the_setpoint_changes(
    rested_s: float, learns: bool
) -> None:
    law = law_of()
    memory, _ = standing(law, replace(law.begin(0.08), setpoint_m=0.08), 0.08, 0.08, rested_s)
    memory = replace(memory, carried=(0.075, 1e-12))
    seen = Observation(0.08, memory.sent_ma, 0.001, 0.09, 0.0)
    after, decision = law.decide(memory, StemState(0.08, 0.0, True, 1.0), seen, StictionTable())
    assert decision.reason is not None
    assert after.carried is None
    assert bool(after.belief.landings) is learns


def test_a_landing_teaches_also_where_the_way_to_it_was_short() -> None:
    """A slip jump of 2 mm: the last move began where the stem was still seen to move."""
    plant = {**QUIET, "valve": {"static_friction_n": 600.0, "coulomb_friction_n": 500.0}}
    valve = {"static_friction_n": 600.0, "coulomb_friction_n": 350.0}
    loop = Loop("quasi-static", sample_period_s=0.002, plant=plant, valve=valve)
    for setpoint_m in (0.073, 0.08, 0.075):
        loop.run(1.2, setpoint_m)
    for setpoint_m in (0.0756, 0.0762, 0.0768):
        before = len(memory_of(loop).belief.landings)
        loop.run(1.2, setpoint_m)
        assert len(memory_of(loop).belief.landings) == before + 1
        assert loop.position_m == pytest.approx(setpoint_m, abs=3e-4)
    assert memory_of(loop).belief.sliding_ma == pytest.approx(500.0 / GAIN, rel=0.1)


def test_a_stem_at_its_stop_is_pulled_away_with_a_force_that_grows() -> None:
    plant = {**QUIET, "valve": {"initial_position_m": 0.1397}}
    valve = {"static_friction_n": 600.0, "coulomb_friction_n": 500.0, "spring_rate_n_per_m": 60000.0}
    loop = Loop("quasi-static", sample_period_s=0.005, plant=plant, valve=valve)
    loop.run(2.0, 0.125)
    assert loop.position_m < 0.13  # 20 mA holds it there, which the configured valve needs at 125 mm


def test_friction_that_is_gone_is_no_reason_to_swing() -> None:
    valve, errors = {"static_friction_n": 1.0, "coulomb_friction_n": 0.9}, []
    for seed in (2, 3, 4):
        played = scenario(4e-3, dwell_s=2.0, seed=seed, plant={"valve": valve})
        run = run_in_process(played)
        errors += errors_pct(run, played)
        moves = [event for event in run.events if isinstance(event, MoveBegan)]
        assert len(moves) < 6 * len(SETPOINTS_MM)

    *_, second, largest = sorted(errors)
    assert 0.1 < second < 0.6
    assert largest < 0.7  # so much is left where a correction would not pay


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(-0.02, 0.16), min_size=5, max_size=60),
    st.lists(st.floats(0.0, 0.1397), min_size=1, max_size=3),
)
def test_whatever_is_read_the_current_stays_inside_the_loop(readings: list[float], setpoints: list[float]) -> None:
    law = parse_config('[valve]\nid = "v"\npreset = "paper"\n', "valve.toml", Path()).make_law()
    memory, current_ma = law.begin(readings[0]), 12.0
    for index, measured_m in enumerate(readings):
        setpoint_m = setpoints[index * len(setpoints) // len(readings)]
        observation = Observation(measured_m, current_ma, 1e-3, setpoint_m, index * 1e-3)
        memory, estimate = law.estimate(memory, observation)
        memory, decision = law.decide(memory, estimate.stem, observation, StictionTable())
        current_ma = decision.current_ma
        assert 4.0 <= current_ma <= 20.0


def test_a_valve_without_friction_is_armed_again_with_its_own_table() -> None:
    own: dict[str, Any] = {"valve": {"static_friction_n": 0.0, "coulomb_friction_n": 0.0}, "sensor": QUIET["sensor"]}
    free = replace(scenario(dwell_s=0.6), law="nmpc", plant={"preset": "paper", **own}, valve=own["valve"])
    first = run_in_process(free)
    again = run_in_process(free, first.table)
    assert first.table.sequence > 0
    assert [event for event in again.events if isinstance(event, LawFellBack)] == []
    assert again.table.sequence > first.table.sequence
    assert max(errors_pct(again, free)[1:]) < 1.0


def test_a_setpoint_that_no_slide_reaches_is_followed_as_far_as_one_does_and_no_farther() -> None:
    # behind 4 mA a stem that slides down stops at 52 mm, so a stem below is nowhere brought nearer by way of there
    plant = {**QUIET, "valve": {"initial_position_m": 0.01}}
    loop = Loop("nmpc", plant=plant)
    loop.run(1.0, 0.0103)
    assert loop.position_m == pytest.approx(0.01, abs=1e-6)
    loop.run(1.0, 0.04)  # one slide upwards leads there
    assert loop.position_m == pytest.approx(0.04, abs=2e-3)
    resting_m = loop.position_m
    loop.run(2.0, resting_m - 0.0008)  # and none downwards
    assert loop.position_m == pytest.approx(resting_m, abs=1e-6)


def test_the_place_where_control_begins_is_a_setpoint_as_sure_as_a_reading() -> None:
    law = law_of()
    memory, moves = standing(law, law.begin(0.08), 0.0801, 0.08, 1.0)
    assert (memory.setpoint_m2, moves) == (law.judge.sigma_m(0.08) ** 2, 0)
    memory, moves = standing(law, memory, 0.0801, 0.09, 0.1)
    assert (memory.setpoint_m2, moves) == (0.0, 1)


def test_the_same_run_twice_is_the_same_to_the_bit_and_no_memory_is_changed() -> None:
    played = scenario(dwell_s=0.5)
    first, second = (run_in_process(played) for _ in range(2))
    assert first.recording.current_ma.tobytes() == second.recording.current_ma.tobytes()

    law = nmpc_law(VALVE, EstimatorSettings(), (4.0, 20.0), 1e-3, 0.0)
    memory = law.begin(0.08)
    observation = Observation(0.0801, 12.6, 1e-3, 0.09, 0.0)
    results = [law.estimate(memory, observation)[0] for _ in range(2)]
    assert results[0] == results[1]
    assert memory == law.begin(0.08)
    decisions = [law.decide(results[0], law.estimate(memory, observation)[1].stem, observation, StictionTable())]
    decisions += [law.decide(results[0], law.estimate(memory, observation)[1].stem, observation, StictionTable())]
    assert decisions[0] == decisions[1]


def test_a_stem_that_moves_against_its_pushes_is_told() -> None:
    loop = Loop("quasi-static")
    for setpoint_m in (0.073, 0.087, 0.08):
        loop.run(1.0, setpoint_m)
    before = loop.state.differs

    def reversed_commands(frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        decoded = (loop.codec.decode(frame) for frame in frames)
        return tuple(
            loop.codec.encode(CurrentCommand(24.0 - message.current_ma), counter or 0)
            for message, counter in decoded
            if isinstance(message, CurrentCommand)
        )

    loop.to_plant = reversed_commands
    loop.run(0.6, 0.068)
    assert (before, loop.state.differs, loop.state.guard.cause) == (False, True, Cause.VALVE_DIFFERS)


# -- what a stem that stands still teaches


def law_of(backlash_m: float = 0.0, lag_s: float = 0.0) -> NmpcLaw:
    actuator = ActuatorParameters(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s)
    valve = replace(VALVE, backlash_m=backlash_m, actuator=actuator)
    return nmpc_law(valve, EstimatorSettings(noise_of_reading=1e-5), (4.0, 20.0), 1e-3, 0.0)


def standing(
    law: NmpcLaw, memory: NmpcMemory, measured_m: float, setpoint_m: float, seconds: float
) -> tuple[NmpcMemory, int]:
    """Return the memory after the same reading for so long, and how many moves have begun."""
    current_ma, moves = memory.belief.balance_ma(measured_m), 0
    for cycle in range(round(seconds / 1e-3)):
        seen = Observation(measured_m, current_ma, 1e-3, setpoint_m, cycle * 1e-3)
        memory, estimate = law.estimate(memory, seen)
        memory, decision = law.decide(memory, estimate.stem, seen, StictionTable())
        current_ma, moves = decision.current_ma, moves + (decision.reason is not None)
    return memory, moves


def test_a_law_that_begins_under_a_current_beyond_the_loop_sees_where_the_stem_goes() -> None:
    law = law_of()
    memory, current_ma, moves = replace(law.begin(0.08), setpoint_m=0.08), 23.9, 0
    for cycle in range(500):
        measured_m = 0.08 if cycle < 2 else 0.09
        seen = Observation(measured_m, current_ma, 1e-3, 0.08, cycle * 1e-3)
        memory, estimate = law.estimate(memory, seen)
        memory, decision = law.decide(memory, estimate.stem, seen, StictionTable())
        current_ma, moves = decision.current_ma, moves + (decision.reason is not None)
        assert 4.0 <= current_ma <= 20.0
    assert moves > 0


@pytest.mark.parametrize(
    ("way_m", "lag_s", "stage"),
    [(0.015, 0.1, Stage.AWAY), (0.015, 0.0, Stage.LAND), (0.012, 0.0, Stage.AWAY)],  # 12.4 mm go straight without lag
)
def test_a_light_stem_whose_lag_is_seen_to_be_absent_moves_as_without_one(
    way_m: float, lag_s: float, stage: Stage
) -> None:
    law = law_of(lag_s=0.1)
    stem = replace(law.judge.stem, viscous=0.5 * law.judge.stem.viscous)  # ζ = 0.57
    law = replace(law, judge=replace(law.judge, stem=stem))
    begun = law.begin(0.07)
    memory, _ = standing(law, replace(begun, belief=begun.belief.with_lag(lag_s)), 0.07, 0.07 + way_m, 0.001)
    assert memory.move.stage is stage


@pytest.mark.parametrize(("position_m", "failed"), [(0.1394, 0), (0.137, 1)])
def test_a_push_into_a_stop_is_not_in_vain(position_m: float, failed: int) -> None:
    law = law_of()
    begun = law.begin(position_m)
    level_ma = begun.belief.freeing_ma(position_m, 1.0) + 0.5
    move = replace(begun.move, stage=Stage.LAND, direction=1.0, level_ma=level_ma, start_m2=1e-10)
    after = law.ends.landed(replace(begun, move=move, pressure=law.plant.actuator.at_rest(level_ma), position_m2=1e-10))
    assert after.failed == failed
    assert (after.belief == begun.belief) is (failed == 0)


def test_what_goes_on_sliding_after_a_landing_shows_no_more_force_than_its_way() -> None:
    law = law_of()
    begun, moved_m = law.begin(0.08), -0.004
    landed_ma, middle_ma = begun.belief.landing_ma(0.08, -1.0), begun.belief.balance_ma(0.08)
    move = replace(begun.move, stage=Stage.RETURN, direction=-1.0, level_ma=middle_ma, before_ma=landed_ma)
    memory = replace(begun, move=move, pressure=law.plant.actuator.at_rest(middle_ma), position_m=0.08 + moved_m)
    belief = law.ends.carried(replace(memory, position_m2=1e-10), moved_m, 1e-10).belief
    way_ma = -moved_m * belief.spring_ma_per_m
    assert 0.0 < belief.offset_ma < way_ma  # F_c more, 4.3 mA, if it had slid at the end of the return
    left_ma = landed_ma - belief.landing_ma(0.08 + moved_m, -1.0)
    assert abs(left_ma) < 0.5 * way_ma


def test_backlash_that_is_taken_up_is_no_motion() -> None:
    law = law_of(backlash_m=1e-3)
    memory, moves = law.begin(0.08), 0
    for setpoint_m in (0.06, 0.1):  # each turn takes the backlash up
        memory, more = standing(law, memory, 0.08, setpoint_m, 2.0)
        moves += more
    assert 6 < moves < 12  # each waits longer than the one before, for a lag that nobody has told
    assert memory.failed > 4  # none of them has moved the stem


@pytest.mark.parametrize(
    ("level_ma", "before_ma", "direction", "pushes"),
    [(12.0, 9.0, -1.0, 1.0), (9.0, 12.0, 1.0, -1.0), (12.0, 12.0, 1.0, 1.0), (12.0, 12.0, -1.0, -1.0)],
)
def test_a_level_pushes_away_from_the_one_before_it_and_the_same_one_pushes_on(
    level_ma: float, before_ma: float, direction: float, pushes: float
) -> None:
    move = replace(law_of().begin(0.08).move, level_ma=level_ma, before_ma=before_ma, direction=direction)
    assert move.pushes == pushes


@pytest.mark.parametrize("known", [1.0, -1.0])
def test_a_correction_comes_from_the_side_from_which_landings_are_known(known: float) -> None:
    law = law_of()
    belief = law.begin(0.08).belief
    for landing in true_landings(SPRING, 0.0, SLIDING) * 4:
        if landing.direction == known:
            belief = belief.landed(landing, 1e-12, 0.0)
    for setpoint_m in (0.0795, 0.0805):
        away, land = steps_to(belief, law.limits, 0.08, setpoint_m, 1.0)
        assert (away.direction, land.direction) == (-known, known)


@pytest.mark.parametrize(("known", "corrections"), [(True, 1), (False, 0)])
def test_a_correction_is_worth_what_is_known_of_its_landing(known: bool, corrections: int) -> None:
    law = law_of()
    belief = law.begin(0.08).belief
    for landing in true_landings(SPRING, 0.0, SLIDING) * 4 if known else []:
        belief = belief.landed(landing, 1e-12, 0.0)
    setpoint_m = 0.0806  # half a percent above the stem
    memory = replace(law.begin(0.08), belief=belief, setpoint_m=setpoint_m)
    _, moves = standing(law, memory, 0.08, setpoint_m, 0.2)
    assert min(moves, 1) == corrections


@pytest.mark.parametrize(("is_at_limit", "stage"), [(False, Stage.AWAY), (True, Stage.LAND)])
def test_a_move_away_that_was_too_short_is_made_again_unless_the_current_was_at_its_limit(
    is_at_limit: bool, stage: Stage
) -> None:
    law = law_of()
    begun, _ = standing(law, law.begin(0.08), 0.08, 0.08, 0.001)
    belief = begun.belief
    level_ma = LIMITS.low_ma if is_at_limit else belief.freeing_ma(0.08, -1.0) - 0.05
    move = replace(begun.move, stage=Stage.AWAY, direction=-1.0, target_m=0.07, level_ma=level_ma, before_ma=12.0)
    pending = (Step(Stage.LAND, 0.0805, 1.0),)
    memory = replace(begun, move=move, pending=pending, setpoint_m=0.0805, is_lag_known=True)
    moves, seconds = 0, 0.0
    while moves == 0 and seconds < 2.0:
        memory, moves = standing(law, memory, 0.08, 0.0805, 0.001)
        seconds += 0.001
    assert (memory.move.stage, moves) == (stage, 1)


@pytest.mark.parametrize(
    ("moves_after", "is_lag_known", "level_samples"),
    [
        (999, False, 10),  # 2 and a quarter of a swing, 8 ms
        (999, True, 0),
        (3, False, 60),  # it moves at once: nothing lags
        (100, False, 10),
    ],
)
def test_the_first_current_at_its_limit_waits_until_a_pressure_without_lag_would_have_moved_the_stem(
    moves_after: int, is_lag_known: bool, level_samples: int
) -> None:
    law = law_of(lag_s=0.1)
    memory = replace(law.begin(0.07), hurries=True, is_lag_known=is_lag_known)
    current_ma, at_level = memory.belief.balance_ma(0.07), 0
    for cycle in range(60):
        measured_m = 0.07 + 0.0002 * max(cycle - moves_after, 0)
        seen = Observation(measured_m, current_ma, 1e-3, 0.09, cycle * 1e-3)
        memory, estimate = law.estimate(memory, seen)
        memory, decision = law.decide(memory, estimate.stem, seen, StictionTable())
        current_ma = decision.current_ma
        if current_ma == 20.0:
            break
        assert current_ma == memory.move.level_ma < 20.0
        at_level += 1
    assert at_level == level_samples


@pytest.mark.parametrize(("beyond_m", "hurries"), [(0.0002, True), (0.005, False)])
def test_a_hurried_move_that_goes_too_far_is_the_last_one(beyond_m: float, hurries: bool) -> None:
    law = law_of(lag_s=0.05)
    begun = law.begin(0.08)
    belief = begun.belief
    for landing in true_landings(SPRING, 0.0, SLIDING) * 4:
        belief = belief.landed(landing, 1e-12, 0.0)
    level_ma = belief.balance_ma(0.08 + beyond_m)
    move = replace(
        begun.move, stage=Stage.LAND, direction=1.0, target_m=0.08, level_ma=level_ma, start_m=0.07, is_hurried=True
    )
    memory = replace(begun, belief=belief, move=move, setpoint_m=0.08, hurries=True, is_lag_known=True)
    memory, _ = standing(law, memory, 0.08 + beyond_m, 0.08, 0.6)
    assert memory.hurries is hurries
