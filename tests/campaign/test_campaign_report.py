"""What a campaign shows: intervals over what is independent, effects, and corners whose commands replay them."""

from __future__ import annotations

import json
import shlex
import tomllib
from typing import TYPE_CHECKING

import numpy as np
import pytest
from pyarrow import parquet
from small import TEXT, rows, small

import positioner
from positioner.bench.scenario import load_scenario
from positioner.campaign import study
from positioner.campaign.reader import load_campaign
from positioner.campaign.report import blocks
from positioner.campaign.run import Figures, Outcome, PlayedRun, Run
from positioner.campaign.study import code_of
from positioner.campaign.summary import by_chance, explained, summary_of
from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.studies.standings import bootstrap_interval

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from positioner.campaign.plan import Campaign


def figures(error_pct: float, active_fraction: float = 1.0) -> Figures:
    return Figures(
        dwells=1,
        mean_abs_error_pct=error_pct,
        worst_mean_abs_error_pct=error_pct,
        max_abs_error_pct=error_pct,
        median_settle_1pct_s=0.01,
        median_settle_2pct_s=0.01,
        unsettled_1pct=0,
        unsettled_2pct=0,
        overshoot_pct=0.0,
        limit_cycles=0,
        reversals=1,
        travel_mm=11.0,
        ideal_travel_mm=10.0,
        travel_ratio=1.1,
        iae_mm_s=0.1,
        command_variation_ma=1.0,
        active_fraction=active_fraction,
        learned=0,
    )


def played(campaign: Campaign, outcome: Callable[[Run], Outcome]) -> list[PlayedRun]:
    return [PlayedRun(run, outcome(run)) for run in campaign.runs()]


def test_an_interval_is_over_the_points_of_a_sample_and_over_the_seeds_of_a_grid(tmp_path: Path) -> None:
    def outcome(run: Run) -> Outcome:
        return Outcome(figures(0.1 * (run.point + 1) + 0.01 * run.seed))

    sample = small(tmp_path)
    (law,) = summary_of(sample, played(sample, outcome)).laws
    points = [0.1 * (number + 1) + 0.015 for number in range(4)]
    assert law.error.mean_pct == pytest.approx(np.mean(points))
    assert (law.error.low_pct, law.error.high_pct) == pytest.approx(bootstrap_interval(points))
    path = tmp_path / "grid.toml"
    lines = TEXT.replace('"sobol"\npoints = 4', '"grid"').replace("high = 55e3", "high = 55e3, levels = 2")
    path.write_text(lines.replace("logarithmic", 'logarithmic", levels = 2 }\n#'), encoding="utf-8")
    grid = load_campaign(path)
    (law,) = summary_of(grid, played(grid, outcome)).laws
    assert (law.error.low_pct, law.error.high_pct) == pytest.approx(bootstrap_interval([0.26, 0.27]))


def test_a_parameter_that_decides_explains_all_and_one_without_an_effect_nothing(tmp_path: Path) -> None:
    campaign = small(tmp_path, points="points = 64")
    spring, other = campaign.parameters

    def outcome(run: Run) -> Outcome:  # a step at the middle of the range
        return Outcome(figures(1.0 if spring.place_of(run.values[0]) < 0.5 else 2.0))

    of_spring, of_other = summary_of(campaign, played(campaign, outcome)).effects
    assert (of_spring.parameter, of_other.parameter) == (spring.name, other.name)
    assert of_spring.explained == pytest.approx(1.0)
    assert of_other.explained is not None
    assert of_other.explained < 0.1
    assert [part.error.mean_pct for part in of_spring.parts] == [1.0] * 4 + [2.0] * 4
    assert [part.runs for part in of_spring.parts] == [16] * 8  # 64 points of a Sobol sequence, two seeds
    assert (of_spring.parts[0].begin, of_spring.parts[-1].end) == (0.0, 1.0)


def test_what_chance_explains_is_that_of_random_values(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    for points, parts in ((16, 4), (32, 5)):
        campaign = small(tmp_path, points=f"points = {points}")
        groups = np.array_split(np.arange(points), parts)
        found = []
        for _ in range(4000):
            values = rng.normal(size=points)
            inside = sum(np.sum((values[group] - values[group].mean()) ** 2) for group in groups)
            found.append(1.0 - inside / np.sum((values - values.mean()) ** 2) * (points - 1) / (points - parts))
        assert by_chance(campaign) == pytest.approx(2.0 * np.std(found), rel=0.1)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(("points", "few"), [("points = 4", True), ("points = 32", False)])
def test_a_campaign_with_too_few_points_says_so(points: str, few: bool, tmp_path: Path) -> None:
    campaign = small(tmp_path, points=points, seeds="seeds = [7]")
    about = blocks(campaign, summary_of(campaign, played(campaign, lambda _: Outcome(figures(0.1)))), [])[2]
    assert isinstance(about, str)
    assert ("These are few points: a parameter without any effect may explain 89 % by chance" in about) is few
    assert ("give 32 or more" in about) is few


def test_what_is_explained_is_kelleys_epsilon_squared() -> None:
    groups = ((1.0, 2.0, 3.0), (4.0, 6.0), (9.0,))
    values = np.concatenate(groups)
    between = sum(len(group) * (np.mean(group) - np.mean(values)) ** 2 for group in groups)
    whole = np.sum((values - np.mean(values)) ** 2)
    ratio = between / whole
    assert explained(groups) == pytest.approx(1.0 - (1.0 - ratio) * 5 / 3)
    assert explained(((1.0,), (2.0,))) is None  # one value a group: nothing to compare with
    assert explained(((1.0, 1.0), (1.0,))) is None  # no variance
    assert explained(((1.0, 5.0), (2.0, 4.0))) == 0.0


def test_the_worst_corners_are_failures_then_lost_control_then_errors_once_a_point(tmp_path: Path) -> None:
    def outcome(run: Run) -> Outcome:
        if run.point == 2 and run.seed == 2:
            return Outcome(None, "ValueError: none")
        return Outcome(figures({0: 1.0, 1: 0.5, 2: 9.0, 3: 3.0}[run.point] + run.seed, 0.5 if run.point == 1 else 1.0))

    campaign = small(tmp_path)
    summary = summary_of(campaign, played(campaign, outcome))
    assert [(each.run.point, each.run.seed) for each in summary.corners] == [(2, 2), (1, 2), (3, 2)]
    (law,) = summary.laws
    assert (law.runs, law.failed, law.out_of_control) == (8, 1, 2)
    assert law.worst_dwell_pct == 10.0


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "spread_out", lambda function, items, _: ((item, function(item)) for item in items))


@pytest.mark.usefixtures("here")
def test_the_files_of_a_campaign_and_the_command_of_a_corner_that_replays_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = {"laws": 'laws = ["pi", "nmpc"]', "points": "points = 2", "dwell": "dwell_s = 0.3"}
    campaign, out = small(tmp_path, **changes), tmp_path / "the out"
    assert main(["campaign", campaign.source, "--out", str(out), "--markdown"]) == ExitCode.OK
    text = (out / "summary.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.startswith(text)
    for name in ("sensitivity.png", "corners.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
        assert "</svg>" in (out / name).with_suffix(".svg").read_text("utf-8")

    table = parquet.read_table(out / "runs.parquet")
    about = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert about["campaign"] == campaign.text
    assert (about["campaign_digest"], about["version"]) == (campaign.digest, positioner.__version__)
    assert json.loads(about["code"]) == {law: code_of(law) for law in ("pi", "nmpc")}
    found = rows(out / "runs.parquet")
    assert [(row["point"], row["law"], row["seed"]) for row in found] == [
        (point, law, seed) for point in (0, 1) for law in ("pi", "nmpc") for seed in (1, 2)
    ]
    assert [tuple(row[each.name] for each in campaign.parameters) for row in found[::4]] == campaign.points()

    content = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    corner = next(corner for corner in content["corners"] if corner["law"] == "nmpc")
    assert f"`{corner['command']}`" in text
    program, *arguments = shlex.split(corner["command"])
    assert program == "positioner"
    assert main(arguments) == ExitCode.OK
    result = json.loads((out / "corners" / "nmpc-1" / "result.json").read_text(encoding="utf-8"))
    (row,) = (
        row for row in found if (row["point"], row["law"], row["seed"]) == (corner["point"], "nmpc", corner["seed"])
    )
    for name, value in {**result["totals"], "active_fraction": result["active_fraction"]}.items():
        assert row[name] == (None if value is None else pytest.approx(value, rel=1e-5))
    assert row["learned"] == result["table_after"]["recorded"]


@pytest.mark.usefixtures("here")
def test_a_campaign_in_which_every_run_fails_says_so_and_keeps_the_reasons(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("positioner.campaign.run.run_in_process", lambda _scenario: 1 / 0)
    out = tmp_path / "out"
    assert main(["campaign", small(tmp_path).source, "--out", str(out)]) == ExitCode.FAILURE
    assert "8 of 8 runs failed; the column `failure` of runs.parquet says why" in capsys.readouterr().err
    assert {row["failure"] for row in rows(out / "runs.parquet")} == {"ZeroDivisionError: division by zero"}


@pytest.mark.usefixtures("here")
def test_a_corner_is_a_whole_scenario_and_corners_of_an_earlier_campaign_go(tmp_path: Path) -> None:
    campaign, out = small(tmp_path, points="points = 1", seeds="seeds = [7]"), tmp_path / "out"
    (out / "corners").mkdir(parents=True)
    (out / "corners" / "pi-9.toml").touch()
    assert main(["campaign", campaign.source, "--out", str(out)]) == ExitCode.OK
    (path,) = (out / "corners").glob("*.toml")
    (run,) = campaign.runs()
    scenario = load_scenario(str(path))
    assert (scenario.name, scenario.seed, scenario.law) == ("small-pi-1", 7, "pi")
    assert Run(0, (), scenario).key == run.key
    assert tomllib.loads(path.read_text(encoding="utf-8"))["control"]["pi"]["filter_time_constant_s"] == run.values[1]
    assert "No intervals" in (out / "summary.md").read_text(encoding="utf-8")
