"""The law `nmpc` where the actuator is not as configured: it finds the lag that nobody has told, and none elsewhere."""

from __future__ import annotations

from typing import Any

import pytest

from plant_emulator import valve
from positioner.bench.inprocess import configure
from positioner.bench.playable import check_playable
from positioner.bench.scenario import Scenario
from positioner.laws.law import Observation
from positioner.laws.nmpc.memory import NmpcMemory
from positioner.laws.nmpc.untold.law import UntoldLagLaw, UntoldMemory
from positioner.values import replace
from positioner.valve.fit import ValveFit
from positioner.valve.stiction import StictionTable

PERIOD_S = 1e-3
QUIET = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}

NOISY = {"noise_of_reading": 0.02, "noise_of_span": 0.0}


def played(
    setpoints_mm: tuple[float, ...], sensor: dict[str, float], *, experiments: bool = False, **actuator: float
) -> tuple[UntoldMemory, int]:
    """Return the memory after a second at each setpoint, and the number of moves until another actuator was found."""
    scenario = Scenario(
        name="untold",
        title="a lag that nobody has told",
        law="nmpc",
        seed=5,
        setpoints_mm=setpoints_mm,
        dwell_s=1.0,
        plant={"preset": "paper", "actuator": actuator, "sensor": sensor},
        estimator=sensor,
    )
    configuration = configure(scenario)
    law, settings = configuration.make_law(), check_playable(scenario, configuration)
    assert isinstance(law, UntoldLagLaw)
    if experiments:
        law = replace(law, experiments=True)
    plant = valve.initial_state(settings, scenario.seed)
    applied_ma, time_s, moves = configuration.valve.balance_current_ma(plant.stem.position_m), 0.0, 0
    memory: Any = None
    for setpoint_mm in setpoints_mm:
        for _ in range(round(scenario.dwell_s / PERIOD_S)):
            plant, measured_m = valve.measure(settings, plant)
            memory = memory or law.begin(measured_m)
            seen = Observation(measured_m, applied_ma, PERIOD_S, setpoint_mm * 1e-3, time_s)
            memory, estimate = law.estimate(memory, seen)
            memory, decision = law.decide(memory, estimate.stem, seen, StictionTable())
            moves += decision.reason is not None and decision.actuator is None
            applied_ma, time_s = decision.current_ma, time_s + PERIOD_S
            plant = valve.step(settings, plant, applied_ma, PERIOD_S)
    return memory, moves


def test_an_untold_lag_is_found_and_taken_over() -> None:
    memory, _ = played((73.0, 87.0, 80.0), QUIET, fill_time_constant_s=0.002, vent_time_constant_s=0.002)

    assert memory.actuator is not None
    assert memory.actuator.fill_time_constant_s == memory.actuator.vent_time_constant_s
    assert memory.actuator.fill_time_constant_s == pytest.approx(0.002, rel=0.4)


def test_in_two_percent_noise_it_is_found_within_ten_pushes() -> None:
    memory, moves = played((73.0, 87.0, 80.0), NOISY, fill_time_constant_s=0.002, vent_time_constant_s=0.002)

    assert memory.actuator is not None
    assert memory.actuator.fill_time_constant_s == pytest.approx(0.002, rel=0.4)
    assert 2 <= moves <= 10


def test_a_valve_without_lag_is_never_taken_for_one_and_soon_watched_no_more() -> None:
    memory, moves = played((73.0, 87.0, 80.0, 74.0, 83.0, 77.0), QUIET)

    assert memory.actuator is None
    assert memory.watch.is_over
    assert moves < 15


def test_a_lag_that_the_table_keeps_leads_from_the_first_cycle_on() -> None:
    fit = ValveFit(52538.0, 1707.7, 0.002, 0.002, 1e4, 0.0, 0.0, 100.0, 0.0, 0.01, 0.05, 1423.0, 100.0)
    law = configure(
        Scenario(name="untold", title="a kept lag", law="nmpc", setpoints_mm=(80.0,), dwell_s=1.0)
    ).make_law()
    assert isinstance(law, UntoldLagLaw)
    seen = Observation(0.08, law.believed.valve.balance_current_ma(0.08), PERIOD_S, 0.08, 0.0)
    leads = []
    for table in (StictionTable(), StictionTable(fit=fit)):
        memory, estimate = law.estimate(law.begin(0.08), seen)
        memory, decision = law.decide(memory, estimate.stem, seen, table)
        leads += [{mind.candidate.lag_s for mind in memory.watch.minds if mind.evidence > 0.0}]
        assert decision.actuator is None

    assert leads == [set(), {0.002}]


@pytest.mark.parametrize("experiments", [False, True])
def test_after_pushes_that_failed_it_pushes_as_ever_and_only_if_told_so_makes_an_experiment(
    *, experiments: bool
) -> None:
    law = configure(
        Scenario(name="untold", title="failed pushes", law="nmpc", setpoints_mm=(80.0,), dwell_s=1.0, estimator=QUIET)
    ).make_law()
    assert isinstance(law, UntoldLagLaw)
    law = replace(law, experiments=experiments)
    rest_ma, memory = law.believed.valve.balance_current_ma(0.08), law.begin(0.08)
    for count in range(20):
        seen = Observation(0.08, rest_ma, PERIOD_S, 0.08, count * PERIOD_S)
        memory, estimate = law.estimate(memory, seen)
        memory, _ = law.decide(memory, estimate.stem, seen, StictionTable())
    memory = replace(memory, watch=replace(memory.watch, unmoved=3))

    seen = Observation(0.08, rest_ma, PERIOD_S, 0.085, 20 * PERIOD_S)
    memory, estimate = law.estimate(memory, seen)
    assert isinstance(memory.inner, NmpcMemory)
    _, push = law.believed.decide(memory.inner, estimate.stem, seen, StictionTable())
    after, decision = law.decide(memory, estimate.stem, seen, StictionTable())

    assert push.reason is not None
    assert (after.probe is not None, after.probes) == (experiments, int(experiments))
    assert (decision.current_ma == push.current_ma) is not experiments
