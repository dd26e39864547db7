"""A setpoint out of the current's reach: held at the nearest reachable place, told once, never hunted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from plant_emulator.presets import plant_settings
from positioner.bench import inprocess
from positioner.bench.scenario import Scenario
from positioner.cycle.deviation import Deviates

SENSOR = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}


@pytest.mark.parametrize("lag_s", [0.0, 0.05])
@pytest.mark.parametrize(("setpoint_mm", "end_mm"), [(110.0, 99.9), (48.0, 52.5)])
def test_the_stem_rests_at_the_end_of_its_reach_and_moves_on_from_there(
    lag_s: float, setpoint_mm: float, end_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a bench refuses such a setpoint; a host may send it
    monkeypatch.setattr(inprocess, "check_playable", lambda scenario, _: plant_settings(overrides=scenario.plant))
    lags: dict[str, Any] = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    run = inprocess.run_in_process(
        Scenario(
            name="unreachable",
            title="t",
            law="nmpc",
            seed=5,
            setpoints_mm=(80.0, setpoint_mm, 80.0),
            dwell_s=4.0,
            plant={"preset": "paper", "actuator": lags, "sensor": SENSOR},
            valve={"actuator": lags},
            estimator=SENSOR,
        )
    )
    away, back = run.recording.true_position_m[4000:8000], run.recording.true_position_m[8000:]
    assert away[-1] * 1e3 == pytest.approx(end_mm, abs=1.5)
    assert np.abs(np.diff(away[2000:])).sum() < 1e-4
    assert back[-1] * 1e3 == pytest.approx(80.0, abs=0.5)
    told = [event.why for event in run.events if isinstance(event, Deviates)]
    assert len(told) == 1
    assert "which is out of reach: " in told[0]
