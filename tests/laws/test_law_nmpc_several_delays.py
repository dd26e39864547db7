"""The law `nmpc` where dead time, I/P lag and slew limit come together: the pressure, what a rise shows, the loop."""

from __future__ import annotations

import math

import pytest

from plant_emulator.presets import plant_settings
from positioner.bench.configure import told
from positioner.bench.metrics import totals
from positioner.bench.scenario import Scenario
from positioner.laws.nmpc.lagged.drive import Drive, drive_of
from positioner.laws.nmpc.lagged.pipeline import Pipeline, pipeline_at
from positioner.laws.nmpc.lagged.supply import NO_RISE
from positioner.studies.direct import play_directly
from positioner.valve.actuator import ActuatorParameters

PERIOD_S = 1e-3
DEAD_S, CONVERTER_S, SLEW_PA_PER_S = 0.003, 0.008, 400e3
QUIET = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}


def drive(lag_s: float, **more: float) -> Drive:
    actuator = ActuatorParameters(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s, **more)
    return drive_of(actuator, PERIOD_S, 4.0, 20.0)


def test_behind_a_converter_the_pressure_is_that_of_two_lags_in_closed_form() -> None:
    own, pressure_ma, converter_ma = drive(0.05, converter_time_constant_s=CONVERTER_S), 8.0, 8.0
    for _ in range(12):
        pressure_ma, converter_ma = own.after(pressure_ma, converter_ma, 20.0)

    left = (0.05 * math.exp(-0.012 / 0.05) - CONVERTER_S * math.exp(-0.012 / CONVERTER_S)) / (0.05 - CONVERTER_S)
    assert pressure_ma == pytest.approx(20.0 - 12.0 * left, abs=1e-3)


@pytest.mark.parametrize(
    ("more", "samples"),
    [
        ({"converter_time_constant_s": 0.02}, 40),
        ({"slew_ma_per_s": 77.0}, 30),  # all the while at the limit
        ({"slew_ma_per_s": 77.0}, 150),  # and then below it
        ({"converter_time_constant_s": 0.02, "slew_ma_per_s": 77.0}, 170),
    ],
)
def test_the_derivative_of_the_pressure_to_the_lag_is_that_of_two_neighbours(
    more: dict[str, float], samples: int
) -> None:
    def after(lag_s: float) -> Pipeline:
        own, line = drive(lag_s, **more), pipeline_at(8.0, 0.1, 0.0, PERIOD_S)
        for _ in range(samples):
            line = line.after(own, 18.0)
        return line

    by_lag = (after(0.0502).pressure_ma - after(0.0498).pressure_ma) / 4e-4

    assert after(0.05).by_lag == pytest.approx(by_lag, rel=0.05, abs=0.1)


def test_a_pressure_at_the_slew_limit_keeps_its_doubt() -> None:
    own, line = drive(0.05, slew_ma_per_s=77.0), pipeline_at(8.0, 0.1, 0.0, PERIOD_S)
    for _ in range(30):
        line = line.after(own, 18.0)

    assert line.doubt_ma == 0.1


@pytest.mark.parametrize(
    "more", [{"converter_time_constant_s": CONVERTER_S}, {"slew_ma_per_s": 77.0}, {"dead_time_s": DEAD_S}]
)
@pytest.mark.parametrize("end_ma", [20.0, 14.0])
def test_a_rise_ends_below_its_current_only_where_the_supply_is_low(more: dict[str, float], end_ma: float) -> None:
    own, rise, found = drive(0.05, **more), NO_RISE, list[float]()
    pressure_ma, converter_ma, believed_ma = 8.0, 8.0, 8.0
    for _ in range(400):
        _, believed_ma = own.after(pressure_ma, believed_ma, 20.0)
        pressure_ma, converter_ma = own.after(pressure_ma, converter_ma, end_ma)
        rise, low_ma = rise.after(own, pressure_ma, 20.0, believed_ma, 1e-3)
        found += [] if low_ma is None else [low_ma]

    if end_ma == 20.0:
        assert found == []
    else:
        assert found
        assert found[0] == pytest.approx(end_ma, abs=0.6)


@pytest.mark.parametrize("reports_pressure", [True, False])
def test_dead_time_converter_and_slew_together_are_controlled_as_well_as_each_alone(*, reports_pressure: bool) -> None:
    """1.2 s is enough for a move and its correction; a law that cannot brake harder than planned needs more of them."""
    lags = {"fill_time_constant_s": 0.05, "vent_time_constant_s": 0.05, "dead_time_s": DEAD_S}
    actuator = {**lags, "converter_time_constant_s": CONVERTER_S, "slew_pa_per_s": SLEW_PA_PER_S}
    plant = {"preset": "real-valve", "actuator": actuator, "sensor": {**QUIET, "reports_pressure": reports_pressure}}
    dwells = [
        dwell
        for seed in (7, 8)
        for dwell in play_directly(
            Scenario(
                name="delays",
                title="several delays",
                law="nmpc-predictive",
                seed=seed,
                setpoints_mm=(73.0, 87.0, 80.0, 73.0, 81.5, 83.0),
                dwell_s=1.2,
                plant=plant,
                valve=told(plant_settings(overrides=plant)),
                estimator=QUIET,
            )
        )
    ]

    found = totals(dwells)
    assert found.mean_abs_error_pct < 0.3
    assert found.limit_cycles == 0
