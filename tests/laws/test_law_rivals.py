"""The rival laws, each against a sequence worked out by hand or a closed form."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from plant_emulator.presets import plant_settings
from plant_emulator.valve import initial_state, step
from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import load_scenario
from positioner.config.reader import parse_config
from positioner.errors import ConfigurationError
from positioner.laws.law import Observation
from positioner.laws.rivals.knocker import Knocker, KnockerSettings
from positioner.laws.rivals.pi import NoCompensator, PiLaw
from positioner.laws.rivals.pid import PidController, PidSettings
from positioner.laws.rivals.reinforcement import Reinforcement, ReinforcementSettings
from positioner.laws.rivals.two_move import Stage, TwoMoveLaw, TwoMoveRetrySettings, TwoMoveSettings
from positioner.valve.parameters import ValveParameters
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from positioner.laws.law import Law

VALVE = ValveParameters(id="paper")
TABLE = StictionTable()
PERIOD_S = 1e-3
RIVALS = ("pi", "pi-deadband", "knocker", "constant-reinforcement", "two-move", "two-move-retry")
LOW_MA, HIGH_MA = 4.0, 20.0


@dataclass(frozen=True)
class Cycle:
    """The result of one cycle of a law."""

    current_ma: float
    motion: Motion
    memory: Any


def gains(kp: float = 0.0, ki: float = 0.0, kd: float = 0.0, filter_s: float = 0.0) -> PidSettings:
    return PidSettings(
        proportional_gain_ma_per_m=kp,
        integral_gain_ma_per_m_s=ki,
        derivative_gain_ma_s_per_m=kd,
        filter_time_constant_s=filter_s,
    )


def controller(pid: PidSettings) -> PidController:
    return PidController(pid, LOW_MA, HIGH_MA)


def pi_law(pid: PidSettings, deadband_m: float = 0.0) -> PiLaw[None]:
    return PiLaw("pi", VALVE, controller(pid), NoCompensator(), deadband_m)


def play(law: Law[Any], readings: Iterable[tuple[float, float]], period_s: float = PERIOD_S) -> list[Cycle]:
    """Return the cycles of a law that begins at 80 mm and then sees pairs of reading and setpoint, in m."""
    memory, cycles = law.begin(0.08), []
    for number, (measured_m, setpoint_m) in enumerate(readings):
        observation = Observation(measured_m, 12.0, period_s, setpoint_m, number * period_s)
        memory, estimate = law.estimate(memory, observation)
        memory, decision = law.decide(memory, estimate.stem, observation, TABLE)
        cycles.append(Cycle(decision.current_ma, decision.motion, memory))
    return cycles


def currents(cycles: list[Cycle]) -> list[float]:
    return [cycle.current_ma for cycle in cycles]


MIDDLE_MA = VALVE.balance_current_ma(0.08)


def rival(name: str) -> Law[Any]:
    return parse_config(
        f'[valve]\nid = "v"\npreset = "paper"\n[control]\nlaw = "{name}"\n', "valve.toml", Path()
    ).make_law()


def test_a_pi_that_cancels_the_pole_of_a_linear_plant_makes_it_first_order() -> None:
    # tau x' = g (u - u_0) - (x - x_0), K_i = K_p / tau: the loop is first order with tau / (g K_p)
    tau_s, gain_m_per_ma, kp, step_m = 0.05, 0.004, 1000.0, 0.001
    law = pi_law(gains(kp, kp / tau_s))
    period_s = 1e-5
    position_m, memory = 0.08, law.begin(0.08)
    worst = 0.0
    for sample in range(6000):
        predicted_m = 0.08 + step_m * (1.0 - math.exp(-gain_m_per_ma * kp / tau_s * sample * period_s))
        worst = max(worst, abs(position_m - predicted_m))
        observation = Observation(position_m, 12.0, period_s, 0.08 + step_m, 0.0)
        memory, estimate = law.estimate(memory, observation)
        memory, decision = law.decide(memory, estimate.stem, observation, TABLE)
        push_m = gain_m_per_ma * (decision.current_ma - MIDDLE_MA)
        position_m += period_s / tau_s * (push_m - (position_m - 0.08))
    assert worst < 2e-3 * step_m
    assert position_m == pytest.approx(0.081, abs=1e-2 * step_m)


def test_filter_and_derivative_follow_their_equations() -> None:
    # T_f = T halves the distance to every reading; the speed is that of the filter
    law = pi_law(gains(kp=100.0, kd=0.5, filter_s=PERIOD_S))
    cycles = play(law, [(0.082, 0.08), (0.082, 0.08), (0.080, 0.08)])
    filtered_m = [0.081, 0.0815, 0.08075]
    speeds_m_per_s = [1.0, 0.5, -0.75]
    assert [cycle.memory.pid.position_m for cycle in cycles] == pytest.approx(filtered_m)
    wanted = [MIDDLE_MA + 100.0 * (0.08 - x) - 0.5 * v for x, v in zip(filtered_m, speeds_m_per_s, strict=True)]
    assert currents(cycles) == pytest.approx(wanted)


def test_a_new_setpoint_is_no_kick_of_the_derivative() -> None:
    cycles = play(pi_law(gains(kp=10.0, kd=5.0)), [(0.08, 0.08), (0.08, 0.09)])
    assert currents(cycles) == pytest.approx([MIDDLE_MA, MIDDLE_MA + 0.1])


def test_the_integral_sums_the_error_of_every_cycle() -> None:
    cycles = play(pi_law(gains(ki=1000.0)), [(0.08, 0.081)] * 5)
    assert currents(cycles) == pytest.approx([MIDDLE_MA + 1e-3 * k for k in range(5)])


@pytest.mark.parametrize(("sign", "limit_ma"), [(1.0, HIGH_MA), (-1.0, LOW_MA)])
def test_the_integral_does_not_wind_up_at_a_limit_and_leaves_it_at_once(sign: float, limit_ma: float) -> None:
    away = (0.08, 0.08 + sign * 0.02)
    back = (0.08, 0.08 - sign * 0.001)
    cycles = play(pi_law(gains(kp=500.0, ki=5000.0)), [away] * 1000 + [back] * 2)
    assert currents(cycles)[:1000] == [limit_ma] * 1000
    # unlimited, it would be sign * 100 mA by now
    integrals_ma = [cycle.memory.pid.integral_ma for cycle in cycles]
    assert integrals_ma[999] == integrals_ma[0] == pytest.approx(MIDDLE_MA)
    assert cycles[1000].current_ma == pytest.approx(MIDDLE_MA - sign * 0.5)
    assert integrals_ma[1001] == pytest.approx(MIDDLE_MA - sign * 2 * 0.005)


def test_at_a_limit_the_integral_may_still_come_back() -> None:
    # the proportional part alone holds the current at its limit; an error of the other sign unwinds
    law = pi_law(gains(ki=5000.0, kd=100.0))
    memory = replace(law.begin(0.08), pid=replace(law.begin(0.08).pid, integral_ma=19.9))
    observation = Observation(0.079, 12.0, PERIOD_S, 0.0785, 0.0)
    memory, estimate = law.estimate(memory, observation)
    memory, decision = law.decide(memory, estimate.stem, observation, TABLE)
    assert decision.current_ma == HIGH_MA
    assert memory.pid.integral_ma == pytest.approx(19.9 - 5000.0 * 0.0005 * PERIOD_S)


def test_a_law_that_begins_beyond_the_loops_range_begins_at_its_limit() -> None:
    # the spring takes 1.57 mA at 1 cm, which the loop cannot carry
    assert pi_law(gains(kp=100.0)).begin(0.01).current_ma == LOW_MA


def test_inside_the_dead_band_current_and_integral_are_frozen() -> None:
    law = pi_law(gains(kp=100.0, ki=1000.0), deadband_m=0.001)
    cycles = play(law, [(0.08, 0.082)] * 3 + [(0.0815, 0.082)] * 4 + [(0.0805, 0.082)])
    moving, frozen, again = cycles[2], cycles[3:7], cycles[7]
    assert [cycle.current_ma for cycle in frozen] == [moving.current_ma] * 4
    assert {cycle.motion for cycle in frozen} == {Motion.REST}
    assert frozen[-1].memory.pid.integral_ma == moving.memory.pid.integral_ma == pytest.approx(MIDDLE_MA + 0.006)
    assert again.current_ma == pytest.approx(MIDDLE_MA + 0.006 + 0.15)
    assert again.motion is Motion.NONE


def knocker(off_band_m: float = 0.0, ki: float = 10.0) -> PiLaw[Any]:
    settings = KnockerSettings(
        pid=gains(ki=ki),
        pulse_amplitude_ma=2.0,
        pulse_width_s=0.003,
        pulse_period_s=0.010,
        off_band_m=off_band_m,
    )
    return PiLaw("knocker", VALVE, controller(settings.pid), Knocker(settings))


def pulses(readings: list[tuple[float, float]], off_band_m: float = 0.0) -> list[float]:
    """Return the current in mA that the knocker adds to the output of its controller."""
    with_pulses = play(knocker(off_band_m), readings)
    without = play(pi_law(gains(ki=10.0)), readings)
    return [a.current_ma - b.current_ma for a, b in zip(with_pulses, without, strict=True)]


def test_pulses_begin_every_period_and_end_after_their_width() -> None:
    # cycle k ends k + 1 periods after control began
    wanted = [2.0 if (k + 1) % 10 < 3 and k >= 9 else 0.0 for k in range(45)]
    assert pulses([(0.08, 0.081)] * 45) == pytest.approx(wanted)
    assert sum(wanted) == 2.0 * 3 * 4


def test_pulses_push_where_the_controller_is_going() -> None:
    up, down = (0.08, 0.081), (0.081, 0.080)
    found = pulses([up] * 12 + [down] * 18)
    assert found[9:12] == pytest.approx([2.0] * 3)
    assert found[19:22] == pytest.approx([-2.0] * 3)
    assert found[29] == pytest.approx(-2.0)


def test_a_controller_that_stands_still_is_not_knocked() -> None:
    assert pulses([(0.08, 0.08)] * 30) == [0.0] * 30


def test_inside_the_off_band_no_pulse_begins_but_one_that_began_ends_as_it_should() -> None:
    outside, inside = (0.08, 0.0815), (0.08, 0.0805)
    assert pulses([inside] * 30, off_band_m=0.001) == [0.0] * 30
    found = pulses([outside] * 10 + [inside] * 20, off_band_m=0.001)
    assert found == pytest.approx([0.0] * 9 + [2.0] * 3 + [0.0] * 18)


def reinforced(readings: list[tuple[float, float]], off_band_m: float = 0.0) -> list[float]:
    settings = ReinforcementSettings(pid=gains(kp=100.0), reinforcement_ma=1.5, off_band_m=off_band_m)
    law = PiLaw("cr", VALVE, controller(settings.pid), Reinforcement(settings))
    plain = play(pi_law(settings.pid), readings)
    return [a.current_ma - b.current_ma for a, b in zip(play(law, readings), plain, strict=True)]


def test_reinforcement_has_the_sign_of_the_change_of_the_controllers_output() -> None:
    setpoints_m = [0.081, 0.082, 0.082, 0.0815, 0.0817]
    assert reinforced([(0.08, r) for r in setpoints_m]) == pytest.approx([1.5, 1.5, 0.0, -1.5, 1.5])


def test_inside_the_off_band_nothing_is_added() -> None:
    setpoints_m = [0.081, 0.0804, 0.0803, 0.0808]
    assert reinforced([(0.08, r) for r in setpoints_m], off_band_m=0.0005) == pytest.approx([1.5, 0.0, 0.0, 1.5])


MOVES = TwoMoveSettings(move_s=0.005, back_off_m=0.012)
RETRY = TwoMoveRetrySettings(moves=MOVES, averaging_s=0.010, tolerance_m=0.0005, most_retries=2, learning_gain=0.5)


def two_move(retry: TwoMoveRetrySettings | None = None) -> TwoMoveLaw:
    return TwoMoveLaw("two-move", VALVE, MOVES, retry, LOW_MA, HIGH_MA)


def push_ma(position_m: float, direction: float) -> float:
    """Return the current in mA that balances spring and kinetic friction, from Table 3: 333.64 N/mA."""
    return (52538.0 * position_m + direction * 1423.0) / (0.06452 * 0.75 * 6894.757)


@pytest.mark.parametrize(("setpoint_m", "direction"), [(0.087, 1.0), (0.073, -1.0)])
def test_two_moves_take_the_stem_there_and_leave_it_there(setpoint_m: float, direction: float) -> None:
    cycles = play(two_move(), [(0.08, setpoint_m)] * 8)
    assert currents(cycles) == pytest.approx([push_ma(setpoint_m, direction)] * 5 + [push_ma(setpoint_m, 0.0)] * 3)
    assert [cycle.motion for cycle in cycles] == [Motion.MOVE] * 5 + [Motion.REST] * 3


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_setpoint_nearer_than_the_slip_jump_is_approached_from_farther_away(direction: float) -> None:
    setpoint_m = 0.08 + direction * 0.006  # 1.15 slip jumps are 6.23 mm
    away_ma, there_ma = push_ma(0.08 - direction * 0.012, -direction), push_ma(setpoint_m, direction)
    found = currents(play(two_move(), [(0.08, setpoint_m)] * 12))
    assert found == pytest.approx([away_ma] * 5 + [there_ma] * 5 + [push_ma(setpoint_m, 0.0)] * 2)


def test_without_a_new_setpoint_the_stem_is_held_where_control_began() -> None:
    for law in (two_move(), two_move(RETRY)):
        assert currents(play(law, [(0.0815, 0.08)] * 30)) == pytest.approx([MIDDLE_MA] * 30)


def test_on_the_valve_it_knows_two_moves_hit_within_a_tenth_of_a_millimetre() -> None:
    settings = plant_settings("paper", {"valve": {"initial_position_m": 0.08}})
    law = replace(two_move(), moves=replace(MOVES, move_s=0.08))
    plant, memory = initial_state(settings, 1), law.begin(0.08)
    landed_m = []
    for setpoint_m in (0.073, 0.0735, 0.0835):
        for _ in range(400):
            observation = Observation(plant.stem.position_m, 12.0, PERIOD_S, setpoint_m, plant.time_s)
            memory, estimate = law.estimate(memory, observation)
            memory, decision = law.decide(memory, estimate.stem, observation, TABLE)
            plant = step(settings, plant, decision.current_ma, PERIOD_S)
        assert plant.stem.is_at_rest
        landed_m.append(plant.stem.position_m - setpoint_m)
    assert max(map(abs, landed_m)) < 1e-4


def test_a_stem_that_rests_too_far_away_is_moved_again_by_what_was_learned() -> None:
    # 5 cycles of the first move, 10 of averaging, and the stem rests 1 mm short: b = 0.5 mm
    readings = [(0.08, 0.087)] * 5 + [(0.086, 0.087)] * 40
    cycles = play(two_move(RETRY), readings)
    stages = [cycle.memory.stage for cycle in cycles]
    assert stages[:15] == [Stage.APPROACH] * 5 + [Stage.REST] * 10
    # 1.5 mm are less than the slip jump
    assert stages[15:25] == [Stage.BACK_OFF] * 5 + [Stage.APPROACH] * 5
    assert cycles[15].current_ma == pytest.approx(push_ma(0.086 - 0.012, -1.0))
    assert cycles[20].current_ma == pytest.approx(push_ma(0.0875, 1.0))
    assert cycles[20].memory.closing_bias_m == 0.0


def test_what_was_learned_shifts_the_current_and_not_the_choice_of_the_moves() -> None:
    law = two_move(RETRY)
    memory = replace(law.begin(0.08), opening_bias_m=0.010, closing_bias_m=-0.003)
    observation = Observation(0.08, 12.0, PERIOD_S, 0.083, 0.0)
    memory, estimate = law.estimate(memory, observation)
    memory, decision = law.decide(memory, estimate.stem, observation, TABLE)
    assert memory.stage is Stage.BACK_OFF
    assert decision.current_ma == pytest.approx(push_ma(0.068 - 0.003, -1.0))


def test_retries_end_and_a_new_setpoint_brings_new_ones() -> None:
    readings = [(0.08, 0.087)] * 5 + [(0.086, 0.087)] * 100
    cycles = play(two_move(RETRY), [*readings, (0.086, 0.073)])
    assert [cycle.memory.retries for cycle in (cycles[14], cycles[15], cycles[60], cycles[104])] == [0, 1, 2, 2]
    assert cycles[104].memory.opening_bias_m == pytest.approx(2 * 0.0005)
    assert cycles[105].memory.retries == 0
    assert cycles[105].memory.stage is Stage.APPROACH


def test_an_error_within_the_tolerance_is_left_and_only_the_average_counts() -> None:
    # readings 2 mm off, to either side: their average is right, and what was read in the move is no part of it
    readings = [(0.08, 0.087)] * 6 + [(0.085, 0.087), (0.089, 0.087)] * 20
    cycles = play(two_move(RETRY), readings)
    assert {cycle.memory.stage for cycle in cycles[5:]} == {Stage.REST}
    assert cycles[45].memory.position_m == pytest.approx(0.087, abs=1e-4)


def noisy(cycles: int) -> list[tuple[float, float]]:
    chance = np.random.default_rng(7)
    readings = chance.uniform(-0.005, 0.145, cycles)
    setpoints = np.repeat(chance.uniform(0.0, 0.1397, cycles // 100), 100)
    return list(zip(readings.tolist(), setpoints.tolist(), strict=True))


@pytest.mark.parametrize("name", RIVALS)
def test_whatever_a_law_sees_its_current_is_one_of_the_loop(name: str) -> None:
    found = currents(play(rival(name), noisy(1000)))
    assert all(LOW_MA <= current_ma <= HIGH_MA for current_ma in found)
    assert {LOW_MA, HIGH_MA} < set(found)


@pytest.mark.parametrize("name", RIVALS)
def test_a_law_leaves_its_memories_as_they_were(name: str) -> None:
    law, readings = rival(name), noisy(200)
    first = play(law, readings)
    # from a memory of the middle, the law gives the same answers again
    memory, kept = first[99].memory, deepcopy(first[99].memory)
    for number, (measured_m, setpoint_m) in enumerate(readings[100:], start=100):
        observation = Observation(measured_m, 12.0, PERIOD_S, setpoint_m, number * PERIOD_S)
        memory, estimate = law.estimate(memory, observation)
        memory, decision = law.decide(memory, estimate.stem, observation, TABLE)
        assert decision.current_ma == first[number].current_ma
    assert memory == first[-1].memory
    assert first[99].memory == kept


@pytest.mark.parametrize("name", RIVALS)
def test_a_law_without_a_model_teaches_the_table_nothing(name: str) -> None:
    scenario = replace(load_scenario("paper-valve"), law=name, visits=1, dwell_s=0.05)
    run = run_in_process(scenario)
    assert {cycle.stem.stuck for cycle in run.cycles} == {False}
    assert np.ptp(run.recording.true_position_m) > 0.01
    assert run.table.sequence == 0


@pytest.mark.parametrize("name", RIVALS)
def test_a_law_is_made_with_its_own_parameters(name: str) -> None:
    assert rival(name).name == name


def refused(text: str) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        parse_config(f'[valve]\nid = "v"\npreset = "paper"\n{text}', "valve.toml", Path())
    return str(caught.value).splitlines()


def test_half_a_set_of_gains_is_refused() -> None:
    problems = refused("[control.pi]\nproportional_gain_ma_per_m = 1.0\n")
    assert len(problems) == 3
    assert any("integral_gain_ma_per_m_s: is required and missing" in problem for problem in problems)


def test_pulses_that_would_overlap_are_refused() -> None:
    make: Callable[[float], KnockerSettings] = lambda width_s: replace(  # noqa: E731 - a name for one change
        KnockerSettings(pid=gains(), pulse_amplitude_ma=1.0, pulse_width_s=0.01, pulse_period_s=0.02, off_band_m=0.0),
        pulse_width_s=width_s,
    )
    assert make(0.02).pulse_width_s == 0.02
    with pytest.raises(ValueError, match="overlap"):
        make(0.021)
