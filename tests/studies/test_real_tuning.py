"""Tuning the rivals at each lag: repeatable, better than its start, within its ranges, and stored as it is used."""

from __future__ import annotations

import math
import tomllib
from importlib import resources

import pytest

from positioner.bench.inprocess import configure
from positioner.bench.scenario import Scenario
from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.laws.tuned import table_name
from positioner.studies.real_valves import tuned, tuning
from positioner.studies.real_valves.tuned import rival_tables
from positioner.studies.real_valves.tuning import RANGES, Found, Task, control_table, searched, to_toml
from positioner.studies.real_valves.valves import LAGS_S, NOISES
from positioner.studies.tuning import cost_of


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten the run of a candidate to a fifth of a second, and a generation to five candidates."""
    monkeypatch.setattr(tuning, "SETPOINTS", 1)
    monkeypatch.setattr(tuning, "DWELL_S", 0.1)
    monkeypatch.setattr(tuning, "_MEMBERS", 5)


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("law", list(RANGES))
def test_a_search_is_repeatable_and_stays_within_its_ranges(law: str) -> None:
    found = searched(Task(law, 0.005, "0.05", 10, 1))
    assert found == searched(Task(law, 0.005, "0.05", 10, 1))
    for each, value in zip(RANGES[law], found.values, strict=True):
        assert each.low <= value <= each.high or (each.or_none and value == 0.0)


@pytest.mark.usefixtures("short")
def test_a_search_is_never_worse_than_the_packaged_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    costs: list[float] = []

    def cost(scenario: Scenario, limit: float) -> float:
        costs.append(cost_of(scenario, limit))
        return costs[-1]

    monkeypatch.setattr(tuning, "cost_of", cost)
    found = searched(Task("pi", 0.02, "0.05", 15, 1))
    packaged = 0.5 * (costs[0] + costs[1])  # the first candidate, on both plants
    assert found.cost <= packaged
    assert found.cost < max(costs)


def test_what_is_stored_is_what_the_law_gets(monkeypatch: pytest.MonkeyPatch) -> None:
    values = (1000.0, 2000.0, 0.0, 0.01)
    found = {Task("pi", lag_s, "2", 60, 1): Found((lag_s * 1e4 + 5.0, *values[1:]), 1.0) for lag_s in (0.005, 0.1)}
    text = to_toml("pi", 60, 1, found)
    assert text.startswith("# positioner tune pi --real-valves --budget 60 --seed 1\n")
    monkeypatch.setattr(tuned, "_tuned", lambda _law: tomllib.loads(text)["tuned"])
    assert rival_tables("pi", 0.02, "2")["pi"]["proportional_gain_ma_per_m"] == 55.0  # of the nearer lag
    assert rival_tables("pi", 0.3, "2")["pi"]["proportional_gain_ma_per_m"] == 1005.0
    assert rival_tables("pi", 0.02, "0.05") == {}


def test_the_moves_of_two_move_retry_follow_the_lag() -> None:
    assert rival_tables("two-move-retry", 0.1, "2")["two_move_retry"]["moves"]["move_s"] == 0.57
    table = control_table(Task("two-move-retry", 0.02, "2", 1, 1), (0.1, 1e-3, 0.5))
    scenario = Scenario(name="x", title="x", law="two-move-retry", setpoints_mm=(80.0,), dwell_s=1.0, control=table)
    retry = configure(scenario).control.two_move_retry
    assert (retry.moves.move_s, retry.averaging_s, retry.tolerance_m, retry.learning_gain) == (0.17, 0.1, 1e-3, 0.5)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [(["two-move", "--real-valves"], "law 'two-move' is unknown"),
     (["pi", "--real-valves", "--seed", "202"], "--seed must not be one of 201, 202, 203")],
)  # fmt: skip
def test_what_cannot_be_tuned_is_refused(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["tune", *arguments]) == ExitCode.USAGE
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize("law", list(RANGES))
def test_every_lag_and_noise_has_packaged_parameters_with_the_cost_in_their_file(law: str) -> None:
    file = resources.files("positioner.laws.tuned").joinpath("real_valves", f"{table_name(law)}.toml")
    text = file.read_text(encoding="utf-8")
    assert text.startswith(f"# positioner tune {law} --real-valves --budget 60 --seed 1\n")
    entries = tomllib.loads(text)["tuned"]
    assert {(entry["lag_s"], entry["noise"]) for entry in entries} == {
        (lag, noise) for lag in LAGS_S for noise in NOISES
    }
    entry = next(entry for entry in entries if (entry["lag_s"], entry["noise"]) == (0.005, "0.05"))
    stored = entry[table_name(law)]
    values = []
    for each in RANGES[law]:
        group, _, key = each.key.rpartition(".")
        values.append((stored[group] if group else stored)[key])
    task = Task(law, 0.005, "0.05", 60, 1)
    assert control_table(task, values) == {table_name(law): stored}
    cost = 0.5 * sum(tuning._cost(task, plant, values, math.inf) for plant in ("paper", "stochastic"))
    assert cost == pytest.approx(entry["cost"], rel=0.02)
