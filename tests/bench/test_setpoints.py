"""Setpoints and noise as a user names them: their values, their figures, and one line for each mistake."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from plant_emulator import sensor
from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.metrics import Trace, dwell_metrics
from positioner.bench.own_plant import with_plant
from positioner.bench.playable import restartable_mm
from positioner.bench.scenario import Scenario, check_scenario
from positioner.bench.sensor_noise import sensor_table, with_noise
from positioner.bench.setpoints import setpoints_in, with_setpoints
from positioner.cli.main import main
from positioner.errors import ConfigurationError, ExitCode, PositionerError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

PLANT = plant_settings("paper")
SCENARIO = Scenario(name="own", title="own setpoints", law="nmpc", setpoints_mm=(80.0,), dwell_s=0.2)


def test_a_list_is_in_mm_or_in_percent_of_the_span() -> None:
    assert setpoints_in("73, 87mm,50%", PLANT, 0.01).mm == (73.0, 87.0, 63.5)


def test_steps_go_from_one_end_to_the_other_and_back() -> None:
    assert setpoints_in("steps:5,from=70,to=82", PLANT, 0.01).mm == (70.0, 75.0, 80.0, 75.0, 70.0)
    assert setpoints_in("steps:10%,from=70%,to=50%", PLANT, 0.01).mm == (88.9, 76.2, 63.5, 76.2, 88.9)
    low_mm, high_mm = restartable_mm(PLANT)
    own = setpoints_in("steps:10%", PLANT, 0.01).mm
    assert low_mm < min(own) < low_mm + 3.0
    assert high_mm - 12.7 - 3.0 < max(own) < high_mm
    assert {round(abs(after - before), 6) for before, after in pairwise(own)} == {12.7}


def test_a_ramp_goes_there_and_back_and_a_sine_has_its_period() -> None:
    ramp = setpoints_in("ramp:2,from=70,to=80", PLANT, 0.01)
    assert (len(ramp.mm), ramp.each_s, ramp.edges_s) == (400, 0.01, (0.0, 2.0, 4.0))
    assert (ramp.mm[0], ramp.mm[100], ramp.mm[200], ramp.mm[300]) == (70.0, 75.0, 80.0, 75.0)
    sine = setpoints_in("sine:4s,middle=75,amplitude=2%,cycles=3", PLANT, 0.01)
    assert len(sine.mm) == 1200
    assert sine.edges_s == (0.0, 4.0, 8.0, 12.0)
    assert (sine.mm[0], sine.mm[100], sine.mm[500], sine.mm[300]) == (75.0, 77.54, 77.54, 72.46)


def test_rows_of_a_file_hold_until_the_next_one_and_are_dwells(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("time_s;setpoint_pct\n10,0;50\n10,5;60\n\n11;60\n11,5;40\n", encoding="utf-8")  # a decimal comma
    found = setpoints_in(str(path), PLANT, 0.01)
    assert len(found.mm) == 200
    assert (found.mm[49], found.mm[50], found.mm[149], found.mm[150], found.mm[199]) == (63.5, 76.2, 76.2, 50.8, 50.8)
    assert found.edges_s == (0.0, 0.5, 1.5, 2.0)
    path.write_text("time_s,setpoint_m\n0,0.07\n0.02,0.071\n0.04,0.072\n", encoding="utf-8")
    assert setpoints_in(str(path), PLANT, 0.01).edges_s == (0.0, 0.06)  # it moves: one figure for all of it


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("sprout:3", "'sprout' is unknown"),
        ("80,x", "setpoint 'x' is no number; 80 is in mm, 60% of span"),
        ("80,nan", "setpoint 'nan' is no number"),
        ("steps:", "begins with the size of a step; write it like steps:5%"),
        ("steps:from=3", "begins with the size of a step"),
        ("steps:0", "a step must be larger than 0"),
        ("steps:90%", "does not fit"),
        ("steps:5,from=70,to=70", "from and to are the same place"),
        ("ramp:-3", "a time of -3 is not above 0 s"),
        ("ramp:0.001", "is too short: a setpoint comes every 0.01 s"),
        ("ramp:1e6", "makes 100000000 setpoints"),
        ("ramp:3,form=20%", "'form' is unknown; did you mean 'from'?"),
        ("ramp:3,from=1,from=2", "from stands twice"),
        ("ramp:3,from", "'from' is no KEY=VALUE"),
        ("sine:3", "needs amplitude=…"),
        ("sine:3,amplitude=1,cycles=1.5", "cycles must be a whole number"),
        ("absent.csv", "absent.csv: file: cannot be read: No such file or directory"),
    ],
)
def test_each_mistake_is_one_line(given: str, expected: str) -> None:
    with pytest.raises(PositionerError) as caught:
        setpoints_in(given, PLANT, 0.01)
    (line,) = str(caught.value).splitlines()
    assert expected in line


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "file: is empty; write the header"),
        ("time_s,setpoint_mm\n", "holds fewer than two rows"),
        ("1,2\n2,3\n", "line 1: header: has no column time_s; write the header time_s,setpoint_mm"),
        ("time_s,setpoint\n1,2\n2,3\n", "line 1: header: has no column with setpoints and their unit"),
        ("time_s,setpoint_mm\n1,2\n1,3\n", "line 3: time_s = 1: must be later than 1 of the row before; sort the rows"),
        ("time_s,setpoint_mm\n1,2\n2,x\n3,4\n5,6\n", "line 3: setpoint_mm = x: is no number"),
        ("time_s,setpoint_mm\n1,2\n", "holds fewer than two rows"),
        ("time_s,setpoint_mm\n0,70\n0.001,70\n", "lasts 0.002 s; a setpoint comes every 0.01 s"),
    ],
)
def test_each_mistake_in_a_file_is_one_line_with_its_place(text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(PositionerError) as caught:
        setpoints_in(str(path), PLANT, 0.01)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(str(path))
    assert expected in line


def test_setpoints_beyond_the_reach_of_the_plant_are_two_lines_however_many_they_are() -> None:
    scenario = with_setpoints(SCENARIO, "ramp:1,from=0%,to=100%")
    with pytest.raises(ConfigurationError, match="restart paper both ways") as caught:
        run_in_process(scenario)
    assert len(str(caught.value).splitlines()) == 2


def test_the_error_of_a_moving_setpoint_is_the_distance_from_it() -> None:
    time_s = np.linspace(0.0, 0.999, 1000, dtype=np.float64)
    setpoint_m = 0.07 + 0.01 * time_s
    late_m = setpoint_m - 0.00127  # one percent of the span
    (found,) = dwell_metrics(
        Trace(time_s=time_s, position_m=late_m, setpoint_m=setpoint_m, current_ma=time_s), (0.0, 1.0), 0.127
    )
    assert found.mean_abs_error_pct == pytest.approx(1.0)
    assert found.max_abs_error_pct == pytest.approx(1.0)
    assert found.ideal_travel_mm == pytest.approx(10.0 + 1.27, abs=0.02)
    assert found.iae_mm_s == pytest.approx(1.27)
    assert (found.limit_cycle, found.reversals) == (False, 0)


def test_a_bench_plays_a_sine_and_our_law_follows_it_within_the_size_of_its_jumps() -> None:
    scenario = with_setpoints(with_noise(SCENARIO, "gaussian:0.05%"), "sine:2,middle=80,amplitude=5")
    check_scenario(scenario, "own")
    run = run_in_process(scenario)
    (found,) = dwell_metrics(run.recording.trace, scenario.dwell_edges_s, 0.127)
    assert np.ptp(run.recording.setpoint_m) == pytest.approx(0.01, rel=1e-3)
    assert 0.2 < found.mean_abs_error_pct < 4.0
    assert found.ideal_travel_mm == pytest.approx(20.0, abs=2.0 * 70.1)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("gaussian:0.05%", {"noise_of_span": 0.0005, "noise_shape": "gaussian"}),
        ("uniform:2,of=reading", {"noise_of_reading": 0.02, "noise_of_span": 0.0, "noise_shape": "uniform"}),
        ("correlated:1%,time=0.1s", {"noise_of_span": 0.01, "noise_correlation_s": 0.1}),
        ("held:1%,time=0.01", {"noise_of_span": 0.01, "noise_hold_s": 0.01, "noise_correlation_s": 0.0}),
    ],
)
def test_noise_becomes_the_table_of_the_sensor_and_its_size_is_told(given: str, expected: dict[str, object]) -> None:
    table = sensor_table(given)
    assert expected.items() <= table.items()
    scenario = with_noise(SCENARIO, given)
    assert plant_settings(overrides=scenario.plant).sensor.noise_hold_s == table["noise_hold_s"]
    assert configure(scenario).estimator.noise_of_span == table["noise_of_span"]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("2%", "'2%' is unknown; known: gaussian, uniform, correlated, held; write it like"),
        ("gauss:2%", "did you mean 'gaussian'?"),
        ("gaussian:", "'' is no number of 0 or more"),
        ("gaussian:-1%", "'-1' is no number of 0 or more"),
        ("gaussian:1%,time=3", "'time' is unknown"),
        ("gaussian:1%,of=step", "of=step: it is of the span or of the reading"),
        ("held:1%", "needs time=…, in s"),
        ("held:1%,time=0", "time must be above 0 s"),
    ],
)
def test_each_mistake_in_a_noise_is_one_line(given: str, expected: str) -> None:
    with pytest.raises(PositionerError) as caught:
        sensor_table(given)
    (line,) = str(caught.value).splitlines()
    assert expected in line


def _values(given: str, count: int = 20_000) -> NDArray[np.float64]:
    settings = plant_settings(overrides={"sensor": sensor_table(given)})
    state, values = sensor.Sensor(seed=3), []
    for number in range(count):
        state, value_m = sensor.measure(settings, state, 0.08, number * 0.001)
        values.append((value_m - 0.08) / (settings.valve.span_m * 0.01))
    return np.array(values)


def test_each_kind_of_noise_has_its_standard_deviation_and_its_shape() -> None:
    white, even = _values("gaussian:1%"), _values("uniform:1%")
    assert white.std() == pytest.approx(1.0, rel=0.02)
    assert even.std() == pytest.approx(1.0, rel=0.02)
    assert np.abs(white).max() > 3.0
    assert 1.7 < np.abs(even).max() < math.sqrt(3.0)
    for values in (white, even):
        assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 0.03


def test_correlated_noise_follows_from_the_value_before_and_held_noise_stays() -> None:
    values = _values("correlated:1%,time=0.01", 100_000)
    assert values.std() == pytest.approx(1.0, rel=0.05)
    for lag in (1, 10):
        # an AR(1) process at this period: its autocorrelation is exp(-lag T / τ)
        assert np.corrcoef(values[lag:], values[:-lag])[0, 1] == pytest.approx(math.exp(-lag / 10.0), abs=0.03)
    held = _values("held:1%,time=0.01", 1000)
    assert len(np.unique(held)) == 100


def test_a_plant_file_is_a_plant_of_bench_and_league_and_its_valve_is_told(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(
        'preset = "paper"\n[valve]\nspan_m = 0.06\ntravel_max_m = 0.065\nspring_rate_n_per_m = 110000.0\n'
        "initial_position_m = 0.03\n[sensor]\nnoise_of_reading = 0.0\nnoise_of_span = 0.0005\n",
        encoding="utf-8",
    )
    scenario = with_setpoints(with_plant(SCENARIO, str(path)), "60%")
    told = configure(scenario)
    assert (told.valve.span_m, told.valve.spring_rate_n_per_m) == (0.06, 110000.0)
    assert (told.estimator.noise_of_span, told.estimator.noise_of_reading) == (0.0005, 0.0)
    with_process = path.read_text(encoding="utf-8") + "[process]\nforce_n = 50.0\ngradient_n_per_m = 2000.0\n"
    (tmp_path / "process.toml").write_text(with_process, encoding="utf-8")
    told = configure(with_plant(with_setpoints(SCENARIO, "50"), str(tmp_path / "process.toml")))
    assert (told.valve.spring_rate_n_per_m, told.valve.bench_set_n) == (112000.0, 50.0)
    out = tmp_path / "out"
    words = [
        "league",
        "--laws",
        "nmpc",
        "--plants",
        f"paper,{path}",
        "--seeds",
        "1",
        "--dwell",
        "0.3",
        "--workers",
        "1",
    ]
    assert main([*words, "--setpoints", "60%,62%", "--noise", "uniform:0.05%", "--out", str(out)]) == ExitCode.OK
    rows = json.loads((out / "league.json").read_text(encoding="utf-8"))["standings"]
    assert [row["plant"] for row in rows] == ["paper", str(path)]
    assert all(row["mean_error_pct"] < 1.0 for row in rows)
    bouts = {each.name for each in (out / "bouts").iterdir()}
    path.write_text(path.read_text(encoding="utf-8").replace("110000.0", "100000.0"), encoding="utf-8")
    assert main([*words, "--setpoints", "60%,62%", "--noise", "uniform:0.05%", "--out", str(out)]) == ExitCode.OK
    assert len({each.name for each in (out / "bouts").iterdir()} - bouts) == 1  # that of the plant that has changed


def test_a_plant_from_a_python_file_is_tables_or_a_function_that_returns_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "plants.py"
    path.write_text(
        'STIFF = {"preset": "paper", "valve": {"spring_rate_n_per_m": 60000.0}}\n'
        "def stiff():\n    return STIFF\nWRONG = 3\nBAD = {'valve': {'mass': 1}}\n"
        "def raising():\n    return 1 / 0\n",
        encoding="utf-8",
    )
    for name in ("STIFF", "stiff"):
        assert configure(with_plant(SCENARIO, f"{path}:{name}")).valve.spring_rate_n_per_m == 60000.0
    for name, expected in (
        ("WRONG", "is a int; a plant is the tables of a plant file"),
        ("BAD", "valve.mass: unknown key"),
        ("raising", "cannot be made: ZeroDivisionError"),
    ):
        with pytest.raises(ConfigurationError, match=expected):
            with_plant(SCENARIO, f"{path}:{name}")
    assert main(["bench", "--plant", f"{path}:STIF", "--out", str(tmp_path / "out")]) == ExitCode.USAGE
    assert "has no STIF; did you mean 'STIFF'?" in capsys.readouterr().err
