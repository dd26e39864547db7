"""Which errors are worth two moves, where the setpoint is nearer than the smallest push."""

from __future__ import annotations

import pytest

from positioner.laws.nmpc.correction import is_worth_a_move
from positioner.laws.nmpc.correlated_noise import CorrelatedNoise
from positioner.laws.nmpc.covariance import independent
from positioner.laws.nmpc.filter import AdaptiveFilter, Resting, Sliding
from positioner.laws.nmpc.memory import NmpcMemory
from positioner.laws.nmpc.repeatability import Repeatability
from positioner.laws.nmpc.sensor_noise import SensorNoise
from positioner.laws.nmpc.settings import AdaptationSettings, NmpcSettings
from positioner.laws.nmpc.verification import RestMonitor
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters

VALVE = ValveParameters(id="paper")
NOMINAL = Load.of(VALVE)
FILTER = AdaptiveFilter(AdaptationSettings(), MotionModel.of(VALVE), NOMINAL)
SIGMA_M, SCATTER_M, SHORTEST_M, PERIOD_S = 1e-5, 1e-3, 5e-3, 0.02


def is_worth(
    error_m: float,
    scatter_m: float = SCATTER_M,
    rested_s: float = 0.4,
    corrections: int = 1,
    shortest_m: float = SHORTEST_M,
) -> bool:
    """Return whether a stem moves again that has rested so long, after so many moves."""
    stop = Sliding(0.08, 0.0, NOMINAL, independent(SIGMA_M**2, FILTER.prior_sigmas()), 1.0, stopped=True)
    here = Resting(0.08, SIGMA_M**2, stop, Load(0.0, 0.0, 0.0))
    noise = SensorNoise(CorrelatedNoise(count=rested_s / PERIOD_S))
    monitor = RestMonitor(1.2, noise, repeatability=Repeatability(scatter_m2=scatter_m**2))
    memory = NmpcMemory(
        here,
        monitor,
        setpoint_m=0.08 + error_m,
        is_new=corrections == 0,
        corrections=corrections,
        shortest_m=shortest_m,
    )
    return is_worth_a_move(NmpcSettings(), memory, here, PERIOD_S)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_error_inside_the_scatter_of_landings_is_not_worth_two_moves(sign: float) -> None:
    assert not is_worth(sign * 0.4 * SCATTER_M)
    assert is_worth(sign * 0.8 * SCATTER_M)


def test_where_landings_repeat_the_same_error_is_worth_them() -> None:
    assert is_worth(0.4 * SCATTER_M, scatter_m=0.1 * SCATTER_M)


def test_a_stem_that_has_rested_moves_for_a_clearly_larger_error_only() -> None:
    assert not is_worth(0.8 * SCATTER_M, rested_s=2.0)
    assert is_worth(1.3 * SCATTER_M, rested_s=2.0)


def test_with_every_correction_a_larger_error_is_left() -> None:
    assert not is_worth(0.8 * SCATTER_M, corrections=6)


def test_one_move_is_enough_for_an_error_beyond_the_smallest_push_and_a_new_setpoint_is_pursued() -> None:
    assert is_worth(1.01 * SHORTEST_M, scatter_m=0.1)
    assert not is_worth(0.99 * SHORTEST_M, scatter_m=0.1)
    assert is_worth(0.4 * SCATTER_M, corrections=0)


def test_where_readings_steer_the_smallest_push_the_scatter_does_not_count() -> None:
    natural_jump_m = 0.2 * NOMINAL.friction_n / NOMINAL.spring_n_per_m
    assert not is_worth(0.4 * SCATTER_M, shortest_m=0.55 * natural_jump_m)
    assert is_worth(0.4 * SCATTER_M, shortest_m=0.45 * natural_jump_m)


def test_an_error_inside_the_tolerance_is_left_alone() -> None:
    assert not is_worth(4e-5, scatter_m=0.0)
