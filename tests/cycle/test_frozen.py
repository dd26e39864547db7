"""Noisy sensors that fall silent are frozen; clean, quantised and held ones are not."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioner.cycle.frozen import CHANGES_SHOWN, LONGEST_REPEATS, SILENCE_S, Noise
from positioner.cycle.plausibility import STOP_BAND_OF_SPAN, ReadingHistory, Refusal, check_reading
from positioner.guard.settings import GuardSettings
from positioner.valve.parameters import ValveParameters
from positioner.wire.messages import Counted, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

VALVE = ValveParameters(id="paper")
SETTINGS = GuardSettings()
PERIOD_S = 0.001
HERE_M = 0.08
RESTING_MA = VALVE.balance_current_ma(HERE_M)
HALF_A_SECOND = pytest.approx(501, abs=1)
WIRE_M = 1e-8
"""The resolution of our frame."""


def stepped(value_m: float, step_m: float = WIRE_M) -> float:
    return round(value_m / step_m) * step_m


def noisy(
    seed: int, sigma_m: float, *, held: int = 1, step_m: float = WIRE_M, place_m: float = HERE_M
) -> Iterator[float]:
    """Yield readings of a resting stem: white noise in steps of `step_m`, each draw repeated for `held` readings."""
    chance = random.Random(seed)  # noqa: S311 - noise that can be repeated, no secret
    while True:
        draw_m = stepped(place_m + chance.gauss(0.0, sigma_m), step_m)
        yield from itertools.repeat(draw_m, held)


class Sensor:
    """Readings one after another, each a period after the one before."""

    def __init__(self, period_s: float = PERIOD_S, tuning: GuardSettings = SETTINGS) -> None:
        self.period_s, self.tuning, self.history = period_s, tuning, ReadingHistory()

    def refuses(self, position_m: float, commanded_ma: float | None = RESTING_MA) -> Counted | None:
        message, period_s = StemPosition(position_m), self.period_s
        self.history, doubt = check_reading(
            self.tuning, VALVE, self.history, message, commanded_ma, period_s, period_s=period_s
        )
        return doubt.counted if doubt else None

    def receives(self, readings: Iterable[float], commanded_ma: float | None = RESTING_MA) -> Sensor:
        for position_m in readings:
            assert self.refuses(position_m, commanded_ma) is None
        return self

    def freezes_after(self, commanded_ma: float | None = RESTING_MA, most: int = 20_000) -> int | None:
        """Return how many readings of the same value it takes; None if `most` do not suffice."""
        here_m = self.history.position_m or 0.0
        return next((count for count in range(1, most) if self.refuses(here_m, commanded_ma)), None)


def shown(sigma_m: float = 1.6e-3, **how: float) -> Iterator[float]:
    return itertools.islice(noisy(1, sigma_m, **how), 20_000)  # type: ignore[arg-type]


@pytest.mark.parametrize("commanded_ma", [None, RESTING_MA, RESTING_MA + 2.0])
def test_a_sensor_that_was_noisy_and_repeats_itself_for_half_a_second_is_frozen_whatever_the_current(
    commanded_ma: float | None,
) -> None:
    assert Sensor().receives(shown()).freezes_after(commanded_ma) == HALF_A_SECOND
    assert Sensor().receives(shown(), None).freezes_after(commanded_ma) == HALF_A_SECOND


def test_short_pushes_do_not_start_the_time_again() -> None:
    sensor = Sensor().receives(shown())
    here_m = sensor.history.position_m or 0.0
    refusals = [sensor.refuses(here_m, 20.0 if count % 50 == 0 else RESTING_MA) for count in range(1, 600)]
    assert refusals.index(Counted.FEEDBACK_FROZEN) + 1 == HALF_A_SECOND


def test_the_first_change_ends_it() -> None:
    sensor = Sensor().receives(shown())
    assert sensor.freezes_after() == HALF_A_SECOND
    here_m = sensor.history.position_m or 0.0
    assert sensor.refuses(here_m) is Counted.FEEDBACK_FROZEN
    assert sensor.refuses(here_m + WIRE_M) is None
    assert sensor.freezes_after() == HALF_A_SECOND


def test_a_hundred_readings_are_the_least_at_long_periods() -> None:
    assert Sensor(0.1).receives(shown()).freezes_after() == pytest.approx(101, abs=1)


@pytest.mark.parametrize("held", [10, 60, 200])
def test_a_sensor_that_holds_its_draws_is_frozen_after_ten_of_its_longest_repeats(held: int) -> None:
    sensor = Sensor().receives(itertools.islice(noisy(1, 1.6e-3, held=held), 400 * held))
    longest_s = (held - 1) * PERIOD_S
    assert sensor.history.noise.longest_s == pytest.approx(longest_s)
    limit = max(500, round(LONGEST_REPEATS * longest_s / PERIOD_S))
    # part of the last draw's repeats is behind it
    assert limit - held <= (sensor.freezes_after() or 0) <= limit + 2


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("held", [1, 10, 100])
def test_noise_alone_is_never_frozen(seed: int, held: int) -> None:
    Sensor().receives(itertools.islice(noisy(seed, 1.6e-3, held=held), 30_000))


def test_a_pause_that_is_no_repeat_by_chance_teaches_nothing() -> None:
    sensor = Sensor().receives(shown())
    for _ in range(20):
        sensor.receives([sensor.history.position_m or 0.0] * 400)
        sensor.receives(itertools.islice(noisy(2, 1.6e-3), 100))
    assert sensor.freezes_after() == HALF_A_SECOND


def test_a_sensor_that_was_still_at_the_start_is_known_by_its_noise() -> None:
    sensor = Sensor().receives([HERE_M] * 10_000).receives(shown())
    assert sensor.freezes_after() == HALF_A_SECOND


def moves(chance: random.Random) -> Iterator[float]:
    """Yield the positions of a stem that rests, slides and rests, for ever, without noise."""
    here_m = HERE_M
    while True:
        yield from itertools.repeat(here_m, chance.randrange(10, 3000))
        there_m, samples = chance.uniform(0.06, 0.09), chance.randrange(3, 60)
        yield from (here_m + (there_m - here_m) * count / samples for count in range(1, samples))
        here_m = there_m


@pytest.mark.parametrize("step_m", [WIRE_M, 1e-5, 1e-4, 1e-3])
def test_a_clean_sensor_is_never_frozen_in_the_stick_band(step_m: float) -> None:
    chance = random.Random(3)  # noqa: S311 - moves that can be repeated, no secret
    sensor = Sensor()
    readings = [stepped(position_m, step_m) for position_m in itertools.islice(moves(chance), 60_000)]
    sensor.receives(readings, None)
    assert not sensor.history.noise.is_noisy


@given(sigma_of_step=st.floats(0.02, 8.0), seed=st.integers(0, 99), held=st.sampled_from([1, 10]))
@settings(max_examples=40)
def test_a_quantised_sensor_is_never_frozen_wherever_the_stem_rests(sigma_of_step: float, seed: int, held: int) -> None:
    """Noise of some steps or less: at one place it toggles, at the next one it may stand still."""
    step_m, sensor = 1e-4, Sensor()
    for rest in range(6):
        place_m = HERE_M + (0.5, 0.0, 0.3, 0.5, 0.1, 0.0)[rest] * step_m
        readings = noisy(seed + rest, sigma_of_step * step_m, held=held, step_m=step_m, place_m=place_m)
        sensor.receives(itertools.islice(readings, 3000))


def test_noise_of_many_steps_is_noise_though_it_is_quantised() -> None:
    assert Sensor().receives(shown(step_m=1e-4)).freezes_after() == HALF_A_SECOND
    assert Sensor().receives(shown(step_m=2e-4)).freezes_after(most=100_000) is None


def test_motion_to_and_fro_is_no_noise_while_the_command_moves_the_stem() -> None:
    """A loop that chatters from sample to sample, and then comes to rest."""
    sensor = Sensor()
    for count in range(5000):
        assert sensor.refuses(HERE_M + 1e-3 * (-1) ** count, 20.0 if count % 2 else 4.0) is None
    assert sensor.freezes_after() is None


@pytest.mark.parametrize("of_span", [0.0, STOP_BAND_OF_SPAN])
def test_against_a_stop_no_sensor_is_frozen(of_span: float) -> None:
    sensor = Sensor().receives(shown())
    at_stop_m = of_span * VALVE.span_m
    sensor.receives([0.045, 0.02])
    sensor.receives([at_stop_m] * 5000, 4.0)
    sensor.receives([at_stop_m + 5e-3])
    assert sensor.freezes_after() == HALF_A_SECOND


def test_zero_seconds_mean_never() -> None:
    sensor = Sensor(tuning=GuardSettings(frozen_s=0.0)).receives(shown())
    assert sensor.freezes_after() is None


def test_fewer_than_a_hundred_changes_are_no_noise() -> None:
    for readings, frozen in ((90, None), (400, HALF_A_SECOND)):
        assert Sensor().receives(itertools.islice(noisy(1, 1.6e-3), readings)).freezes_after() == frozen


def test_what_was_shown_is_counted() -> None:
    noise = Noise()
    for position_m in (1.0, 2.0, 1.0, 1.0, 3.0, 4.0):
        noise = noise.add(position_m, 1.0, 0.5, at_rest=True, counts=True)
    assert (noise.shown, noise.count, noise.sum_m, noise.smallest_m) == (3, 4, 5.0, 1.0)
    assert (noise.repeat_s, noise.longest_s) == (0.0, 0.5)
    noise = noise.add(1.0, 1.0, 0.5, at_rest=False, counts=True)
    assert (noise.shown, noise.count, noise.sum_m) == (3, 4, 5.0)


# limits


NOISY = Noise(position_m=HERE_M, shown=CHANGES_SHOWN, count=CHANGES_SHOWN, sum_m=1.0, smallest_m=1e-6)


def test_a_noisy_sensor_is_silent_only_beyond_its_limit() -> None:
    assert not replace(NOISY, repeat_s=SILENCE_S).is_silent(PERIOD_S)
    assert replace(NOISY, repeat_s=math.nextafter(SILENCE_S, 1.0)).is_silent(PERIOD_S)


def test_noise_that_was_shown_stays_shown() -> None:
    onwards = replace(NOISY, change_m=1e-6).add(HERE_M + 1e-6, PERIOD_S, PERIOD_S, at_rest=True, counts=True)
    assert onwards.shown == CHANGES_SHOWN


@pytest.mark.parametrize(
    ("noise", "longest_s"),
    [
        (Noise(position_m=HERE_M, shown=0, longest_s=5.0, repeat_s=1.0), 1.0),
        (Noise(position_m=HERE_M, shown=1, longest_s=5.0, repeat_s=1.0), 5.0),
        (Noise(position_m=HERE_M, shown=1, longest_s=0.1, repeat_s=0.4), 0.4),
        (replace(NOISY, longest_s=0.01, repeat_s=SILENCE_S / 3.0), SILENCE_S / 3.0),
        (replace(NOISY, longest_s=0.01, repeat_s=0.4), 0.01),
    ],
)
def test_the_longest_repeat_is_the_longest_that_was_chance(noise: Noise, longest_s: float) -> None:
    assert noise.add(HERE_M + 1e-6, PERIOD_S, PERIOD_S, at_rest=True, counts=True).longest_s == longest_s


@pytest.mark.parametrize(("beyond_ma", "counted"), [(-1.0, 1), (0.0, 1), (1e-9, 0), (0.5, 0), (1.5, 0)])
def test_a_change_counts_as_noise_up_to_the_edge_of_the_stick_band(beyond_ma: float, counted: int) -> None:
    valve = ValveParameters(id="paper", travel_min_m=-0.05)
    edge_ma = valve.static_friction_n / valve.force_gain_n_per_ma  # at 0 m, where the spring asks for no current
    history = ReadingHistory(position_m=1e-6, noise=Noise(position_m=1e-6))
    history, _ = check_reading(SETTINGS, valve, history, StemPosition(0.0), edge_ma + beyond_ma, PERIOD_S, PERIOD_S)
    assert history.noise.count == counted


@pytest.mark.parametrize("frozen_s", [0.0, 0.5, 2.0])
def test_a_silent_noisy_sensor_is_refused_with_the_time_unless_the_check_is_off(frozen_s: float) -> None:
    history = ReadingHistory(position_m=HERE_M, noise=replace(NOISY, repeat_s=0.45))
    tuning = replace(SETTINGS, frozen_s=frozen_s)
    _, refusal = check_reading(tuning, VALVE, history, StemPosition(HERE_M), RESTING_MA, 0.1, PERIOD_S)
    why = "frozen: not a bit of change for 0.55 s, and its noise never paused so long"
    assert refusal == (Refusal(Counted.FEEDBACK_FROZEN, why) if frozen_s else None)
