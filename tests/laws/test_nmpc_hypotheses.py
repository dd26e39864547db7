"""The two hypotheses of a valve: that it is the configured one, or one that a configuration may stand for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from positioner.laws.nmpc.belief import DEAD_TIME, OFFSET, SLIDING, SPRING, STATIC, Landing, ValveBelief, belief_of
from positioner.laws.nmpc.slip import both_sides, numbers_of
from positioner.laws.nmpc.study import Study, Way
from positioner.values import replace
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.rollout import Moving, plant_of
from positioner.valve.sensor import NO_LAG
from positioner.valve.state import StemState

VALVE = ValveParameters(id="paper")
LAGGING = replace(VALVE, actuator=ActuatorParameters(fill_time_constant_s=0.05, vent_time_constant_s=0.05))
PERIOD_S = 1e-3
READING_M2 = 1e-8
LANDINGS = ((0.06, 1.0), (0.1, -1.0), (0.07, 1.0), (0.065, -1.0), (0.095, 1.0))


def is_configured(belief: ValveBelief) -> bool:
    """Whether the valve is believed to be the configured one."""
    return belief.drift < 1.0


def after_landings(belief: ValveBelief, true: ValveBelief, times: int = 1) -> ValveBelief:
    """Return the belief after landings of a valve that another belief describes."""
    for place_m, direction in LANDINGS * times:
        belief = belief.after_move().landed(
            Landing(place_m, direction, true.landing_ma(place_m, direction)), READING_M2, 0.0
        )
    return belief


def test_the_configured_valve_is_believed_once_it_is_by_far_more_likely_and_both_stay_open() -> None:
    belief = belief_of(VALVE)
    assert not is_configured(belief)
    once, often = after_landings(belief, belief), after_landings(belief, belief, 4)
    assert -5.0 <= once.log_odds < 0.0
    assert is_configured(often)
    assert often.other is not None  # a valve may change
    assert often.landing_sigma_m(0.08, 1.0) < often.other.landing_sigma_m(0.08, 1.0)


@pytest.mark.parametrize("numbers", [(1.15, 1.0), (0.85, 1.0), (1.0, 1.25), (1.0, 0.75)])
def test_a_valve_that_differs_is_never_believed_to_be_the_configured_one(numbers: tuple[float, float]) -> None:
    spring, friction = numbers
    true = replace(
        VALVE,
        spring_rate_n_per_m=spring * VALVE.spring_rate_n_per_m,
        static_friction_n=friction * VALVE.static_friction_n,
        coulomb_friction_n=friction * VALVE.coulomb_friction_n,
    )
    belief, found = belief_of(VALVE), belief_of(true)
    for place_m, direction in LANDINGS * 4:
        belief = belief.landed(Landing(place_m, direction, found.landing_ma(place_m, direction)), READING_M2, 0.0)
        assert not is_configured(belief)
    assert belief.other is None
    assert belief.spring_ma_per_m == pytest.approx(found.spring_ma_per_m, rel=0.03)
    assert belief.sliding_ma == pytest.approx(found.sliding_ma, rel=0.03)


def test_a_configured_valve_that_changes_is_learned() -> None:
    belief = after_landings(belief_of(VALVE), belief_of(VALVE), 4)
    more_n = {name: 1.3 * getattr(VALVE, name) for name in ("static_friction_n", "coulomb_friction_n")}
    changed = belief_of(replace(VALVE, **more_n))
    assert is_configured(belief)
    assert after_landings(belief, changed, 4).sliding_ma == pytest.approx(changed.sliding_ma, rel=0.02)


def test_one_surprise_for_both_hypotheses_decides_nothing() -> None:
    belief = belief_of(VALVE)
    landing = Landing(0.08, 1.0, belief.landing_ma(0.08, 1.0) + 8.0)  # a force of 8 mA
    assert belief.landed(landing, READING_M2, 0.0).log_odds == pytest.approx(belief.log_odds, abs=0.05)
    assert belief.freed(0.08, 1.0, 4.0).log_odds == pytest.approx(belief.log_odds, abs=0.05)


def test_a_landing_and_a_push_are_as_likely_as_their_closed_forms() -> None:
    belief = belief_of(VALVE)
    assert belief.other is not None
    landing, expected = Landing(0.08, 1.0, belief.landing_ma(0.08, 1.0) + 0.5), []
    for each in (belief, belief.other):
        weights = np.array([0.08, 1.0, 1.0])
        covariance = np.reshape(each.numbers.covariance, (7, 7))[:3, :3]
        total_ma2 = weights @ covariance @ weights + each.spring_ma_per_m**2 * READING_M2 + each.scatter_ma2
        expected.append(math.log(math.exp(-0.125 / total_ma2) / math.sqrt(total_ma2) + 1.0 / 70.0 / 0.7))
    more = belief.landed(landing, READING_M2, 0.0).log_odds - belief.log_odds
    assert more == pytest.approx(expected[1] - expected[0], abs=1e-9)
    draws = np.random.default_rng(1)
    balance_ma, level_ma = belief.balance_ma(0.08), belief.freeing_ma(0.08, 1.0) + 0.3
    for each in (belief, belief.other):
        sigma = [math.sqrt(each.numbers.variances[place]) for place in (SPRING, OFFSET, STATIC)]
        drawn = draws.normal(size=(200_000, 3)) * sigma @ np.array([0.08, 1.0, 1.0]) + each.freeing_ma(0.08, 1.0)
        doubt_ma = math.hypot(0.02 * each.static_ma + 0.01, math.sqrt(each.scatter_ma2))
        share = np.mean(drawn + doubt_ma * draws.normal(size=200_000) > level_ma)
        line, bound_ma = (0.08, 1.0, 0.0, 1.0), level_ma
        assert balance_ma < level_ma
        assert math.exp(each.bound_log_likelihood(line, bound_ma)) - 1.0 / 70.0 == pytest.approx(share, abs=0.005)


def test_the_evidence_of_a_way_is_that_of_a_multivariate_normal_distribution() -> None:
    plant, belief = plant_of(LAGGING, PERIOD_S, 0.0), belief_of(LAGGING)
    assert belief.other is not None
    rollout = plant.rollout(numbers_of(belief.numbers.mean))
    pressure = rollout.pressure.at_rest(belief.balance_ma(0.06))
    moving, way = Moving(pressure, StemState(0.06, 0.0, True, 1.0)), Way(pressure, 0.06)
    for current_ma, samples in ((20.0, 60), (12.5, 240)):
        for _ in range(samples):
            moving = rollout.after(moving, current_ma)
            way = way.read(current_ma, moving.stem.position_m)
    study = Study(plant, way, 0.0, NO_LAG, (0.0, 0.1397))
    found = study.of(belief.numbers, belief.within, moving.stem.position_m, READING_M2, 0.01)
    theta = found.fit.theta
    blocks = np.array(study.blocks(theta))
    sides = [both_sides(theta, place) for place in range(7)]
    columns = [(np.array(study.blocks(up)) - study.blocks(down)) / apart for apart, up, down in sides]

    def evidence(numbers: ValveBelief) -> float:
        jacobian, covariance = np.array(columns).T, np.reshape(numbers.numbers.covariance, (7, 7))
        misses = (
            np.array(way.sums[: len(blocks)]) / way.size - blocks + jacobian @ (np.array(theta) - numbers.numbers.mean)
        )
        noise_m2 = found.variance_m2 * max(1.0, len(blocks) / 6.0)
        total = jacobian @ covariance @ jacobian.T + noise_m2 * np.eye(len(misses))
        return float(-0.5 * (misses @ np.linalg.solve(total, misses) + np.linalg.slogdet(total)[1]))

    expected = evidence(belief.other) - evidence(belief)
    assert expected > 0.5  # it is the configured valve
    factor = found.log_factor(belief.numbers, belief.other.numbers)
    assert factor == pytest.approx(expected, abs=1e-3)


def test_friction_is_surer_for_the_configured_valve_and_a_force_is_not() -> None:
    belief = belief_of(LAGGING)
    assert belief.other is not None
    variances = zip(belief.other.numbers.variances, belief.numbers.variances, strict=True)
    parts = [math.sqrt(surer / general) for surer, general in variances if general > 0.0]
    assert parts[OFFSET] == 1.0
    assert parts[DEAD_TIME] == 1.0
    assert [parts[place] for place in (SPRING, SLIDING, STATIC)] == pytest.approx([1.0 / 6.0] * 3)
