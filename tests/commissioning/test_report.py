"""The result of an identification in words and units."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from positioner.commissioning.identified import IdentifiedValve, Interval
from positioner.commissioning.report import as_json, remarks, rows, unseen
from positioner.valve.parameters import ValveParameters

VALVE = ValveParameters(id="FV-101")
FOUND = IdentifiedValve(
    spring_rate_n_per_m=Interval(52538.0, 52500.0, 52600.0),
    bench_set_n=Interval(0.0, -1.0, 1.0),
    static_friction_n=Interval(1707.7, 1700.0, 1715.0),
    coulomb_friction_n=Interval(1423.0, 1420.0, 1426.0),
    viscous_friction_n_s_per_m=Interval(612.9, 300.0, 1200.0, seen=False),
    stribeck_velocity_m_per_s=Interval(0.000254, 0.0, float("inf"), seen=False),
    fill_time_constant_s=Interval(0.05, 0.049, 0.051),
    vent_time_constant_s=Interval(0.03, 0.029, 0.031),
    dead_time_s=Interval(0.002, 0.001, 0.003),
    noise_of_reading=Interval(0.02, 0.019, 0.021),
    noise_of_span=Interval(0.0, 0.0, 0.0),
    friction_scatter=0.03,
    noise_correlation=1.0,
    breakaways=10,
    steps=8,
    misfit=1.0,
    step_misfit=1.0,
)


def test_the_bench_set_of_the_papers_valve_is_0_to_15_psi() -> None:
    """K·x/S_a at the span: 52538 N/m times 127 mm over 645.2 cm² are 103.4 kPa."""
    found = {(row.name, row.unit): row for row in rows(FOUND, VALVE, "psi")}
    assert found["bench set, at 100 %", "psi"].value == pytest.approx(15.0, abs=0.01)
    assert found["static friction", "% signal"].value == pytest.approx(31.99, abs=0.01)
    assert found["stick band and dead band S", "% signal"].value == pytest.approx(58.647, abs=0.01)
    names = "viscous friction, Stribeck velocity"
    assert unseen(tuple(found.values())) == (f"not shown by this experiment, so the configured value is kept: {names}",)


def test_what_was_not_seen_is_not_written() -> None:
    tables = FOUND.tables()
    assert "viscous_friction_n_s_per_m" not in tables["valve"]
    assert tables["valve.actuator"] == {
        "fill_time_constant_s": 0.05,
        "vent_time_constant_s": 0.03,
        "dead_time_s": 0.002,
    }
    valve = FOUND.laid_over(VALVE)
    assert valve.actuator.dead_time_s == 0.002
    assert valve.viscous_friction_n_s_per_m == VALVE.viscous_friction_n_s_per_m


def test_the_json_is_json_and_the_scatter_of_the_friction_is_told() -> None:
    text = json.dumps(as_json(FOUND, VALVE, "bar"), allow_nan=False)
    assert json.loads(text)["valve"] == "FV-101"
    assert "the friction scatters by 3.0 % from slip to slip" in remarks(FOUND)


def test_a_lag_that_was_not_seen_has_its_bound_told() -> None:
    none = Interval(0.0, 0.0, 0.0005)
    found = replace(FOUND, fill_time_constant_s=none, vent_time_constant_s=replace(none, high=0.0007))
    assert "no lag was seen; one of more than 0.7 ms would have been" in remarks(found)
    assert not any("no lag" in line for line in remarks(FOUND))


def test_steps_that_one_lag_does_not_explain_are_told() -> None:
    assert not any("slew limit" in line for line in remarks(replace(FOUND, step_misfit=1.1)))
    assert any("slew limit" in line for line in remarks(replace(FOUND, step_misfit=1.3)))
