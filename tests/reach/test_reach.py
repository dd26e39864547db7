"""What a valve can reach: against closed forms, independent studies, and a closed loop with the emulated valve."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import Scenario
from positioner.cli.main import main
from positioner.config.reader import parse_config
from positioner.errors import ExitCode
from positioner.reach.case import Case
from positioner.reach.expected import corrections
from positioner.reach.figures import figures_of
from positioner.reach.improvements import improvements
from positioner.reach.moves import durations, smallest_push_m

if TYPE_CHECKING:
    from positioner.reach.figures import Figures

LOW_NOISE, TWO_PERCENT = (0.0, 0.0005), (0.02, 0.0)


def text_of(lag_s: float, noise: tuple[float, float] = LOW_NOISE, period_s: float = 1e-3, valve: str = "paper") -> str:
    lags = f"[valve.actuator]\nfill_time_constant_s = {lag_s}\nvent_time_constant_s = {lag_s}\n"
    sensor = f"[estimator]\nnoise_of_reading = {noise[0]}\nnoise_of_span = {noise[1]}\n"
    return f'[valve]\nid = "v"\npreset = "{valve}"\n{lags}{sensor}[control]\nsample_period_s = {period_s}\n'


def case_of(lag_s: float, noise: tuple[float, float] = LOW_NOISE, period_s: float = 1e-3, **valve: Any) -> Case:
    return Case.of(parse_config(text_of(lag_s, noise, period_s), "valve.toml", Path())).with_valve(**valve)


def test_the_range_and_the_natural_jump_are_the_closed_forms() -> None:
    found = figures_of(case_of(0.05))
    gain, rate = 0.06452 * 0.75 * 6894.757, 52538.0
    assert found.low_m == pytest.approx((4.0 * gain + 1707.7) / rate)
    assert found.high_m == pytest.approx((20.0 * gain - 1707.7) / rate)
    assert found.low_reach_m == pytest.approx((4.0 * gain + 1423.0) / rate)
    assert found.high_reach_m == pytest.approx((20.0 * gain - 1423.0) / rate)
    assert found.natural_jump_m == pytest.approx(284.7 / rate)
    assert found.averaged_m == pytest.approx(6.35e-5 * math.sqrt(1e-3))


def test_a_push_of_one_period_without_lag_is_the_free_slip_of_the_plant_and_its_brake() -> None:
    # a T²/2 under F_s - F_c, then braked by F_c; a period as long as the slip: the natural jump
    slip_m, brakes = 0.5 * 284.7 / 1.361 * 1e-6, 284.7 / 1423.0
    assert smallest_push_m(case_of(0.0), 1.0) == pytest.approx(slip_m * (1.0 + brakes), rel=0.25)
    assert smallest_push_m(case_of(0.0), -1.0) == pytest.approx(smallest_push_m(case_of(0.0), 1.0), rel=1e-6)
    assert smallest_push_m(case_of(0.0, period_s=0.1), 1.0) == pytest.approx(284.7 / 52538.0, rel=0.01)


def test_a_push_is_the_longer_the_later_its_brake() -> None:
    pushes_m = [smallest_push_m(case_of(lag_s), 1.0) for lag_s in (0.002, 0.02, 0.1, 0.3)]
    assert pushes_m == sorted(pushes_m)
    assert pushes_m[-1] < 284.7 / 52538.0


def test_the_part_that_is_corrected_is_that_of_a_normal_distribution() -> None:
    found = corrections(case_of(0.02, TWO_PERCENT))
    inside = math.erf(1.27e-3 / (found.first_m * math.sqrt(2.0)))
    assert found.share == pytest.approx(1.0 - inside, rel=1e-9)
    assert 0.05 < found.share < 0.2  # closed loops: 0 to 0.3
    assert corrections(case_of(0.02, LOW_NOISE)).share < 1e-6


@pytest.mark.parametrize(
    ("lag_s", "expected_ms"),
    [(0.0, 10.0), (0.005, 19.0), (0.01, 27.0), (0.02, 43.0), (0.05, 85.0), (0.1, 156.0), (0.3, 442.0)],
)
def test_the_shortest_move_is_that_of_a_study_with_another_model(lag_s: float, expected_ms: float) -> None:
    # the study: 73 to 87 mm until the stem stops; here until it is within 1 % of span, which is 1.3 mm sooner
    found = durations(replace(case_of(lag_s), low_ma=4.0), 0.014)
    assert 0.7 * expected_ms < found.shortest_s * 1e3 < 1.02 * expected_ms
    assert found.shortest_s <= found.law_s < found.shortest_s + 0.002


def test_a_move_beyond_the_current_never_ends() -> None:
    found = durations(case_of(0.05), 0.06)
    assert found.shortest_s == math.inf
    assert figures_of(case_of(0.05, static_friction_n=3000.0)).low_m > 0.07


@pytest.mark.parametrize("lag_s", [0.02, 0.1])
def test_the_mean_error_and_the_duration_are_those_of_a_closed_loop(lag_s: float) -> None:
    setpoints_mm, dwell_s = (70.0, 82.7) * 7, 1.2
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    sensor = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
    run = run_in_process(
        Scenario(
            name="reach",
            title="t",
            law="nmpc",
            seed=7,
            setpoints_mm=setpoints_mm,
            dwell_s=dwell_s,
            plant={"preset": "paper", "actuator": lags, "sensor": sensor},
            valve={"actuator": lags},
            estimator=sensor,
        )
    )
    error_m = np.abs(run.recording.true_position_m - np.repeat(np.array(setpoints_mm) * 1e-3, round(dwell_s / 1e-3)))
    dwells = error_m.reshape(len(setpoints_mm), -1)
    found = figures_of(case_of(lag_s))
    assert 0.3 * found.error_m < dwells[:, -300:].mean() < 2.5 * found.error_m
    # every second dwell is an opening by a tenth of the span; the first ones measure the valve
    settled_s = [(np.flatnonzero(dwell > 0.00127)[-1] + 1) * 1e-3 for dwell in dwells[5::2]]
    assert 0.8 * found.law_s < np.median(settled_s) < 1.6 * found.law_s


def test_what_helps_is_named_with_its_figures_and_what_does_not_help_is_not() -> None:
    case = case_of(0.05, TWO_PERCENT, period_s=0.005)
    today = figures_of(case)
    found = improvements(case, today)
    changes = {each.change: each.figures for each in found}
    assert {"a position sensor with half the noise", "a volume booster that halves the lag"} <= set(changes)
    faster: Figures = changes["a volume booster that halves the lag"]
    assert faster.law_s < 0.7 * today.law_s
    assert [each.figures.first_m for each in found] == sorted(each.figures.first_m for each in found)
    assert not [change for change in changes if "dead time" in change or "converter" in change]


def test_the_command_prints_text_and_the_same_figures_as_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(text_of(0.05), encoding="utf-8")
    assert main(["reach", "--config", str(path)]) == ExitCode.OK
    text = capsys.readouterr().out
    assert re.search(r"^natural jump \(F_s - F_c\)/K +5\.4 mm \(4\.3 %\)$", text, re.MULTILINE)
    assert re.search(r"^4 to 20 mA slide it to +52\.5 to 99\.9 mm$", text, re.MULTILINE)
    assert max(len(line) for line in text.splitlines()) <= 130
    assert main(["reach", "--config", str(path), "--json"]) == ExitCode.OK
    table = json.loads(capsys.readouterr().out)
    assert table["natural_jump_m"] == pytest.approx(284.7 / 52538.0)
    assert table["law_s"] == pytest.approx(figures_of(case_of(0.05)).law_s)
    assert all(each["change"] for each in table["improvements"])


def test_a_valve_that_nothing_can_free_has_no_range_and_no_durations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "valve.toml"
    text = text_of(0.05).replace('"paper"\n', '"paper"\nstatic_friction_n = 6000.0\n')
    path.write_text(text, encoding="utf-8")
    assert main(["reach", "--config", str(path)]) == ExitCode.OK
    out = capsys.readouterr().out
    assert re.search(r"^and free it both ways +nowhere$", out, re.MULTILINE)
    assert "never: the current is too weak" in out


@pytest.mark.parametrize("valve", ["graphite", "real-valve"])
def test_every_preset_has_figures(valve: str) -> None:
    found = figures_of(Case.of(parse_config(text_of(0.1, valve=valve), "valve.toml", Path())))
    assert 0.0 < found.push_m < found.natural_jump_m
    assert 0.0 < found.first_m < found.natural_jump_m
    assert 0.05 < found.shortest_s <= found.law_s < 0.5
