"""S and J from command and stem position: exact slips give exact values, and what shows too little stays undecided."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from positioner.diagnostics.direct.diagnosis import Record, diagnose_stem
from positioner.diagnostics.direct.estimate import friction_of
from positioner.diagnostics.direct.slips import Rest, Slip, noise_of, rests_in, slips_in
from positioner.diagnostics.verdict import Verdict

Array = NDArray[np.float64]


def stick_slip(command: Array, static: float, sliding: float, slope: float = 1.0) -> Array:
    """Return the stem by the definition: it rests while |u - k·x| ≤ F_s, and a slip leaves F_c."""
    place, found = float(command[0]) / slope, []
    for each in command.tolist():
        pull = each - slope * place
        if abs(pull) > static:
            place = (each - np.sign(pull) * sliding) / slope
        found.append(place)
    return np.array(found)


def swinging(amplitude: float, count: int = 4000) -> Array:
    """Return a command whose extremes and rates differ."""
    time = np.arange(count)
    return np.asarray(50.0 + amplitude * (np.sin(time / 61.0) + 0.3 * np.sin(time / 23.0)))


def exact_slips(slope: float, offset: float, static: float, sliding: float) -> list[Slip]:
    """Return slips that obey both equations, from places at unequal distances."""
    found = []
    for number, place in enumerate((31.0, 36.5, 44.0, 52.0, 47.5, 39.0, 33.0)):
        side = 1.0 if number % 2 == 0 else -1.0
        slipped = offset + slope * place + side * static
        after = (slipped - offset - side * sliding) / slope
        found.append(Slip(side, Rest(0, 100, place), Rest(100, 200, after), slipped, 0.0, slipped))
    return found


@pytest.mark.parametrize(("slope", "static", "sliding"), [(1.0, 5.0, 3.0), (0.8, 12.0, 11.0), (1.3, 2.0, 0.5)])
def test_slips_that_obey_the_equations_give_back_their_friction(slope: float, static: float, sliding: float) -> None:
    friction = friction_of(exact_slips(slope, 7.0, static, sliding), 1e-6, 1.0, 10.0)
    assert friction.stick.value == pytest.approx(static + sliding, abs=1e-5)
    assert friction.jump.value == pytest.approx(static - sliding, abs=1e-5)
    assert friction.slope == pytest.approx(slope, abs=1e-6)
    assert friction.offset == pytest.approx(7.0, abs=1e-4)
    assert friction.residual < 1e-5


def test_one_wrong_slip_in_eight_changes_little() -> None:
    slips = exact_slips(1.0, 0.0, 5.0, 3.0) * 3
    wrong = Slip(1.0, slips[0].before, slips[0].after, slips[0].command_at_slip + 4.0, 0.0, slips[0].command_at_stop)
    friction = friction_of([*slips, wrong, wrong, wrong], 0.05, 1.0, 0.15)
    assert friction.stick.value == pytest.approx(8.0, abs=0.1)


def test_a_known_slope_decides_where_the_stem_swings_between_two_places() -> None:
    up = Slip(1.0, Rest(0, 100, 40.0), Rest(100, 200, 44.0), 45.0, 0.0, 45.0)
    down = Slip(-1.0, Rest(100, 200, 44.0), Rest(200, 300, 40.0), 39.0, 0.0, 39.0)
    for slope in (0.9, 1.0, 1.2):
        friction = friction_of([up, down] * 5, 0.05, slope, 0.01)
        assert friction.jump.value == pytest.approx(4.0 * slope, abs=0.01)
        assert friction.stick.value == pytest.approx(6.0, abs=0.01)
    assert friction_of([up, down] * 5, 0.05, 1.0, 0.1).jump.half_width == pytest.approx(1.96 * 0.4, rel=0.1)


def test_noise_is_that_of_the_readings_and_not_of_the_jumps() -> None:
    steps = np.repeat([10.0, 14.0, 9.0, 13.0, 8.0], 400)
    noise = 0.05 * np.random.default_rng(4).standard_normal(steps.size)
    assert noise_of(steps + noise) == pytest.approx(0.05, rel=0.15)


def test_every_rest_and_every_jump_is_found() -> None:
    places = [10.0, 10.5, 11.2, 10.4, 9.7]
    readings = np.repeat(places, 60) + 0.05 * np.random.default_rng(5).standard_normal(300)
    rests = rests_in(readings, 0.05)
    assert [rest.begin for rest in rests] == [0, 60, 120, 180, 240]
    assert [rest.place for rest in rests] == pytest.approx(places, abs=0.03)


def test_a_single_wrong_reading_is_no_slip() -> None:
    readings = np.full(200, 20.0) + 0.05 * np.random.default_rng(6).standard_normal(200)
    readings[100] += 3.0
    assert len(rests_in(readings, 0.05)) == 1


def test_a_slip_lies_between_the_farthest_command_that_held_and_the_one_that_moved_the_stem() -> None:
    command = np.array([50.0, 50.5, 51.0, 50.2, 50.9, 52.0, 52.1, 52.0, 52.0])
    position = np.array([48.0, 48.0, 48.0, 48.0, 48.0, 50.0, 50.0, 50.0, 50.0])
    (slip,) = slips_in(command, position, 0.01)
    assert (slip.command_at_slip, slip.half_step, slip.command_at_stop) == (51.5, 0.5, 52.0)


@pytest.mark.parametrize(("stick", "jump"), [(1.0, 0.4), (3.0, 2.0), (12.0, 3.0)])
@pytest.mark.parametrize("lag", [0, 1])
def test_stick_and_jump_are_within_their_intervals(stick: float, jump: float, lag: int) -> None:
    command = swinging(stick + 1.0)
    position = stick_slip(command, 0.5 * (stick + jump), 0.5 * (stick - jump))
    noise = 0.05 * np.random.default_rng(7).standard_normal(command.size)
    found = diagnose_stem(Record(command[lag:], (position + noise)[: command.size - lag], 1.0))
    assert (found.verdict, found.lag, found.has_jump) == (Verdict.YES, lag, True)
    assert found.friction is not None
    assert found.friction.stick.value == pytest.approx(stick, rel=0.03)
    assert found.friction.jump.value == pytest.approx(jump, abs=0.15)
    assert found.friction.stick.low <= stick <= found.friction.stick.high


def test_a_stem_that_follows_does_not_stick() -> None:
    command = swinging(10.0)
    position = command + 0.05 * np.random.default_rng(8).standard_normal(command.size)
    found = diagnose_stem(Record(command, position, 1.0))
    assert found.verdict is Verdict.NO
    assert found.band < 0.3


def test_a_stem_that_hardly_moves_under_a_command_that_hardly_moves_proves_nothing() -> None:
    command = swinging(0.13)
    position = np.full(command.size, 50.0) + 0.05 * np.random.default_rng(8).standard_normal(command.size)
    found = diagnose_stem(Record(command, position, 1.0))
    assert found.verdict is Verdict.UNDECIDED
    assert "OP moved by 0.33 % only, and within 1.4 % a stem that sticks may rest" in found.reason
    # but one that is seen to follow such a command is free
    assert diagnose_stem(Record(command, command + 0.2 * (position - 50.0), 1.0)).verdict is Verdict.NO


@pytest.mark.parametrize(
    ("noise", "verdict"), [(0.14, Verdict.NO), (0.25, Verdict.UNDECIDED), (1.0, Verdict.UNDECIDED)]
)
def test_noise_that_hides_whether_the_stem_follows_proves_nothing(noise: float, verdict: Verdict) -> None:
    command = swinging(10.0)
    position = command + noise * np.random.default_rng(8).standard_normal(command.size)
    found = diagnose_stem(Record(command, position, 1.0))
    assert found.verdict is verdict
    assert ("hides an S of 0.7 %" in found.reason) is (verdict is Verdict.UNDECIDED)


def test_slips_in_one_direction_are_not_enough() -> None:
    command = np.linspace(10.0, 90.0, 3000)
    found = diagnose_stem(Record(command, stick_slip(command, 5.0, 3.0), 1.0))
    assert found.verdict is Verdict.UNDECIDED
    assert "both directions" in found.reason


def test_a_stuck_stem_is_undecided() -> None:
    command = swinging(1.0)
    found = diagnose_stem(Record(command, np.full(4000, 50.0), 1.0))
    assert (found.verdict, len(found.slips)) == (Verdict.UNDECIDED, 0)
