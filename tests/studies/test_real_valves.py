"""The league on real valves: its plants and conditions, its time-optimal limit, its judgement, and its command."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, replace
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING

import pytest
from slow_cases import slow

from plant_emulator.presets import plant_settings
from positioner.bench.configure import told
from positioner.bench.inprocess import configure
from positioner.bench.playable import check_playable
from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.studies.entrants import WITHOUT_TABLE
from positioner.studies.league import SETPOINTS_MM
from positioner.studies.limit import optimal_move
from positioner.studies.pool import Workers
from positioner.studies.real_valves import league
from positioner.studies.real_valves.bouts import RIVALS, RealBout, RealLeagueSettings, play
from positioner.studies.real_valves.conditions import AS_CONFIGURED, CONDITIONS
from positioner.studies.real_valves.goals import judged
from positioner.studies.real_valves.identification import Identification, identify
from positioner.studies.real_valves.results import Cell, Results
from positioner.studies.real_valves.valves import (
    GRAPHITE,
    LAGS_S,
    NOISES,
    NOMINAL,
    PLANTS,
    plant_tables,
    setpoints_mm,
)

if TYPE_CHECKING:
    from pathlib import Path

FULL = RealLeagueSettings(
    laws=("nmpc", *RIVALS),
    plants=(*PLANTS, GRAPHITE),
    rival_plants=(*PLANTS, GRAPHITE),
    lags_s=LAGS_S,
    noises=("0.05", "2"),
    seeds=(201, 202, 203),
    conditions=tuple(CONDITIONS),
)


def _cell(error_pct: float, **changes: object) -> Cell:
    cell = Cell(
        law="nmpc",
        plant=NOMINAL,
        lag_s=0.0,
        noise="0.05",
        condition=AS_CONFIGURED,
        dwells=2,
        mean_pct=error_pct,
        percentile_95_pct=error_pct,
        worst_pct=error_pct,
        median_settle_1pct_s=0.01,
        unsettled=0,
        limit_cycles=0,
        travel_ratio=1.0,
        errors_pct=(error_pct,) * 2,
    )
    return replace(cell, **changes)  # type: ignore[arg-type]


def test_a_whole_league_has_the_dwells_that_its_goals_count() -> None:
    main_part = [bout for bout in FULL.bouts() if bout.condition == AS_CONFIGURED and bout.plant != GRAPHITE]
    ours = [bout for bout in main_part if bout.law == "nmpc" and bout.noise == "2"]
    assert sum(bout.setpoints for bout in ours) == 1152
    assert {bout.dwell_s for bout in ours if bout.lag_s <= 0.1} == {6.0}
    assert {bout.dwell_s for bout in ours if bout.lag_s == 0.3} == {20.0}
    assert {bout.lag_s for bout in FULL.bouts() if bout.plant == GRAPHITE} == {0.1}
    keys = [bout.key for bout in FULL.bouts()]
    assert len(set(keys)) == len(keys)


def test_every_bout_can_be_played_by_a_law_that_knows_the_plant_or_is_configured_otherwise() -> None:
    for bout in {(bout.plant, bout.lag_s, bout.noise, bout.condition): bout for bout in FULL.bouts()}.values():
        scenario = bout.scenario
        configuration = configure(scenario)
        plant = check_playable(scenario, configuration)  # raises where some setpoint is out of reach
        known = told(plant)
        own = configuration.valve
        is_configured = (
            own.spring_rate_n_per_m == known["spring_rate_n_per_m"]
            and own.static_friction_n == known["static_friction_n"]
            and own.sensor_time_constant_s == known["sensor_time_constant_s"]
            and own.backlash_m == known["backlash_m"]
            and asdict(own.actuator) == known["actuator"]
        )
        assert is_configured != bout.condition.endswith("not-configured"), bout.title


def test_the_nominal_valve_visits_the_setpoints_of_the_league_and_others_the_same_places_of_their_range() -> None:
    assert setpoints_mm(plant_settings(NOMINAL)) == pytest.approx(SETPOINTS_MM, abs=0.06)
    # K x ± F_s = B u at 4 and 20 mA: a spring 20 % stronger can be restarted from 48.3 to 78.8 mm
    first = setpoints_mm(plant_settings("spring+20"))[0]
    assert first == pytest.approx(48.25 + 0.413 * (78.75 - 48.25), abs=0.1)


@pytest.mark.parametrize(("lag_ms", "optimum_ms"), [(5, 11.8), *slow((10, 17.6), (20, 28.0), (50, 59.0))])
def test_with_lag_the_time_optimal_limit_is_that_of_an_independent_computation(
    lag_ms: float, optimum_ms: float
) -> None:
    # the medians of a fixed-step simulation with its own bisection, over the same moves
    settings = plant_settings(overrides=plant_tables(NOMINAL, lag_ms / 1e3, "0.05", {}))
    places_mm = (61.0, 73.0, 87.0, 80.0, 73.0, 81.5, 83.0, 75.0, 77.0)
    moves = [optimal_move(settings, a * 1e-3, b * 1e-3) for a, b in pairwise(places_mm)]
    assert median(move.settle_1pct_s for move in moves) * 1e3 == pytest.approx(optimum_ms, rel=0.025)


def test_goals_are_judged_by_the_worst_lag_and_the_best_rival() -> None:
    results = Results(
        cells=(
            _cell(0.019),
            _cell(0.06, lag_s=0.02, median_settle_1pct_s=0.04),
            _cell(0.05, lag_s=0.02, plant="stochastic", limit_cycles=2),
            _cell(0.30, lag_s=0.02, plant="stochastic", law="pi"),
            _cell(0.20, lag_s=0.02, plant="stochastic", law="knocker"),
            _cell(0.01, lag_s=0.02, plant="stochastic", law=WITHOUT_TABLE),
            _cell(0.10, lag_s=0.02, law="pi", median_settle_1pct_s=0.12),
            _cell(0.055, condition="vent-0.6-not-configured"),
        ),
        optimal_settle_s={0.0: 0.005, 0.02: 0.028},
    )
    found = {each.goal: each for each in judged(results) if each.noise == "0.05"}
    assert (found["nominal mean, every lag"].figure, found["nominal mean, every lag"].is_met) == (0.06, False)
    assert found["nominal mean without lag"].is_met is True
    settling = found["settling, nominal, lag ≥ 5 ms, over the time-optimal"]
    assert settling.figure == pytest.approx(0.04 / 0.028)
    assert settling.is_met is True
    assert (found["limit cycles, of 6 dwells"].figure, found["limit cycles, of 6 dwells"].is_met) == (2, False)
    rivals = found["best rival over ours: mean, stochastic, lag ≥ 10 ms"]
    assert rivals.figure == pytest.approx(0.20 / 0.05)  # our law without its table is no rival
    assert rivals.is_met is False
    assert found["best rival over ours: settling, nominal, lag ≥ 5 ms"].figure == pytest.approx(3.0)
    assert found["not configured: lag ± 30 %, vent 0.6 of fill, one sample of dead time"].figure == 0.055
    assert found["lag 1 s"].is_met is None


def test_the_other_laws_can_have_fewer_plants() -> None:
    fewer = replace(FULL, laws=("nmpc", WITHOUT_TABLE, "pi"), rival_plants=(NOMINAL,))
    plants = {law: {bout.plant for bout in fewer.bouts() if bout.law == law} for law in fewer.laws}
    assert plants == {"nmpc": {*PLANTS, GRAPHITE}, WITHOUT_TABLE: {*PLANTS, GRAPHITE}, "pi": {NOMINAL}}


def test_without_its_table_the_law_learns_and_never_uses_it() -> None:
    bout = RealBout(
        law=WITHOUT_TABLE,
        plant=NOMINAL,
        lag_s=0.0,
        noise="0.05",
        seed=1,
        condition=AS_CONFIGURED,
        setpoints=1,
        dwell_s=0.1,
        period_s=0.001,
    )
    scenario = bout.scenario
    assert (scenario.law, configure(scenario).control.table_from_s) == ("nmpc", 1e9)
    assert len(play(bout)) == 1


@pytest.mark.slow(short="test_goals_are_judged_by_the_worst_lag_and_the_best_rival")
def test_the_command_plays_a_part_and_resumes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["league", "--real-valves", "--short", "--laws", "nmpc,two-move-retry,pi", "--tau", "0,20", "--dwell",
               "0.2", "--conditions", "lag-not-configured", "--out", str(tmp_path), "--workers", "1",
               "--markdown", "--report", str(tmp_path / "page.html")]  # fmt: skip
    assert main(command) == ExitCode.OK
    text = capsys.readouterr().out
    assert re.search(r"<h2>\d+ of \d+ goals are met</h2>", (tmp_path / "page.html").read_text("utf-8"))
    assert "| nominal mean, every lag | 0.05 % of span | ≤ 0.05 % |" in text
    assert "| lag, ms | 0 | 20 |" in text
    assert "| time-optimal |" in text
    stored = json.loads((tmp_path / "real-valves.json").read_text(encoding="utf-8"))
    assert len(stored["cells"]) == 3 * 2 + 3
    assert (tmp_path / "real-valves.png").read_bytes().startswith(b"\x89PNG")
    assert ">time-optimal<" in (tmp_path / "real-valves.svg").read_text("utf-8")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "bouts").iterdir()}
    assert main(command) == ExitCode.OK
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "bouts").iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--tau", "5"], "--tau needs --real-valves"),
        (["--rival-plants", "paper"], "--rival-plants needs --real-valves"),
        (["--real-valves", "--tau", "x"], "tau 'x' is no number"),
        (["--real-valves", "--noise", "3"], "noise '3' is unknown"),
        (["--real-valves", "--conditions", "unheard"], "condition 'unheard' is unknown"),
        (["--real-valves", "--plants", "mars"], "plant 'mars' is unknown"),
        (["--real-valves", "--setpoints", "80"], "--setpoints does not go with --real-valves"),
        (["--real-valves", "--tau", "-1"], "fill_time_constant_s = -0.001: must be greater than or equal to 0"),
    ],
)
def test_mistakes_of_the_command_line_get_one_clear_line(
    arguments: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["league", *arguments, "--out", str(tmp_path)]) != ExitCode.OK
    assert expected in capsys.readouterr().err


def test_an_identified_valve_is_what_every_law_is_configured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known: object = {
        "valve": {**told(plant_settings(NOMINAL)), "spring_rate_n_per_m": 51234.0},
        "estimator": NOISES["2"],
    }
    bouts = [bout for bout in replace(FULL, laws=("pi",), lags_s=(0.02,)).bouts() if bout.noise == "2"]
    asked: list[Identification] = []

    def compute(items: list[Identification], *_others: object) -> dict[Identification, object]:
        asked.extend(items)
        return dict.fromkeys(items, known)

    monkeypatch.setattr(league, "computed", compute)
    for bout in league._identified(bouts, tmp_path, Workers(1)):
        own = configure(bout.scenario)
        assert own.valve.spring_rate_n_per_m == 51234.0
        assert (own.estimator.noise_of_reading, own.estimator.noise_of_span) == (0.02, 0.0)
    assert len(asked) == len(PLANTS) + 1  # once for all seeds


@pytest.mark.slow(short="test_an_identified_valve_is_what_every_law_is_configured")
def test_the_identification_of_the_league_finds_spring_friction_and_lag() -> None:
    found = identify(Identification("spring-20", 0.02, "0.05", 0.004))
    assert found["valve"]["spring_rate_n_per_m"] == pytest.approx(42030.4, rel=0.005)
    assert found["valve"]["static_friction_n"] == pytest.approx(1707.7, rel=0.01)
    assert found["valve"]["actuator"]["fill_time_constant_s"] == pytest.approx(0.02, rel=0.05)
    assert found["estimator"]["noise_of_span"] == pytest.approx(0.0005, rel=0.1)
