"""Setpoint functions in the closed loop, with the emulated valve, and in `positioner check`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from plant_emulator.presets import plant_settings
from positioner.bench import inprocess
from positioner.bench.configure import configuration_text
from positioner.bench.scenario import Scenario
from positioner.bus.address import BusAddress
from positioner.cli.check import summary_rows
from positioner.cli.main import main
from positioner.commissioning.experiment import Experiment
from positioner.commissioning.procedure import ProcedureLimits, commissioning_setup
from positioner.config.reader import parse_config
from positioner.errors import ExitCode

if TYPE_CHECKING:
    from positioner.config.schema import Configuration

SENSOR = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}


def wanted(setpoints_mm: tuple[float, ...], law: str = "nmpc") -> Scenario:
    return Scenario(
        name="setpoint",
        title="t",
        law=law,
        seed=3,
        setpoints_mm=setpoints_mm,
        dwell_s=1.0,
        plant={"preset": "paper", "valve": {"initial_position_m": 0.07}, "sensor": SENSOR},
        estimator=SENSOR,
    )


def configured(scenario: Scenario, functions: str) -> Configuration:
    text = configuration_text(scenario, BusAddress(), Path("unused"))
    return parse_config(f"{text}\n[setpoint]\n{functions}\n", "valve.toml", Path())


def played(scenario: Scenario, functions: str, monkeypatch: pytest.MonkeyPatch) -> inprocess.InProcessRun:
    monkeypatch.setattr(inprocess, "configure", lambda each: configured(each, functions))
    # a bench knows no setpoint functions, and refuses signals that the stem cannot reach as they are
    monkeypatch.setattr(inprocess, "check_playable", lambda each, _, **_options: plant_settings(overrides=each.plant))
    return inprocess.run_in_process(scenario)


@pytest.mark.interpreted
def test_a_table_that_turns_nothing_on_changes_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = wanted((75.0, 82.0))
    plain = inprocess.run_in_process(scenario)
    off = played(scenario, "rangeability = 25.0\nhysteresis = 0.01", monkeypatch)
    assert np.array_equal(plain.recording.current_ma, off.recording.current_ma)
    assert np.array_equal(plain.recording.true_position_m, off.recording.true_position_m)


@pytest.mark.interpreted
@pytest.mark.parametrize(("law", "error_mm"), [("nmpc", 0.3), ("pi", 2.5)])
def test_the_stem_goes_where_the_functions_send_it(law: str, error_mm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    # a signal of 127 mm - 52 mm = 75 mm by the reverse action, and travel limits of 60 and 80 mm
    functions = f'action = "reverse"\ntravel_low = {60.0 / 127.0}\ntravel_high = {80.0 / 127.0}'
    run = played(wanted((52.0, 40.0, 65.0), law), functions, monkeypatch)
    ends_mm = run.recording.true_position_m[[999, 1999, 2999]] * 1e3
    assert ends_mm == pytest.approx([75.0, 80.0, 62.0], abs=error_mm)
    pursued_m = [cycle.setpoint_m for cycle in run.cycles]
    assert pursued_m[-1] == pytest.approx(0.062)


@pytest.mark.interpreted
def test_tight_shut_off_gives_the_full_closing_current_until_the_setpoint_comes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = played(wanted((75.0, 60.0, 75.0)), "closed_below = 0.5", monkeypatch)
    current = run.recording.current_ma
    assert (current[1005:1999] == 4.0).all()
    assert run.recording.true_position_m[1999] * 1e3 == pytest.approx((4.0 * 333.637 + 1423.0) / 52.538, abs=0.5)
    assert run.recording.true_position_m[2999] * 1e3 == pytest.approx(75.0, abs=0.3)


@pytest.mark.interpreted
def test_a_log_replays_to_the_bit_with_its_functions_and_differs_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = wanted((75.0, 60.0, 82.0))
    functions = 'characteristic = "equal percentage"\nopening_per_s = 0.2\ntravel_low = 0.5\nclosed_below = 0.2'
    log, config = tmp_path / "bus.log", tmp_path / "valve.toml"
    played(scenario, functions, monkeypatch).recording.write_log(log)
    plain = configuration_text(scenario, BusAddress(), tmp_path / "state")
    config.write_text(f"{plain}\n[setpoint]\n{functions}\n", encoding="utf-8")
    assert main(["replay", str(log), "--config", str(config)]) == ExitCode.OK
    assert capsys.readouterr().out.splitlines()[-1] == "identical"
    config.write_text(plain, encoding="utf-8")
    assert main(["replay", str(log), "--config", str(config)]) == ExitCode.FAILURE


def test_a_test_procedure_knows_no_setpoint_functions() -> None:
    setup = configured(wanted((75.0,)), "closed_below = 0.1").make_setup()
    assert setup.setpoint is not None
    experiment = Experiment.of(setup.valve, ProcedureLimits.of(setup.valve, setup.guard), setup.period_s)
    assert commissioning_setup(setup, experiment).setpoint is None


def test_check_shows_the_functions_that_are_on() -> None:
    given = 'characteristic = "quick opening"\nclosing_per_s = 0.5'
    on = dict(summary_rows(configured(wanted((75.0,)), given), Path("state")))
    assert on["setpoint"] == "quick opening, closing at most 50 %/s"
    assert "setpoint" not in dict(summary_rows(configured(wanted((75.0,)), ""), Path("state")))
