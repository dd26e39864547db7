"""The file of a campaign: every mistake at once, with its line, and what a correct one becomes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from small import TEXT

from positioner.bench.inprocess import configure
from positioner.bench.scenario import load_scenario
from positioner.campaign.check import check_points
from positioner.campaign.keys import known_keys, settings_of, value_at
from positioner.campaign.reader import load_campaign
from positioner.cli.main import main
from positioner.errors import ConfigurationError, ExitCode

MASS, SWITCH, STEPS = "plant.valve.mass_kg", "plant.sensor.reports_pressure", "control.planner.prediction_steps"
KEYS = "`positioner campaign --keys` lists them all"
ROOT = Path(__file__).resolve().parents[2]


def written(folder: Path, text: str) -> Path:
    path = folder / "campaign.toml"
    path.write_text(text, encoding="utf-8")
    return path


def problems(folder: Path, text: str) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        load_campaign(written(folder, text))
    return [str(problem) for problem in caught.value.problems]


def with_parameters(lines: str, kind: str = '"sobol"\npoints = 4') -> str:
    before, _, _ = TEXT.partition("[parameters]")
    return before.replace('"sobol"\npoints = 4', kind) + "[parameters]\n" + lines


def test_the_example_is_a_campaign_whose_points_can_all_be_played() -> None:
    campaign = load_campaign(ROOT / "examples" / "campaign.toml")
    points = campaign.points()
    check_points(campaign, points)
    assert len(points) == 32
    assert len(list(campaign.runs())) == 32 * 2 * 2


def test_every_mistake_is_reported_at_once_with_its_line(tmp_path: Path) -> None:
    text = """\
name = "wrong"
title = "Everything wrong"
laws = ["nmpc", "papper"]
seeds = [1, -1]
[design]
kind = "sobol"
points = 12
[scenario]
base = "paper-vlave"
law = "pi"
[parameters]
"plant.valve.mas_kg" = { low = 1.0, high = 2.0 }
"plant.valve.mass_kg" = { low = 2.0, high = 1.0 }
"plant.sensor.noise_of_reading" = { lo = 0.0, high = 0.1 }
"""
    found = problems(tmp_path, text)
    expected = [
        "line 3: laws = 'papper': is no law; did you mean 'paper'?",
        "line 4: seeds = -1: must be greater than or equal to 0",
        "line 9: scenario.base = 'paper-vlave': scenario 'paper-vlave' is unknown; did you mean 'paper-valve'?",
        "line 10: scenario.law: stands in `laws`, above the tables",
        "line 13: parameters.plant.valve.mass_kg: low must be below high",
        "line 14: parameters.plant.sensor.noise_of_reading.lo: unknown key; did you mean 'low'?",
    ]
    assert len(found) == len(expected)
    for line, begin in zip(found, expected, strict=True):
        assert line.startswith(begin)


def test_what_does_not_fit_together_is_reported_at_once_with_its_line(tmp_path: Path) -> None:
    lines = """\
"plant.valve.mas_kg" = { low = 1.0, high = 2.0 }
"plant.sensor.reports_pressure" = { low = 0.0, high = 1.0 }
"control.planner.prediction_steps" = { low = 2.5, high = 8.0 }
"plant.preset" = { values = ["paper", 1] }
"plant.valve.mass_kg" = { low = 1.0, high = 2.0, levels = 3 }
weight = { low = 0.5, high = 2.0, scales = ["plant.valve.mass_kg", "plant.fail_position"] }
seed = { low = 0.5, high = 2.0, scales = ["plant.valve.span_m"] }
"""
    text = with_parameters(lines, '"sobol"\npoints = 12')
    first = text.splitlines().index('"plant.valve.mas_kg" = { low = 1.0, high = 2.0 }') + 1
    assert problems(tmp_path, text) == [
        "line 9: design.points = 12: a Sobol sequence is even at powers of two only: 8 or 16?",
        f"line {first}: parameters.plant.valve.mas_kg: 'plant.valve.mas_kg' is no key; did you mean '{MASS}'?; {KEYS}",
        f"line {first + 1}: parameters.{SWITCH}: {SWITCH} is no number: give values",
        f"line {first + 2}: parameters.{STEPS}: {STEPS} is a whole number, so low and high must be, too",
        f"line {first + 3}: parameters.plant.preset: the values of plant.preset must be texts",
        f"line {first + 4}: parameters.{MASS}: levels are for a grid only; design.points is their number",
        f"line {first + 5}: parameters.weight: {MASS} is changed by {MASS!r}, too",
        f"line {first + 5}: parameters.weight: plant.fail_position is no number that can be multiplied",
        f"line {first + 6}: parameters.seed: is the name of a column of the results: give it another one",
    ]


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("{ low = 1.0 }", "needs low and high, or values"),
        ("{ values = [1.0, 2.0], low = 1.0 }", "has values, so low, high and levels have no meaning"),
        ("{ values = [1.0, 1.0] }", "has a value twice"),
        ('{ low = 0.0, high = 1.0, scale = "logarithmic" }', "low must be above 0 on a logarithmic scale"),
        ("{ values = [1.0, true] }", "the values of plant.valve.mass_kg must be numbers"),
        ("{ low = 1.0, high = 1361.0 }", "1361.0: must be less than or equal to 200 kg"),
        ("{ values = [0.001, 1.0] }", "0.001: must be greater than or equal to 0.01 kg"),
    ],
)
def test_a_wrong_entry_is_one_line(entry: str, expected: str, tmp_path: Path) -> None:
    text = with_parameters(f'"plant.valve.mass_kg" = {entry}\n')
    (found,) = problems(tmp_path, text)
    assert found == f"line {len(text.splitlines())}: parameters.plant.valve.mass_kg: {expected}"


@pytest.mark.parametrize(
    ("design", "expected"),
    [
        ('"grid"', "parameters.plant.valve.mass_kg: needs levels: how many values of the range the grid takes"),
        ('"grid"\npoints = 4', "design.points = 4: a grid has the points that its levels make: leave it out"),
        ('"latin-hypercube"', "design: needs points: how many there are"),
        ('"sobol"\npoints = 1048576', "makes 2097152 runs with the laws and the seeds; a campaign has at most 100000"),
        ('"hypercube"', "must be 'grid', 'latin-hypercube' or 'sobol'"),
    ],
)
def test_a_wrong_design_is_one_line(design: str, expected: str, tmp_path: Path) -> None:
    text = with_parameters('"plant.valve.mass_kg" = { low = 1.0, high = 2.0 }\n', design)
    assert any(expected in line for line in problems(tmp_path, text))


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("dwel_s = 1.0", "scenario.dwel_s: unknown key; did you mean 'dwell_s'?"),
        ("dwell_s = 0.0251", "scenario.dwell_s = 0.0251: must be a whole multiple of setpoint_period_s = 0.01"),
        ('plant = { preset = "mars" }', "scenario.plant.preset = 'mars': is no preset"),
        ("plant = { sensor = { noise = 1.0 } }", "scenario.plant.sensor.noise: unknown key"),
        ("guard = { current_low_ma = 1.0 }", "scenario.guard.current_low_ma = 1.0: must be greater than or equal"),
        ("base = 1", "scenario.base = 1: "),
        ('base = "nowhere/x.toml"', "scenario.base = 'nowhere/x.toml': "),
    ],
)
def test_a_wrong_scenario_is_one_line(line: str, expected: str, tmp_path: Path) -> None:
    text = TEXT.replace("dwell_s = 0.02\n", f"{line}\n")
    (found,) = problems(tmp_path, text)
    assert found.startswith(f"line 14: {expected}")


def test_a_point_that_cannot_be_played_is_named_with_its_values(tmp_path: Path) -> None:
    text = with_parameters('"plant.valve.spring_rate_n_per_m" = { low = 30e3, high = 80e3, levels = 30 }\n', '"grid"')
    campaign = load_campaign(written(tmp_path, text))
    with pytest.raises(ConfigurationError) as caught:
        check_points(campaign, campaign.points())
    *named, last = map(str, caught.value.problems)
    assert len(named) == 10
    assert named[0].startswith("point 0 (plant.valve.spring_rate_n_per_m = 30000): setpoint 75 mm: 4 to 20 mA restart")
    assert last == "design: 16 points in all cannot be played: narrow the ranges or the setpoints"


def test_the_base_may_be_a_file_beside_the_campaign(tmp_path: Path) -> None:
    scenario = 'name = "own"\ntitle = "t"\nsetpoints_mm = [77.0]\ndwell_s = 0.5\n[plant]\npreset = "friction+10"\n'
    (tmp_path / "own.toml").write_text(scenario, encoding="utf-8")
    text = TEXT.replace("setpoints_mm = [75.0]", 'base = "own.toml"')
    base = load_campaign(written(tmp_path, text)).base
    assert (base.setpoints_mm, base.dwell_s, base.plant) == ((77.0,), 0.02, {"preset": "friction+10"})


def test_a_factor_multiplies_the_values_of_the_plant_of_the_scenario(tmp_path: Path) -> None:
    keys = ("plant.valve.static_friction_n", "plant.valve.coulomb_friction_n")
    lines = f'friction = {{ values = [2, 0.5], scales = ["{keys[0]}", "{keys[1]}"] }}\n'
    text = with_parameters(lines, '"grid"').replace("[scenario]", '[scenario]\nplant.preset = "friction+20"')
    runs = list(load_campaign(written(tmp_path, text)).runs())
    assert [run.values for run in runs[::2]] == [(2.0,), (0.5,)]
    for run, factor in zip(runs[::2], (2.0, 0.5), strict=True):
        settings = settings_of(run.scenario)
        assert value_at(settings, keys[0]) == pytest.approx(1.2 * 1707.7 * factor)
        assert value_at(settings, keys[1]) == pytest.approx(1.2 * 1423.0 * factor)


def test_one_parameter_of_a_law_leaves_the_others_as_they_are(tmp_path: Path) -> None:
    text = with_parameters('"control.pi.filter_time_constant_s" = { values = [0.001, 0.01] }\n', '"grid"')
    run, *_ = load_campaign(written(tmp_path, text)).runs()
    changed, packaged = configure(run.scenario).control.pi, configure(load_scenario("paper-valve")).control.pi
    assert changed.filter_time_constant_s == 0.001
    assert changed.proportional_gain_ma_per_m == packaged.proportional_gain_ma_per_m
    assert packaged.filter_time_constant_s != 0.001


@pytest.mark.parametrize("key", [MASS, "control.planner.terminal_factor", "estimator.method", "sample_period_s"])
def test_every_known_key_is_one_of_the_settings_and_has_a_kind(key: str) -> None:
    settings, known = settings_of(load_scenario("paper-valve")), known_keys()
    assert key in known
    for each, kind in known.items():
        value = value_at(settings, each)
        assert value is None or isinstance(value, kind) or (kind is float and isinstance(value, int))
    assert not {"law", "seed", "setpoints_mm", "valve.id", "control.law"} & set(known)


def test_the_command_lists_the_keys_and_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["campaign", "--keys"]) == ExitCode.OK
    assert "plant.actuator.dead_time_s" in capsys.readouterr().out
    assert main(["campaign"]) == ExitCode.USAGE
    assert "the file of a campaign is missing" in capsys.readouterr().err
    assert main(["campaign", str(tmp_path / "none.toml")]) == ExitCode.CONFIG
    assert "none.toml: file: cannot be read" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["campaign", str(written(tmp_path, TEXT))]) == ExitCode.USAGE
    expected = "pyarrow is not installed: pip install 'sticking-valve-positioner[campaign]'"
    assert expected in capsys.readouterr().err


def test_the_digest_changes_with_all_that_decides_the_runs_and_with_nothing_else(tmp_path: Path) -> None:
    def digest(old: str = "", new: str = "") -> str:
        return load_campaign(written(tmp_path, TEXT.replace(old, new) if old else TEXT)).digest

    assert digest() == digest("Short runs", "Long runs")
    changes = (("seeds = [1, 2]", "seeds = [2]"), ("points = 4", "points = 8"), ("50e3", "49e3"), ("0.02", "0.04"))
    assert len({digest(), digest('"pi"', '"knocker"'), *(digest(*change) for change in changes)}) == 6
