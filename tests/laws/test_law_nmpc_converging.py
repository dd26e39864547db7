"""The law `nmpc`: predictive moves while they converge, and where they do not, others that lead to the setpoint."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest
from loop_helpers import Loop
from test_law_pushes import JAMMED

from positioner.cycle.events import Controlled, LawFellBack
from positioner.cycle.trust_events import PushFailed
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Estimate, Observation
from positioner.laws.move_reason import Breakaway, MoveReason
from positioner.laws.nmpc.converging import Acting, ConvergingLaw, ConvergingMemory, Dwell
from positioner.laws.pushes import MOST_FAILED
from positioner.laws.quasi_static.belief import Landing, belief_of
from positioner.valve.state import StemState
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Cause, Health, HostRequest, Mode, Motion

if TYPE_CHECKING:
    from positioner.laws.law import Law

SETPOINTS_M = (0.073, 0.087, 0.08, 0.076, 0.077, 0.09)
LAGGED: dict[str, Any] = {"preset": "paper", "actuator": {"fill_time_constant_s": 0.1, "vent_time_constant_s": 0.1}}


def memory_of(loop: Loop) -> ConvergingMemory:
    memory = loop.state.control.memory
    assert isinstance(memory, ConvergingMemory)
    return memory


def with_predictive(law: Law[float], **plant: Any) -> Loop:
    """Return a loop whose predictive moves are those of `law`."""
    loop = Loop("nmpc", plant={"preset": "paper", **plant})
    assert isinstance(loop.setup.law, ConvergingLaw)
    loop.setup = replace(loop.setup, law=replace(loop.setup.law, predictive=law))
    return loop


def taken_over(loop: Loop) -> list[str]:
    return [event.why for event in loop.events_of(LawFellBack) if "quasi-static moves take over" in event.why]


@pytest.mark.parametrize("preset", ["paper", "spring-20"])
def test_where_predictive_moves_converge_every_current_is_theirs(preset: str) -> None:
    loops = [Loop(law, plant={"preset": preset}) for law in ("nmpc-predictive", "nmpc")]
    for loop in loops:
        for setpoint_m in SETPOINTS_M:
            loop.run(0.6, setpoint_m)
    first, second = ([event.current_ma for event in loop.events_of(Controlled)] for loop in loops)
    assert len(first) > 3000
    assert first == second
    assert not taken_over(loops[1])


# √(m/K) of the paper's valve is 5.1 ms, so the limit is a period of 3.05 ms
@pytest.mark.parametrize(("period_s", "is_coarse"), [(0.0025, False), (0.005, True)])
def test_where_a_slip_is_over_within_a_few_samples_quasi_static_moves_come_first(
    period_s: float, is_coarse: bool
) -> None:
    loop = Loop("nmpc", sample_period_s=period_s, setpoint_period_s=0.01)
    for setpoint_m in SETPOINTS_M:
        loop.run(1.5, setpoint_m)
        assert memory_of(loop).acting is (Acting.QUASI_STATIC if is_coarse else Acting.PREDICTIVE)
        assert abs(loop.position_m - setpoint_m) < 0.005 * 0.127
    assert not taken_over(loop)


def test_where_quasi_static_moves_come_first_they_come_first_at_the_next_setpoint_again() -> None:
    law = Loop("nmpc", sample_period_s=0.005, setpoint_period_s=0.01).setup.law
    assert isinstance(law, ConvergingLaw)
    memory = replace(law.begin(0.08), acting=Acting.AGAIN, dwell=Dwell(0.08), pause=0)
    for setpoint_m, acting in ((0.0805, Acting.AGAIN), (0.09, Acting.QUASI_STATIC)):
        seen = Observation(0.08, 12.0, 0.005, setpoint_m, 0.0)
        memory, estimate = law.estimate(memory, seen)
        memory, _ = law.decide(memory, estimate.stem, seen, StictionTable())
        assert memory.acting is acting


def test_behind_a_lag_that_nobody_has_told_quasi_static_moves_lead_to_the_setpoint() -> None:
    loop, errors_pct = Loop("nmpc", plant=LAGGED), list[float]()
    for setpoint_m in SETPOINTS_M:
        loop.run(4.0, setpoint_m)
        errors_pct.append(100.0 * abs(loop.position_m - setpoint_m) / 0.1397)
    assert taken_over(loop)
    assert max(errors_pct) < 1.0
    assert max(errors_pct[2:]) < 0.3


def test_a_valve_that_differs_from_its_configuration_is_out_of_specification() -> None:
    loop = Loop("nmpc", plant=LAGGED)
    loop.run(4.0, 0.073)
    loop.run(4.0, 0.087)
    guard = loop.state.guard
    assert (guard.mode, guard.cause) == (Mode.ACTIVE, Cause.VALVE_DIFFERS)
    assert guard.health(table_saved=True) is Health.OUT_OF_SPECIFICATION
    loop.run(0.05, 0.087, HostRequest.DISARM)
    assert not loop.state.differs


def test_a_predictive_law_that_believes_the_stem_elsewhere_than_it_is_read_is_relieved() -> None:
    # 220 mm/s for 0.65 s were believed of a stem that rested 10 mm away, at 1 % noise and nothing more than 20 % off
    loop = with_predictive(Idle(off_m=0.01))
    loop.run(0.3, 0.08)
    (why,) = taken_over(loop)
    assert re.match(r"readings 7\.[89]. % of span from where the stem is believed to be", why)


@dataclass(frozen=True)
class Idle:
    """A law that moves nothing: its moves never converge. It believes the stem `off_m` from where it is read."""

    off_m: float = 0.0

    name = "idle"

    def begin(self, measured_m: float) -> float:
        return measured_m

    def estimate(self, memory: float, observation: Observation) -> tuple[float, Estimate]:
        return memory, Estimate(StemState(observation.measured_m + self.off_m, 0.0, True, 1.0))

    def decide(
        self, memory: float, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[float, Decision]:
        del stem, table
        bounds = Bounds(-math.inf, math.inf, 4.0, 20.0)
        return memory, Decision(observation.applied_ma, bounds, Motion.REST)


def test_after_some_setpoints_the_predictive_law_is_tried_again_and_after_a_second_failure_later() -> None:
    loop = with_predictive(Idle())
    failed_at = []
    for number in range(16):
        before = len(taken_over(loop))
        loop.run(1.0, (0.073, 0.087)[number % 2])
        assert not memory_of(loop).quasi_static.is_other
        if len(taken_over(loop)) > before:
            failed_at.append((number, memory_of(loop).pause))
    assert failed_at == [(0, 4), (5, 8), (15, 16)]
    assert all(" % of span off for " in why for why in taken_over(loop))


@dataclass(frozen=True)
class Roundabout(Idle):
    """A law that always wants to correct an error of `error_m`, by way of a place `away_m` from the setpoint."""

    error_m: float = 0.0
    away_m: float = 0.0

    def decide(
        self, memory: float, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[float, Decision]:
        memory, decision = super().decide(memory, stem, observation, table)
        if abs(observation.setpoint_m - stem.position_m) < 0.5 * self.error_m:
            return memory, decision  # it is told that the stem is where it should be
        reason = MoveReason(self.error_m, Breakaway(12.0), observation.setpoint_m - self.away_m)
        return memory, replace(decision, reason=reason)


@pytest.mark.parametrize(
    ("error_m", "away_m", "ended", "aim_m", "is_made"),
    [
        (0.0003, 0.0138, 0, None, True),  # 0.3 mm for 2.5 s, or 13.9 mm for the 54 ms that a move lasts
        (0.0003, 0.0140, 0, None, False),
        (0.0003, -0.0140, 0, None, False),
        (0.0003, 0.0068, 2, None, True),  # the second correction must pay twice
        (0.0003, 0.0070, 2, None, False),
        (0.0004, 0.02, 0, None, True),  # the first move of more than 0.3 % of span
        (0.0004, 0.02, 0, 0.08, False),  # it has been made
        (0.0004, 0.02, 1, None, False),
        (0.001, 0.047, 1, None, False),
        (0.0011, 0.06, 1, None, True),  # more than 0.85 %
    ],
)
def test_a_correction_is_made_where_it_pays(
    error_m: float, away_m: float, ended: int, aim_m: float | None, is_made: bool
) -> None:
    law = Loop("nmpc").setup.law
    assert isinstance(law, ConvergingLaw)
    law = replace(law, predictive=Roundabout(error_m=error_m, away_m=away_m))
    memory = law.begin(0.08)
    assert memory.lasts_s == pytest.approx(0.5 * law.patience_s)
    memory = replace(memory, lasts_s=0.054, dwell=Dwell(0.08 + error_m, ended=ended, aim_m=aim_m))
    seen = Observation(0.08, 12.0, 0.001, 0.08 + error_m, 0.0)
    memory, estimate = law.estimate(memory, seen)
    memory, decision = law.decide(memory, estimate.stem, seen, StictionTable())
    assert (decision.reason is not None) is is_made
    assert (memory.dwell.left_m is None) is is_made


@pytest.mark.parametrize(
    ("error_m", "ended", "is_made"),
    [(0.0005, 3, True), (0.0005, 4, False), (0.0007, 4, True), (0.0005, 9, False)],  # 2 σ is 0.6 mm
)
def test_after_four_moves_a_correction_that_is_not_expected_to_halve_the_error_is_not_made(
    error_m: float, ended: int, is_made: bool
) -> None:
    law = Loop("nmpc").setup.law
    assert isinstance(law, ConvergingLaw)
    law = replace(law, predictive=Roundabout(error_m=error_m))
    dwell = Dwell(0.08 + error_m, ended=ended, missed_m2=ended * 0.0003**2)
    memory, seen = replace(law.begin(0.08), dwell=dwell), Observation(0.08, 12.0, 0.001, 0.08 + error_m, 0.0)
    memory, estimate = law.estimate(memory, seen)
    memory, decision = law.decide(memory, estimate.stem, seen, StictionTable())
    assert (decision.reason is not None) is is_made
    assert memory.dwell.left_m == (None if is_made else 0.08 + error_m)


def test_a_setpoint_at_which_the_stem_was_left_is_tried_again_when_it_comes_back() -> None:
    law = Loop("nmpc").setup.law
    assert isinstance(law, ConvergingLaw)
    law = replace(law, predictive=Idle())
    memory = law.begin(0.08)
    for setpoint_m, left_m in ((0.0805, 0.0805), (0.0801, None), (0.0805, None)):
        seen = Observation(0.08, 12.0, 0.001, setpoint_m, 0.0)
        if left_m is not None:
            memory = replace(memory, dwell=Dwell(setpoint_m, ended=1, left_m=left_m))
        memory, estimate = law.estimate(memory, seen)
        memory, _ = law.decide(memory, estimate.stem, seen, StictionTable())
        assert memory.dwell.setpoint_m == 0.0805  # a setpoint so near to another one is the same dwell
        assert memory.dwell.left_m == left_m


def test_how_long_a_move_lasts_is_measured() -> None:
    loop = Loop("nmpc", plant={"preset": "paper", "sensor": {"noise_of_reading": 0.0}})
    for setpoint_m in SETPOINTS_M:
        loop.run(0.3, setpoint_m)
    moved_s = 1e-3 * sum(event.decision.motion is Motion.MOVE for event in loop.events_of(Controlled))
    begun = sum(event.decision.reason is not None for event in loop.events_of(Controlled))
    assert 0.3 * moved_s / begun < memory_of(loop).lasts_s < 3.0 * moved_s / begun


def test_as_long_as_another_valve_is_measured_predictive_moves_are_not_tried() -> None:
    loop = Loop("nmpc", plant=LAGGED)
    for number in range(10):
        loop.run(3.0, (0.073, 0.087)[number % 2])
    memory = memory_of(loop)
    assert (memory.quasi_static.is_other, memory.left, memory.acting) == (True, 0, Acting.QUASI_STATIC)
    assert len(taken_over(loop)) == 1


@pytest.mark.parametrize(
    ("offset_of_span", "is_sure", "acting"),
    [
        (0.0, True, Acting.PREDICTIVE),
        (0.008, True, Acting.PREDICTIVE),
        (0.012, True, Acting.QUASI_STATIC),
        (-0.012, True, Acting.QUASI_STATIC),
        (0.0, False, Acting.QUASI_STATIC),
    ],
)
def test_predictive_moves_come_back_where_what_was_measured_says_that_they_will_not_miss(
    offset_of_span: float, is_sure: bool, acting: Acting
) -> None:
    law = Loop("nmpc").setup.law
    assert isinstance(law, ConvergingLaw)
    begun = law.begin(0.08)
    belief = begun.quasi_static.belief
    offset_ma = offset_of_span * 0.127 * belief.spring_ma_per_m
    for place_m, direction in ((0.06, 1.0), (0.1, -1.0), (0.07, 1.0), (0.065, -1.0), (0.095, 1.0)) * 4 * is_sure:
        pressure_ma = belief_of(law.quasi_static.valve).landing_ma(place_m, direction) + offset_ma
        belief = belief.landed(Landing(place_m, direction, pressure_ma), 1e-12, 0.0)
    quasi_static = replace(begun.quasi_static, belief=belief)
    memory = replace(begun, acting=Acting.QUASI_STATIC, left=1, quasi_static=quasi_static)
    seen = Observation(0.08, belief.balance_ma(0.08), 0.001, 0.09, 0.0)
    memory, estimate = law.estimate(memory, seen)
    memory, _ = law.decide(memory, estimate.stem, seen, StictionTable())
    assert memory.acting is acting


def test_what_the_predictive_law_commanded_last_is_not_taken_for_a_move_of_the_other() -> None:
    # the stem still follows 4 mA behind 200 ms that nobody has told when it is taken over: that shows no lag, and ends
    # where it ends; the moves after it show the lag, and lead to the setpoint
    lags = {"fill_time_constant_s": 0.2, "vent_time_constant_s": 0.2}
    loop = Loop("nmpc", plant={"preset": "paper", "actuator": lags, "sensor": {"noise_of_reading": 0.005}})
    loop.run(1.5, 0.083)
    loop.run(4.0, 0.0657)
    assert taken_over(loop)
    assert memory_of(loop).acting is Acting.QUASI_STATIC
    assert 0.15 < memory_of(loop).quasi_static.more_lag_s < 0.4
    loop.run(4.0, 0.0657)
    assert loop.position_m == pytest.approx(0.0657, abs=7e-4)


def test_a_stem_that_is_jammed_is_pushed_again_once_quasi_static_moves_have_not_freed_it() -> None:
    loop = Loop("nmpc", plant=JAMMED)
    loop.run(0.5, 0.08)
    loop.run(12.0, 0.087)
    assert memory_of(loop).acting is Acting.AGAIN
    failed = [event.failed for event in loop.events_of(PushFailed)]
    again = next(number for number, (now, later) in enumerate(pairwise(failed)) if number > 5 and later < now)
    assert 8 <= failed[again] <= 14  # two for each of seven quasi-static moves
    assert failed[-1] == MOST_FAILED + 3  # in 12 s: after 20 it rests, for 1, 2, 4, 8... seconds


def test_a_setpoint_out_of_reach_says_nothing_against_the_law() -> None:
    loop = Loop("nmpc")
    loop.run(0.6, 0.08)
    loop.run(3.0, 0.125)  # 20 mA open the valve to 99.9 mm
    assert memory_of(loop).pause == 0
    loop.run(0.5, 0.08)
    assert memory_of(loop).acting is Acting.PREDICTIVE
    assert loop.position_m == pytest.approx(0.08, abs=7e-4)
