"""The actuator's parameters: what they refuse, and where they stand in a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from positioner.config.reader import load_valves, parse_config
from positioner.errors import ConfigurationError
from positioner.valve.actuator import ActuatorParameters

VALVE = '[valve]\nid = "v"\npreset = "paper"\n'
WHY = "a line that fills slowly also vents slowly"
ONE_OF_TWO = """[[valve]]
id = "A"
preset = "paper"
[valve.actuator]
fill_time_constant_s = 0.05
vent_time_constant_s = 0.08
[valve.control]
sample_period_s = 0.01
[[valve]]
id = "B"
preset = "paper"
wire.id_offset = 128
"""


def test_without_a_lag_the_pressure_is_the_current_at_once() -> None:
    assert ActuatorParameters().is_immediate
    assert ActuatorParameters().in_words() == "acts at once"


@pytest.mark.parametrize("key", ["dead_time_s", "slew_ma_per_s", "converter_time_constant_s"])
def test_each_lag_alone_makes_the_pressure_late(key: str) -> None:
    assert not ActuatorParameters(**{key: 0.02}).is_immediate


def test_the_lags_in_words() -> None:
    found = ActuatorParameters(fill_time_constant_s=0.05, vent_time_constant_s=0.08, slew_ma_per_s=40.0)
    assert found.in_words() == "fill 50 ms, vent 80 ms, slew limit 40 mA/s"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "[valve.actuator]\nfill_time_constant_s = 0.05",
            f"line 4: valve.actuator: fill_time_constant_s needs vent_time_constant_s, too: {WHY}",
        ),
        (
            "[valve.actuator]\nvent_time_constant_s = 0.05",
            f"line 4: valve.actuator: vent_time_constant_s needs fill_time_constant_s, too: {WHY}",
        ),
        (
            "backlash_m = 0.1\nspan_m = 0.09",
            "line 1: valve: backlash_m must be smaller than span_m: with more the reading says nothing",
        ),
        (
            "sensor_time_constant_s = -0.1",
            "line 4: valve.sensor_time_constant_s = -0.1: must be greater than or equal to 0 s",
        ),
        (
            "[valve.actuator]\nslew_ma_per_s = inf",
            "line 5: valve.actuator.slew_ma_per_s = inf: must be a finite number",
        ),
    ],
)
def test_what_contradicts_itself_is_refused_with_its_line(line: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse_config(f"{VALVE}{line}\n", "valve.toml", Path())
    assert [str(problem) for problem in caught.value.problems] == [message]


def test_one_of_several_valves_has_an_actuator_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(ONE_OF_TWO, encoding="utf-8")
    first, second = load_valves(path)
    assert first.valve.actuator == ActuatorParameters(fill_time_constant_s=0.05, vent_time_constant_s=0.08)
    assert first.control.sample_period_s == 0.01
    assert second.valve.actuator.is_immediate


def test_a_mistake_in_the_actuator_of_one_of_several_has_its_line(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(ONE_OF_TWO.replace("0.08", "-0.08"), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"line 6: valve A: actuator.vent_time_constant_s = -0.08: must be"):
        load_valves(path)


@pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.3])
def test_the_lags_of_an_actuator_change_in_proportion(lag_s: float) -> None:
    lags = {"fill_time_constant_s": 0.06, "vent_time_constant_s": 0.03, "converter_time_constant_s": 0.04}
    actuator = ActuatorParameters(**lags, dead_time_s=0.01).with_lag(lag_s)

    assert actuator.lag_s(fills=True) == pytest.approx(lag_s)
    assert actuator.lag_s(fills=False) == pytest.approx(0.7 * lag_s)
    assert actuator.dead_time_s == 0.01
    assert ActuatorParameters().with_lag(lag_s).lag_s(fills=False) == lag_s
