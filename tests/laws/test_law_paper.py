"""The paper's law: when which bound is in force, what it does without a plan, and the facts of its closed loop."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from unsolvable import Unsolvable

from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import InProcessRun, run_in_process
from positioner.bench.scenario import load_scenario
from positioner.cycle.events import LawFellBack, Learned
from positioner.guard.settings import GuardSettings
from positioner.laws.bounds import Bounds
from positioner.laws.estimator_settings import EstimatorSettings
from positioner.laws.law import Observation
from positioner.laws.paper.bounds import BoundSettings, approach_speed_limit_m_per_s
from positioner.laws.paper.estimator import FilteredStem
from positioner.laws.paper.law import PaperLaw, PaperMemory
from positioner.laws.paper.planner import PlannerSettings
from positioner.laws.registry import LAWS, Ingredients
from positioner.laws.settings import ControlSettings
from positioner.optimization.solver import QpSolver
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters
from positioner.valve.stiction import Direction, LearnedSample, Quantity, StictionTable
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.laws.law import Decision
    from positioner.optimization.qp import QuadraticProgram

VALVE = ValveParameters(id="paper")
FREE = Bounds(-10.0, 10.0, 4.0, 20.0)
PERIOD_S = 1e-3
TABLE = (
    StictionTable()
    .record(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.OPENING, 17.9)
    .record(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.CLOSING, 7.3)
    .record(Quantity.STICK_SPEED, 0.087, Direction.OPENING, 0.4)
    .record(Quantity.STICK_SPEED, 0.073, Direction.CLOSING, 0.2)
)


def paper_law(*, use_table: bool = True, table_from_s: float = 0.0) -> PaperLaw:
    return PaperLaw(
        "paper",
        VALVE,
        PlannerSettings(),
        EstimatorSettings(),
        BoundSettings(),
        QpSolver(4, 4),
        4.0,
        20.0,
        PERIOD_S,
        use_table,
        table_from_s,
    )


def stem_at(position_m: float, velocity_m_per_s: float = 0.0, *, stuck: bool = True) -> FilteredStem:
    return FilteredStem(position_m, velocity_m_per_s, stuck, 1.0, 1e-8)


def seen(setpoint_m: float, time_s: float = 0.0, measured_m: float = 0.08) -> Observation:
    return Observation(measured_m, VALVE.balance_current_ma(0.08), PERIOD_S, setpoint_m, time_s)


def decided(
    law: PaperLaw, stem: FilteredStem, setpoint_m: float, table: StictionTable, time_s: float = 0.0
) -> Decision:
    return law.decide(law.begin(0.08), stem, seen(setpoint_m, time_s), table)[1]


def test_a_law_begins_at_rest_with_the_spring_balanced() -> None:
    memory = paper_law().begin(0.08)
    assert memory.inputs_ma == pytest.approx(np.full(4, VALVE.balance_current_ma(0.08)))
    assert (memory.stem.position_m, memory.stem.stuck, memory.released) == (0.08, True, False)
    # at 1 cm the spring takes 1.57 mA, which the loop cannot carry
    assert paper_law().begin(0.01).inputs_ma.tolist() == [4.0] * 4


def test_an_estimate_is_carried_to_the_next_cycle() -> None:
    law = paper_law()
    memory, estimate = law.estimate(law.begin(0.08), seen(0.08, measured_m=0.081))
    assert memory.stem is estimate.stem
    assert memory.stem.position_m == pytest.approx(0.0805)


def test_a_slip_and_a_stop_of_the_estimate_are_the_lessons() -> None:
    law = paper_law()
    taught: list[LearnedSample] = []
    memory, applied_ma = law.begin(0.08), VALVE.balance_current_ma(0.08) + 6.0
    for _ in range(100):
        stem = memory.stem
        # the plant that the model expects
        end = MotionModel.of(VALVE).step(
            stem.position_m, stem.velocity_m_per_s, applied_ma, Load.of(VALVE), 1.0, PERIOD_S
        )
        memory, estimate = law.estimate(memory, Observation(end.x, applied_ma, PERIOD_S, 0.08, 0.0))
        taught += estimate.lessons
    slip, stop = taught
    assert slip == LearnedSample(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.OPENING, applied_ma)
    assert stop.quantity is Quantity.STICK_SPEED
    assert stop.position_m == pytest.approx(memory.stem.position_m, abs=1e-6)


@pytest.mark.parametrize(("setpoint_m", "low_ma", "high_ma"), [(0.087, 17.9, 20.0), (0.073, 4.0, 7.3)])
def test_gamma_releases_a_stuck_stem_for_one_sample_and_lifts_the_speed_bound(
    setpoint_m: float, low_ma: float, high_ma: float
) -> None:
    law = paper_law()
    memory, first = law.decide(law.begin(0.08), stem_at(0.08), seen(setpoint_m), TABLE)
    assert first.bounds == Bounds(-10.0, 10.0, low_ma, high_ma)
    assert low_ma <= first.current_ma <= high_ma
    assert first.motion is Motion.MOVE
    memory, second = law.decide(memory, stem_at(0.08), seen(setpoint_m), TABLE)
    assert (second.bounds.current_low_ma, second.bounds.current_high_ma) == (4.0, 20.0)
    assert second.bounds != FREE
    assert second.motion is Motion.REST
    _, third = law.decide(memory, stem_at(0.08), seen(setpoint_m), TABLE)
    assert third.bounds == first.bounds


def test_a_sliding_stem_is_not_released_but_bounded() -> None:
    decision = decided(paper_law(), stem_at(0.08, 0.3, stuck=False), 0.087, TABLE)
    limit = approach_speed_limit_m_per_s(BoundSettings(), 0.007, 0.4)
    assert decision.bounds == Bounds(-10.0, decision.bounds.speed_high_m_per_s, 4.0, 20.0)
    assert decision.bounds.speed_high_m_per_s == pytest.approx(limit)
    assert decision.motion is Motion.MOVE


def test_the_speed_bound_of_a_closing_move_is_below() -> None:
    decision = decided(paper_law(), stem_at(0.08, -0.3, stuck=False), 0.073, TABLE)
    limit = approach_speed_limit_m_per_s(BoundSettings(), 0.007, 0.2)
    assert decision.bounds == Bounds(decision.bounds.speed_low_m_per_s, 10.0, 4.0, 20.0)
    assert decision.bounds.speed_low_m_per_s == pytest.approx(-limit)


def test_where_nothing_was_learned_no_bound_moves() -> None:
    for stuck in (True, False):
        assert decided(paper_law(), stem_at(0.08, stuck=stuck), 0.087, StictionTable()).bounds == FREE
    # learned elsewhere, or for the other direction, is not learned here
    elsewhere = StictionTable().record(Quantity.BREAKAWAY_CURRENT, 0.06, Direction.OPENING, 15.0)
    assert decided(paper_law(), stem_at(0.08), 0.087, elsewhere).bounds == FREE


def test_a_stem_that_sticks_close_enough_is_left_there() -> None:
    near = decided(paper_law(), stem_at(0.08), 0.0809, TABLE)
    assert (near.bounds.current_low_ma, near.bounds.current_high_ma) == (4.0, 20.0)
    assert near.motion is Motion.REST
    far = decided(paper_law(), stem_at(0.08), 0.0811, TABLE)
    assert far.bounds.current_low_ma == 17.9


def test_the_table_is_not_used_before_its_time() -> None:
    law = paper_law(table_from_s=3.0)
    for stem in (stem_at(0.08), stem_at(0.08, 0.3, stuck=False)):
        assert decided(law, stem, 0.087, TABLE, 2.999).bounds == FREE
        assert decided(law, stem, 0.087, TABLE, 3.0).bounds != FREE


def test_the_plain_law_never_uses_the_table() -> None:
    law = paper_law(use_table=False)
    for stem in (stem_at(0.08), stem_at(0.08, 0.3, stuck=False)):
        assert decided(law, stem, 0.087, TABLE, 1e6).bounds == FREE


@pytest.mark.parametrize(("position_m", "current_ma"), [(0.08, 12.598), (0.01, 4.0), (0.139, 20.0)])
def test_without_a_plan_the_spring_is_balanced_and_the_reason_given(position_m: float, current_ma: float) -> None:
    law = replace(paper_law(), solver=Unsolvable())
    memory, decision = law.decide(law.begin(0.08), stem_at(position_m), seen(0.087), TABLE)
    assert decision.current_ma == pytest.approx(current_ma, abs=1e-3)
    assert (decision.motion, decision.passes) == (Motion.REST, 0)
    assert "no plan" in decision.fallback
    assert "spring balanced" in decision.fallback
    assert memory.inputs_ma.tolist() == [decision.current_ma] * 4


def test_a_missing_plan_uses_up_the_release() -> None:
    law = replace(paper_law(), solver=Unsolvable())
    memory, _ = law.decide(law.begin(0.08), stem_at(0.08), seen(0.087), TABLE)
    assert memory.released


def test_the_next_guess_is_the_plan_shifted_by_one() -> None:
    guesses: list[list[float]] = []

    class Spy:
        def __init__(self) -> None:
            self.inner = QpSolver(4, 4)

        def solve(
            self,
            program: QuadraticProgram,
            inputs: Sequence[float] | None = None,
            multipliers: Sequence[float] | None = None,
        ) -> list[float] | None:
            found = self.inner.solve(program, inputs, multipliers)
            assert found is not None
            guesses.append(found)
            return found

    law = replace(paper_law(), solver=Spy())
    memory, decision = law.decide(
        PaperMemory(stem_at(0.08), np.full(4, 12.0)), stem_at(0.08, 0.2, stuck=False), seen(0.087), StictionTable()
    )
    plan = np.clip(guesses[-1], 4.0, 20.0)
    assert decision.current_ma == plan[0]
    assert memory.inputs_ma.tolist() == [*plan[1:], plan[-1]]
    assert decision.passes == len(guesses)


@pytest.mark.parametrize("name", LAWS)
def test_every_law_is_made_under_its_name(name: str) -> None:
    description, make = LAWS[name]
    law = make(Ingredients(ControlSettings(), VALVE, EstimatorSettings(), GuardSettings(), QpSolver))
    assert law.name == name
    assert description


def test_the_registry_passes_the_configuration_on() -> None:
    control = ControlSettings(sample_period_s=1e-4, table_from_s=3.0)
    guard = GuardSettings(current_low_ma=3.9, current_high_ma=20.3)
    for name, use_table in (("paper", True), ("paper-plain", False)):
        law = LAWS[name][1](Ingredients(control, VALVE, EstimatorSettings(), guard, QpSolver))
        assert isinstance(law, PaperLaw)
        assert (law.period_s, law.table_from_s, law.use_table) == (1e-4, 3.0, use_table)
        assert (law.current_low_ma, law.current_high_ma) == (3.9, 20.3)


# the closed loop, without noise, at the paper's sample time of 0.1 ms


@pytest.fixture(scope="module")
def frictionless() -> InProcessRun:
    return run_in_process(load_scenario("frictionless"))


@pytest.fixture(scope="module")
def noise_free() -> InProcessRun:
    return run_in_process(load_scenario("noise-free"))


def tails_m(run: InProcessRun) -> list[tuple[float, NDArray[np.float64], NDArray[np.float64]]]:
    """Return setpoint, true positions and currents of the last 50 ms of each dwell of 0.2 s."""
    recording = run.recording
    ends = range(2000, recording.samples + 1, 2000)
    return [
        (
            float(recording.setpoint_m[end - 1]),
            recording.true_position_m[end - 500 : end],
            recording.current_ma[end - 500 : end],
        )
        for end in ends
    ]


def offset_per_ma_m() -> float:
    """Return the steady error per mA that the penalty on the absolute current causes: the fixed point of eq. 17.

    At rest at x, the free response to balance u is x + p (u - u_eq), p the positions per mA held for H_p samples. The
    first input is u_eq when its gradient, R u + Q p_1 (x - r) summed over the horizon, is zero for all inputs together.
    """
    plant = plant_settings("frictionless").valve
    a = np.array([[1.0, 1e-4], [-plant.spring_rate_n_per_m * 1e-4 / 1.361, 1.0 - 612.9 * 1e-4 / 1.361]])
    b = np.array([0.0, plant.diaphragm_area_m2 * plant.pressure_gain_pa_per_ma * 1e-4 / 1.361])
    forced = np.zeros((4, 4))
    for j in range(4):
        state = np.zeros(2)
        for i in range(4):
            state = a @ state + b * (i == j)
            forced[i, j] = 100.0 * state[0]  # cm
    balance_ma = 10.0
    # z = argmin |e + F (u_eq - z)|² + R |z|²: linear in e; find the e for which z_0 = u_eq
    normal = forced.T @ forced + 1e-5 * np.eye(4)
    by_error = np.linalg.solve(normal, forced.T @ np.ones(4))
    by_balance = np.linalg.solve(normal, forced.T @ forced @ np.full(4, balance_ma))
    return float((balance_ma - by_balance[0]) / by_error[0] / balance_ma) / 100.0


def test_the_predicted_offset_is_the_one_of_147_milliampere_per_centimetre() -> None:
    assert 0.01 / offset_per_ma_m() == pytest.approx(147.0, rel=0.01)


def test_without_friction_the_offset_is_what_the_penalty_on_the_current_predicts(frictionless: InProcessRun) -> None:
    for setpoint_m, positions_m, currents_ma in tails_m(frictionless):
        error_m = setpoint_m - float(positions_m.mean())
        assert error_m == pytest.approx(offset_per_ma_m() * float(currents_ma.mean()), rel=0.01)
        assert 0.54 < 100.0 * error_m / 0.127 < 0.74


def test_without_friction_the_stem_comes_to_rest(frictionless: InProcessRun) -> None:
    for _, positions_m, currents_ma in tails_m(frictionless):
        assert np.ptp(positions_m) < 1e-7
        assert np.ptp(currents_ma) <= 0.002


def test_without_friction_nothing_sticks_and_nothing_is_learned(frictionless: InProcessRun) -> None:
    assert not any(cycle.stem.stuck for cycle in frictionless.cycles)
    assert not any(isinstance(event, Learned | LawFellBack) for event in frictionless.events)


def test_without_friction_the_overshoot_is_small(frictionless: InProcessRun) -> None:
    # simulation 1 of the paper overshoots a little; ours by some two percent of the span
    overshoot_m = float(frictionless.recording.true_position_m[:2000].max()) - 0.073
    assert 1.0 < 100.0 * overshoot_m / 0.127 < 3.5


def test_without_noise_the_plain_law_sticks_once_and_has_no_limit_cycle(noise_free: InProcessRun) -> None:
    errors = []
    for setpoint_m, positions_m, currents_ma in tails_m(noise_free):
        assert np.ptp(positions_m) == 0.0
        assert np.ptp(currents_ma) <= 0.002
        errors.append(100.0 * abs(setpoint_m - float(positions_m.mean())) / 0.127)
    assert 0.54 < float(np.mean(errors)) < 0.74
    assert all(0.4 < error < 0.9 for error in errors)


def test_without_noise_each_dwell_teaches_one_slip_and_one_stop(noise_free: InProcessRun) -> None:
    learned = [event.sample.quantity for event in noise_free.events if isinstance(event, Learned)]
    # the first slip comes at 10 mm under the whole loop, 20 mA, which is no breakaway current
    assert learned == [Quantity.STICK_SPEED, *[Quantity.BREAKAWAY_CURRENT, Quantity.STICK_SPEED] * 2]
    assert not any(isinstance(event, LawFellBack) for event in noise_free.events)
    assert noise_free.table.sequence == 5
