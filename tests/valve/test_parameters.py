"""The parameters of a valve: the forces that follow from them, and what their limits refuse."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from positioner.errors import ConfigurationError
from positioner.inputs.toml_reader import build
from positioner.valve.parameters import ValveParameters

NOMINAL = ValveParameters(id="nominal")


def test_the_current_of_balance_leaves_no_net_force() -> None:
    valve = replace(NOMINAL, bench_set_n=120.0)
    assert valve.net_force_n(0.08, valve.balance_current_ma(0.08)) == pytest.approx(0.0, abs=1e-9)
    # paper Table 3: one mA is S_a K_p = 333.6 N, and at 8 cm the spring takes 12.6 mA
    assert NOMINAL.force_gain_n_per_ma == pytest.approx(333.63, abs=0.01)
    assert NOMINAL.balance_current_ma(0.08) == pytest.approx(12.598, abs=0.001)


def test_kinetic_friction_falls_from_static_to_coulomb() -> None:
    # eq. 4 with the negative exponent: at V_s a part of 1/e of the excess is left
    assert NOMINAL.kinetic_friction_n(0.0) == 1707.7
    at_stribeck = 1423.0 + (1707.7 - 1423.0) / math.e
    assert NOMINAL.kinetic_friction_n(0.000254) == pytest.approx(at_stribeck)
    assert NOMINAL.kinetic_friction_n(-0.000254) == pytest.approx(at_stribeck)
    assert NOMINAL.kinetic_friction_n(1e200) == 1423.0


@pytest.mark.parametrize(
    ("key", "value", "limit"),
    [
        ("mass_kg", 1361.0, "200"),
        ("mass_kg", 0.0, "0.01"),
        ("span_m", 127.0, "1.3"),
        ("spring_rate_n_per_m", 52.5, "100"),
    ],
)
def test_a_slip_of_a_unit_is_refused_with_the_limit(key: str, value: float, limit: str) -> None:
    with pytest.raises(ConfigurationError, match=limit):
        build({"id": "v", key: value}, ValveParameters, "valve")


def test_sliding_friction_above_static_friction_is_refused() -> None:
    with pytest.raises(ValueError, match="never the larger"):
        ValveParameters(id="v", static_friction_n=100.0, coulomb_friction_n=100.1)
    ValveParameters(id="v", static_friction_n=100.0, coulomb_friction_n=100.0)


def test_travel_stops_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(ValueError, match="travel_max_m"):
        ValveParameters(id="v", travel_min_m=0.05, travel_max_m=0.05)
