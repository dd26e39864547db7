"""A setpoint out of the current's reach: held at the nearest reachable place, told once, never hunted."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from slow_cases import slow

from positioner.bench import inprocess
from positioner.bench.scenario import Scenario
from positioner.cycle.deviation import Deviates

SENSOR = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}


def run_of(
    setpoints_mm: tuple[float, ...],
    lag_s: float,
    law: str = "nmpc",
    spring_n_per_m: float = 52538.0,
    dwell_s: float = 4.0,
) -> inprocess.InProcessRun:
    lags: dict[str, Any] = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    spring = {"spring_rate_n_per_m": spring_n_per_m}
    return inprocess.run_in_process(
        Scenario(
            name="unreachable",
            title="t",
            law=law,
            seed=5,
            setpoints_mm=setpoints_mm,
            dwell_s=dwell_s,
            plant={"preset": "paper", "valve": spring, "actuator": lags, "sensor": SENSOR},
            valve={"actuator": lags},
            estimator=SENSOR,
        ),
        beyond_reach=True,  # a bench refuses such a setpoint; a host may send it
    )


@pytest.mark.parametrize("lag_s", [0.0, 0.05])
@pytest.mark.parametrize(("setpoint_mm", "end_mm"), [(110.0, 99.9), *slow((48.0, 52.5))])
def test_the_stem_rests_at_the_end_of_its_reach_and_moves_on_from_there(
    lag_s: float, setpoint_mm: float, end_mm: float
) -> None:
    run = run_of((80.0, setpoint_mm, 80.0), lag_s)
    away, back = run.recording.true_position_m[4000:8000], run.recording.true_position_m[8000:]
    assert away[-1] * 1e3 == pytest.approx(end_mm, abs=1.5)
    assert np.abs(np.diff(away[2000:])).sum() < 1e-4
    assert back[-1] * 1e3 == pytest.approx(80.0, abs=0.5)
    told = [event.why for event in run.events if isinstance(event, Deviates)]
    assert len(told) == 1
    assert "which is out of reach: " in told[0]


@pytest.mark.parametrize(
    ("law", "lag_s", "stiffer", "setpoint_mm"),
    [
        ("nmpc", 0.0, 1.25, 84.0),
        *slow(("nmpc", 0.0, 1.25, 92.0), ("nmpc", 0.05, 1.25, 92.0), ("pi", 0.0, 1.25, 84.0)),
    ],
)
def test_a_spring_stiffer_than_configured_ends_the_reach_sooner(
    law: str, lag_s: float, stiffer: float, setpoint_mm: float
) -> None:
    # at 1.25 it slides to (20 B - F_c)/K = 79.9 mm, and is freed up to (20 B - F_s)/K = 75.6 mm
    spring = stiffer * 52538.0
    freed_mm, slides_mm = ((20.0 * 333.637 - friction_n) / spring * 1e3 for friction_n in (1707.7, 1423.0))
    run = run_of((70.0, setpoint_mm), lag_s, law, spring, dwell_s=5.0)
    away_m = run.recording.true_position_m[5000:]
    assert freed_mm - 0.1 < away_m[-1] * 1e3 < slides_mm + 0.05
    assert np.abs(np.diff(away_m[3000:])).sum() < 1e-4
    told = [event.why for event in run.events if isinstance(event, Deviates)]
    assert 1 <= len(told) <= (1 if lag_s == 0.0 else 2)  # behind a lag also on its way from where pushes were in vain
    place = re.search(r"out of reach: 20 mA do not move it from ([\d.]+) mm, by a stiffer spring or more", told[-1])
    assert place is not None
    assert float(place.group(1)) == pytest.approx(away_m[-1] * 1e3, abs=0.3)


@pytest.mark.parametrize(("law", "lag_s"), [("nmpc", 0.0), *slow(("nmpc", 0.3), ("pi", 0.3))])
def test_a_long_move_on_a_valve_that_is_as_configured_is_no_deviation(law: str, lag_s: float) -> None:
    run = run_of((60.0, 92.0, 60.0), lag_s, law)
    assert not [event for event in run.events if isinstance(event, Deviates)]
