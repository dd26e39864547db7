"""Tuning: figures of the fast loop, a repeatable search that finds something, and readable files."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import pytest

from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import load_scenario
from positioner.cli.main import main
from positioner.config.reader import parse_config
from positioner.errors import ExitCode
from positioner.laws.settings import ControlSettings
from positioner.laws.tuned import table_name
from positioner.studies import tuning
from positioner.studies.conditions import PLANTS, check_setpoints
from positioner.studies.direct import play_directly
from positioner.studies.searches import SEARCHES, control_table
from positioner.studies.tuning import Tuning, cost_of, dwell_cost, scenario_of, to_toml, tune

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from positioner.bench.scenario import Scenario

T = TypeVar("T")
R = TypeVar("R")

MIDDLE = {
    name: tuple(float(f"{math.sqrt(each.low * each.high):.4g}") for each in search.ranges)
    for name, search in SEARCHES.items()
}
"""A candidate of every law: the middle of its ranges."""


class Here:
    """A pool that works in this process, in the reverse order, as if on `size` workers."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.done = 0

    def results(self, function: Callable[[T], R], items: Sequence[T]) -> Generator[tuple[T, R]]:
        for item in reversed(items):
            self.done += 1
            yield item, function(item)


HERE = Here(1)


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten the run of a candidate to a fifth of a second."""
    monkeypatch.setattr(tuning, "SETPOINTS_MM", (73.0, 80.0))
    monkeypatch.setattr(tuning, "VISITS", 1)
    monkeypatch.setattr(tuning, "DWELL_S", 0.1)


@pytest.mark.parametrize(
    ("law", "values"),
    [
        ("pi", (5000.0, 1000.0, 0.0, 0.0)),  # gains at which the rounding of a reading to 10 nm has an effect
        ("knocker", MIDDLE["knocker"]),
        ("two-move-retry", MIDDLE["two-move-retry"]),
    ],
)
def test_without_frames_the_figures_are_the_same_to_the_bit(law: str, values: tuple[float, ...]) -> None:
    control = control_table(law, values)
    scenario = replace(load_scenario("paper-valve"), law=law, visits=1, dwell_s=0.2, seed=5, control=control)
    recording = run_in_process(scenario).recording
    trace = metrics.Trace(
        time_s=recording.time_s,
        position_m=recording.true_position_m,
        setpoint_m=recording.setpoint_m,
        current_ma=recording.current_ma,
    )
    assert tuple(play_directly(scenario)) == metrics.dwell_metrics(trace, scenario.dwell_edges_s, 0.127)


@pytest.mark.usefixtures("short")
def test_a_search_is_repeatable_and_better_than_its_start() -> None:
    found = tune("pi", 6, 3, HERE)
    assert found == tune("pi", 6, 3, HERE)
    assert found.cost < 0.9 * found.first_cost
    assert found.cost == cost_of(scenario_of("pi", found.values, 3))
    assert tune("pi", 6, 4, HERE).values != found.values


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("size", [2, 3, 7, 100])
def test_the_number_of_workers_changes_no_answer(size: int) -> None:
    here = Here(size)
    assert tune("pi", 12, 3, here) == tune("pi", 12, 3, HERE)
    assert here.done > 12  # some varied a candidate that was the best no more


@pytest.mark.usefixtures("short")
def test_later_candidates_vary_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[tuple[float, ...]] = []

    def cost(scenario: Scenario, limit: float) -> float:
        table = scenario.control["two_move"]
        tried.append((table["move_s"], table["back_off_m"]))
        return min(abs(math.log(table["move_s"] / 0.06)), limit)

    monkeypatch.setattr(tuning, "cost_of", cost)
    best = tune("two-move", 100, 1, HERE).values
    assert best == min(tried, key=lambda values: abs(math.log(values[0] / 0.06)))
    for each, values in zip(SEARCHES["two-move"].ranges, zip(*tried, strict=True), strict=True):
        assert each.low <= min(values)
        assert max(values) <= each.high
    # explored log-uniformly, then one of two kept and the other varied by a factor of e^±0.3
    assert 0.35 < sum(move_s < math.sqrt(0.02 * 0.12) for move_s, _ in tried[:50]) / 50 < 0.65
    steps = []
    for number in range(50, 100):
        before = min(tried[:number], key=lambda values: abs(math.log(values[0] / 0.06)))
        steps.append(math.log(tried[number][0] / before[0]))
    assert 15 < steps.count(0.0) < 35
    assert 0.2 < np.std([step for step in steps if step]) < 0.4


@pytest.mark.usefixtures("short")
def test_a_candidate_is_dropped_just_when_it_cannot_win() -> None:
    scenario = scenario_of("pi", MIDDLE["pi"], 1)
    dwells = list(play_directly(scenario))
    cost = cost_of(scenario)
    assert cost == pytest.approx(sum(map(dwell_cost, dwells)) / 2)
    assert cost_of(scenario, math.nextafter(cost, math.inf)) == cost
    assert cost_of(scenario, cost) == math.inf


def test_the_cost_follows_its_equation() -> None:
    dwell = metrics.DwellMetrics(
        setpoint_mm=80.0,
        mean_abs_error_pct=0.5,
        max_abs_error_pct=9.0,
        settle_1pct_s=None,
        settle_2pct_s=None,
        overshoot_pct=9.0,
        reversals=3,
        limit_cycle=True,
        travel_mm=9.0,
        ideal_travel_mm=9.0,
        iae_mm_s=2.0,
        command_variation_ma=40.0,
    )
    assert dwell_cost(dwell) == pytest.approx(2.0 + 0.5 + 0.04 + 0.12)


def test_candidates_are_played_where_every_plant_can_be_restarted() -> None:
    check_setpoints(tuning.SETPOINTS_MM, PLANTS)
    scenario = scenario_of("pi", MIDDLE["pi"], 1)
    assert scenario.sample_period_s == 1e-3
    # the integral's limit cycle takes seconds
    assert scenario.dwell_s >= 3.0


@pytest.mark.parametrize("law", SEARCHES)
def test_every_candidate_of_every_law_is_a_configuration(law: str) -> None:
    for values in (
        MIDDLE[law],
        tuple(each.low for each in SEARCHES[law].ranges),
        tuple(0.0 if each.or_none else each.low for each in SEARCHES[law].ranges),
    ):
        assert configure(scenario_of(law, values, 1)).make_law().name == law


def test_a_pulse_that_would_outlast_its_period_takes_half_of_it() -> None:
    search = SEARCHES["knocker"]
    keys = [each.key for each in search.ranges]
    width, period = keys.index("pulse_width_s"), keys.index("pulse_period_s")
    values = list(MIDDLE["knocker"])
    values[width], values[period] = 0.09, 0.02
    assert tuning._rounded(search, values)[width] == 0.01


@pytest.mark.parametrize("law", SEARCHES)
def test_the_packaged_parameters_are_the_defaults_of_a_law(law: str) -> None:
    name = table_name(law)
    packaged = resources.files("positioner.laws.tuned").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    command, _ = how(packaged)
    assert command[:2] == [law, "--budget"]
    assert int(command[-1]) not in tuning.LEAGUE_SEEDS
    found = parse_config(packaged, "test", Path())
    assert found.control == replace(ControlSettings(), law=law)
    assert found.make_law().name == law


def how(text: str) -> tuple[list[str], float]:
    """Return the arguments of `positioner tune` and the cost in the comment of its result."""
    command, cost, *_ = text.splitlines()
    return command.removeprefix("# positioner tune ").split(), float(cost.removeprefix("# cost "))


def test_the_packaged_parameters_have_the_cost_in_their_file() -> None:
    packaged = resources.files("positioner.laws.tuned").joinpath("two_move.toml").read_text(encoding="utf-8")
    file = tomllib.loads(packaged)
    values = tuple(file["control"]["two_move"][each.key] for each in SEARCHES["two-move"].ranges)
    command, cost = how(packaged)
    assert cost_of(scenario_of("two-move", values, int(command[-1]))) == pytest.approx(cost, rel=0.02)


def test_a_result_is_a_configuration_that_check_accepts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = to_toml(Tuning("knocker", 10, 2, MIDDLE["knocker"], 1.23456, 9.0))
    assert how(text) == (["knocker", "--budget", "10", "--seed", "2"], 1.2346)
    (tmp_path / "knocker.toml").write_text(text, encoding="utf-8")
    assert main(["check", str(tmp_path / "knocker.toml")]) == ExitCode.OK
    assert "law                    knocker" in capsys.readouterr().out
    knocker = parse_config(text, "test", tmp_path).control.knocker
    assert knocker.pid.proportional_gain_ma_per_m == MIDDLE["knocker"][0]
    assert knocker.off_band_m == MIDDLE["knocker"][-1]


@pytest.mark.usefixtures("short")
def test_the_command_writes_the_result_of_the_search(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "two_move.toml"
    assert main(["tune", "two-move", "--budget", "2", "--seed", "2", "--out", str(out)]) == ExitCode.OK
    assert out.read_text(encoding="utf-8") == to_toml(tune("two-move", 2, 2, HERE))
    assert main(["tune", "two-move", "--budget", "2", "--seed", "2"]) == ExitCode.OK
    assert capsys.readouterr().out == out.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--seed", "102"], "nor 101 to 103"),
        (["--seed", "-1"], "must not be negative"),
        (["--budget", "0"], "--budget must be at least 1"),
        (["--out", "/nowhere/pi.toml"], "--out /nowhere/pi.toml: there is no folder /nowhere"),
    ],
)
def test_what_cannot_be_searched_is_refused(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["tune", "pi", *arguments]) == ExitCode.USAGE
    assert expected in capsys.readouterr().err


@pytest.mark.usefixtures("short")
def test_a_file_that_cannot_be_written_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", "two-move", "--budget", "1", "--out", str(tmp_path)]) == ExitCode.IO
    assert "cannot be written" in capsys.readouterr().err
