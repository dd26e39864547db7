"""The league: setpoints that every plant can serve, the time-optimal limit, resumption, and the standings."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_checks import check

import plant_emulator
import positioner
from plant_emulator.presets import plant_settings, preset_names
from positioner.bench.metrics import DwellMetrics
from positioner.bench.playable import restartable_mm
from positioner.cli.main import main
from positioner.errors import ConfigurationError, ExitCode
from positioner.laws.registry import LAWS
from positioner.studies.code_digest import code_digest
from positioner.studies.conditions import NOMINAL, PLANTS, check_setpoints, reference_plant, setpoints_in_reach
from positioner.studies.league import SETPOINTS_MM, Bout, LeagueSettings, play_league
from positioner.studies.league_picture import LeagueReport, league_figure
from positioner.studies.league_report import to_markdown, write_report
from positioner.studies.limit import optimal_move
from positioner.studies.pool import Workers
from positioner.studies.standings import bootstrap_interval, optimal_median_s, standings, summaries
from positioner.wire.codec import packaged_dbc_text

_NOMINAL = plant_settings(NOMINAL)


def _dwell(error_pct: float, settle_s: float | None = 0.01, *, cycle: bool = False) -> DwellMetrics:
    return DwellMetrics(
        setpoint_mm=80.0,
        mean_abs_error_pct=error_pct,
        max_abs_error_pct=error_pct,
        settle_1pct_s=settle_s,
        settle_2pct_s=settle_s,
        overshoot_pct=0.0,
        reversals=0,
        limit_cycle=cycle,
        travel_mm=7.7,
        ideal_travel_mm=7.0,
        iae_mm_s=0.1,
        command_variation_ma=10.0,
    )


def _bout(law: str, plant: str = "paper") -> Bout:
    return Bout(law, plant, 1, (80.0,), 1.0, 0.001)


@pytest.mark.parametrize(
    ("preset", "low_mm", "high_mm"),
    [("paper", 57.9, 94.5), ("spring-20", 72.4, 118.0), ("friction+20", 64.4, 88.0)],
)
def test_the_restartable_range_is_that_of_the_force_balance(preset: str, low_mm: float, high_mm: float) -> None:
    # K x ± F_s = B u at 4 and 20 mA, with Table 3
    low, high = restartable_mm(plant_settings(preset))
    assert low == pytest.approx(low_mm, abs=0.15)
    assert high == pytest.approx(high_mm, abs=0.15)


def test_every_plant_can_serve_the_default_setpoints() -> None:
    check_setpoints(SETPOINTS_MM, PLANTS)  # raises where one is not
    ranges = [restartable_mm(plant_settings(plant)) for plant in PLANTS]
    assert all(low < setpoint_mm < high for setpoint_mm in SETPOINTS_MM for low, high in ranges)


def test_a_setpoint_that_some_plant_cannot_leave_is_refused_with_the_plant_and_its_range() -> None:
    with pytest.raises(ConfigurationError, match=r"setpoint 89 mm: 4 to 20 mA restart friction\+20 both ways"):
        check_setpoints((80.0, 89.0), PLANTS)


@pytest.mark.parametrize(
    ("start_mm", "end_mm", "rest_ms"),
    [(10.0, 73.0, 14.5), (73.0, 87.0, 9.9), (87.0, 80.0, 4.8), (80.0, 73.0, 5.5), (81.5, 83.0, 2.6)],
)
def test_the_time_optimal_limit_is_that_of_an_independent_computation(
    start_mm: float, end_mm: float, rest_ms: float
) -> None:
    # the figures are those of a fixed-step simulation with its own bisection
    move = optimal_move(_NOMINAL, start_mm * 1e-3, end_mm * 1e-3)
    assert move.rest_s * 1e3 == pytest.approx(rest_ms, abs=0.1)
    assert 0.0 < move.settle_1pct_s < move.rest_s


def test_nothing_settles_before_a_stem_under_full_force_could_have_arrived() -> None:
    # without friction, spring and viscous drag, B·Δu/m bounds the acceleration: t ≥ sqrt(2 d / a) for half the way
    valve = _NOMINAL.valve
    gain = valve.diaphragm_area_m2 * valve.pressure_gain_pa_per_ma
    acceleration = gain * 16.0 / valve.mass_kg
    move = optimal_move(_NOMINAL, 0.073, 0.087)
    assert move.rest_s > 2.0 * math.sqrt(0.014 / acceleration)


def test_the_bootstrap_interval_of_a_normal_sample_is_the_textbook_one() -> None:
    values = np.random.default_rng(3).normal(1.0, 0.2, 400)
    low, high = bootstrap_interval(values.tolist())
    half = 1.96 * values.std() / math.sqrt(values.size)
    assert low == pytest.approx(values.mean() - half, abs=0.15 * half)
    assert high == pytest.approx(values.mean() + half, abs=0.15 * half)


def test_a_single_value_has_no_interval_and_equal_ones_a_narrow_one() -> None:
    assert bootstrap_interval([0.3]) == (None, None)
    assert bootstrap_interval([0.3, 0.3, 0.3]) == pytest.approx((0.3, 0.3))


def test_the_interval_is_that_of_the_seeds_and_no_dwell_makes_it_narrower() -> None:
    def played(dwells_each: int) -> tuple[float | None, float | None]:
        runs = {replace(_bout("pi"), seed=seed): (_dwell(0.1 * seed),) * dwells_each for seed in (1, 2, 3)}
        (row,) = standings(runs)
        assert row.mean_error_pct == pytest.approx(0.2)
        assert row.dwells == 3 * dwells_each
        return row.mean_error_low_pct, row.mean_error_high_pct

    assert played(1) == played(50) == pytest.approx((0.1, 0.3))


def test_of_one_seed_no_interval_is_printed_however_many_its_dwells() -> None:
    text = _page(seeds=(1,))
    assert "| mean error, % | paper |" in text
    assert "| `pi` | 0.400 |\n" in text
    assert "(95 %)" not in text
    assert "A single seed: no interval." in text
    text = _page(seeds=(1, 2))
    assert "| mean error, % (95 %) | paper |" in text
    assert "| `pi` | 0.400 (0.400–0.400) |\n" in text
    assert "bootstrap over the means of 2 seeds" in text


def _page(seeds: tuple[int, ...]) -> str:
    settings = LeagueSettings(laws=("pi",), plants=("paper",), seeds=seeds)
    table = standings({replace(_bout("pi"), seed=seed): (_dwell(0.3), _dwell(0.5)) for seed in seeds})
    return to_markdown(LeagueReport(settings=settings, summaries=summaries(table, 0.005), standings=table,
                                  optimal_settle_1pct_s=0.005, optimal_rest_s=0.006))  # fmt: skip


def test_standings_count_dwells_that_did_not_settle_and_that_cycled() -> None:
    table = standings({_bout("pi"): (_dwell(0.2), _dwell(0.6, None, cycle=True), _dwell(0.1))})
    (row,) = table
    assert row.mean_error_pct == pytest.approx(0.3)
    assert (row.dwells, row.worst_dwell_pct, row.unsettled, row.limit_cycles) == (3, 0.6, 1, 1)
    assert row.travel_ratio == pytest.approx(1.1)


def test_the_best_law_stands_first_and_the_others_are_measured_against_the_reference() -> None:
    table = standings(
        {
            _bout("pi"): (_dwell(0.3),),
            _bout("pi", "friction+20"): (_dwell(0.8),),
            _bout("nmpc"): (_dwell(0.1),),
            _bout("nmpc", "friction+20"): (_dwell(0.2),),
        }
    )
    first, second = summaries(table, 0.005)
    assert (first.law, second.law) == ("nmpc", "pi")
    assert second.error_ratio == pytest.approx(4.0)
    assert second.worst_plant == "friction+20"
    assert first.settle_ratio == pytest.approx(2.0)


def test_a_law_that_mostly_never_settles_has_no_median() -> None:
    (law,) = summaries(standings({_bout("pi"): (_dwell(2.0, None), _dwell(2.0, None), _dwell(0.1))}), 0.005)
    assert law.median_settle_1pct_s is None
    assert law.settle_ratio is None


def test_the_report_is_written_with_the_same_figures_in_all_three_files(tmp_path: Path) -> None:
    settings = LeagueSettings(laws=("pi",), plants=("paper",), seeds=(1,))
    table = standings({_bout("pi"): (_dwell(0.3), _dwell(0.5))})
    settle_s, rest_s = optimal_median_s(NOMINAL, (73.0, 87.0, 80.0))
    report = LeagueReport(
        settings=settings,
        summaries=summaries(table, settle_s),
        standings=table,
        optimal_settle_1pct_s=settle_s,
        optimal_rest_s=rest_s,
    )
    write_report(tmp_path, report)
    assert json.loads((tmp_path / "league.json").read_text())["standings"][0]["mean_error_pct"] == pytest.approx(0.4)
    assert "| `pi` | 0.400 | 0.400 (paper) | 0.50 |" in to_markdown(report)
    assert (tmp_path / "league.png").read_bytes().startswith(b"\x89PNG")
    assert ">pi<" in (tmp_path / "league.svg").read_text("utf-8")
    assert "Simulation only" not in to_markdown(report)
    fast = replace(report, settings=replace(settings, period_s=0.0001))
    assert "Simulation only: at 0.1 ms the frames take 273 % of 1 Mbit/s" in to_markdown(fast)


def test_the_picture_of_many_laws_is_legible_and_its_speeds_are_dots_with_quartiles() -> None:
    laws, plants = tuple(LAWS), ("paper", "spring-10", "friction+20")
    dwells = tuple(_dwell(0.1 * number, 0.004 * number * number) for number in range(1, 5))
    table = standings({_bout(law, plant): dwells for law in laws for plant in plants})
    report = LeagueReport(
        settings=LeagueSettings(laws=laws, plants=plants, seeds=(1,)),
        summaries=summaries(table, 0.005),
        standings=table,
        optimal_settle_1pct_s=0.005,
        optimal_rest_s=0.006,
    )
    figure = league_figure(report)
    check(figure)
    _, speed = figure.axes
    assert not speed.patches
    assert len(speed.containers) == len(laws)
    assert table[0].settle_quartiles_s == pytest.approx((0.016, 0.064))


def test_a_quartile_beyond_which_no_dwell_settles_is_none() -> None:
    (row,) = standings({_bout("pi"): (_dwell(0.1), _dwell(0.1), _dwell(2.0, None), _dwell(2.0, None))})
    low_s, high_s = row.settle_quartiles_s
    assert low_s == pytest.approx(0.01)
    assert high_s is None


def test_an_interrupted_league_plays_only_the_missing_bouts(tmp_path: Path) -> None:
    settings = LeagueSettings(laws=("paper",), plants=("paper",), seeds=(1,), setpoints_mm=(75.0,), dwell_s=0.05)
    played = play_league(settings, tmp_path, Workers(1))
    (path,) = tmp_path.iterdir()
    stored = json.loads(path.read_text())
    stored["result"][0]["reversals"] = 77
    path.write_text(json.dumps(stored))
    assert next(iter(play_league(settings, tmp_path, Workers(1)).values()))[0].reversals == 77
    stored["code"] = "of yesterday"
    path.write_text(json.dumps(stored))
    assert play_league(settings, tmp_path, Workers(1)) == played
    assert len({code_digest("paper"), code_digest("knocker")}) == 2  # each law has tuned parameters of its own


def test_the_digest_is_the_same_wherever_the_package_lies_and_follows_every_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in (positioner, plant_emulator):
        source = Path(str(package.__file__)).parent
        shutil.copytree(source, tmp_path / source.name, ignore=shutil.ignore_patterns("__pycache__"))
    before = code_digest("paper")
    for package in (positioner, plant_emulator):
        monkeypatch.setattr(package, "__file__", str(tmp_path / package.__name__ / "__init__.py"))
    (tmp_path / "positioner" / "wire" / "positioner.dbc").write_text(packaged_dbc_text(), encoding="utf-8")
    assert code_digest("paper") == before  # as installed, with the DBC inside
    of_pi, of_nmpc = code_digest("pi"), code_digest("nmpc")
    (tmp_path / "positioner" / "laws" / "nmpc" / "law.py").write_text("", encoding="utf-8")
    assert (code_digest("pi"), code_digest("paper")) == (of_pi, before)  # their results are kept
    assert code_digest("nmpc") != of_nmpc  # which makes quasi-static moves, too
    (tmp_path / "plant_emulator" / "valve.py").write_text("", encoding="utf-8")
    assert code_digest("paper") != before
    monkeypatch.undo()
    monkeypatch.setattr("positioner.studies.code_digest.packaged_dbc_text", lambda: "another")
    assert code_digest("paper") != before


def test_the_digest_leaves_out_only_code_that_no_bout_runs() -> None:
    program = """
import sys
from positioner.studies.code_digest import UNUSED_ROOMS, USED_MODULES
from positioner.studies.league import Bout, play
play(Bout("nmpc", "paper", 1, (80.0,), 0.01, 0.001))
loaded = [name.split(".")[1:] for name in sys.modules if name.startswith("positioner.")]
assert ["laws", "nmpc", "law"] in loaded
bench = {names[1] for names in loaded if names[0] == "bench" and len(names) > 1}
assert bench == USED_MODULES["bench"], bench
assert not [names for names in loaded if names[0] in UNUSED_ROOMS]
"""
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True, timeout=120.0)
    assert done.returncode == 0, done.stderr


def test_the_short_league_shows_our_law_ahead_within_its_bands(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "league.html"
    assert main(["league", "--short", "--out", str(tmp_path), "--workers", "1", "--report", str(page)]) == 0
    assert "time-optimal limit" in capsys.readouterr().out
    told = page.read_text("utf-8")
    assert "nmpc is the most accurate of 3 laws" in told
    assert "To play it again: positioner league --short<" in told
    assert '<svg class="picture"' in told
    found = {law["law"]: law for law in json.loads((tmp_path / "league.json").read_text())["summaries"]}
    ours = found["nmpc"]
    assert 0.005 < ours["reference_error_pct"] < 0.15
    assert 0.01 < ours["worst_plant_error_pct"] < 0.25
    assert 0.02 < ours["worst_dwell_pct"] < 0.4
    assert (ours["limit_cycles"], ours["unsettled"]) == (0, 0)
    # the same medians, of the same setpoints: within the 1 % band, nothing is much faster than the limit
    assert 0.8 < ours["settle_ratio"] < 8.0  # of four dwells the first ones are quasi-static moves
    assert 0.97 < ours["travel_ratio"] < 1.8
    assert all(law["error_ratio"] >= 1.0 for law in found.values())
    assert 1.5 < found["paper"]["error_ratio"] < 10.0
    assert 1.5 < found["pi"]["error_ratio"] < 10.0
    assert 8.0 < found["pi"]["settle_ratio"] < 60.0


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--laws", "nmcp"], "law 'nmcp' is unknown"),
        (["--plants", "mars"], "plant 'mars' is unknown"),
        (["--seeds", "x"], "seed 'x' is no whole number"),
        (["--seeds", ""], "seed '' is no whole number"),
        (["--seeds", "1.5"], "seed '1.5' is no whole number"),
        (["--seeds", "4294967296"], "seed = 4294967296: must be less than or equal to 4294967295"),
        (["--setpoints", "20"], "restart"),
        (["--setpoints", "x"], "setpoint 'x' is no number"),
        (["--period", "0"], "sample_period_s = 0.0: must be greater than or equal to 0.0001 s"),
        (["--dwell", "-1"], "dwell_s = -1.0: must be greater than 0 s"),
        (["--dwell", "0.055"], "dwell_s = 0.055: must be a whole multiple of setpoint_period_s = 0.01"),
        (["--workers", "0"], "--workers 0"),
    ],
)
def test_mistakes_of_the_command_line_get_one_clear_line(
    arguments: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["league", *arguments, "--out", str(tmp_path)]) != 0
    assert expected in capsys.readouterr().err


def test_an_output_directory_that_cannot_be_made_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    for command in ("league", "reproduce"):
        assert main([command, "--out", str(tmp_path / "file" / "out")]) == ExitCode.IO
        assert "cannot be written: Not a directory" in capsys.readouterr().err


def test_a_seed_or_a_law_that_is_named_twice_plays_once(tmp_path: Path) -> None:
    arguments = ["--laws", "pi,pi", "--plants", "paper", "--seeds", "1,1", "--setpoints", "75", "--dwell", "0.05"]
    assert main(["league", *arguments, "--out", str(tmp_path), "--workers", "1"]) == 0
    (row,) = json.loads((tmp_path / "league.json").read_text())["standings"]
    assert row["dwells"] == 1


def test_arguments_replace_the_settings_of_the_short_league(tmp_path: Path) -> None:
    arguments = ["--laws", "two-move", "--seeds", "7", "--dwell", "0.05", "--period", "0.0005"]
    assert main(["league", "--short", *arguments, "--out", str(tmp_path), "--workers", "1"]) == 0
    settings = json.loads((tmp_path / "league.json").read_text())["settings"]
    assert (settings["laws"], settings["seeds"], settings["period_s"]) == (["two-move"], [7], 0.0005)
    assert (settings["plants"], settings["dwell_s"]) == (["paper", "friction+20"], 0.05)
    assert len(settings["setpoints_mm"]) == 4


def test_every_plant_is_another_one_and_a_preset_of_the_emulator() -> None:
    plants = {replace(plant_settings(name), preset=None) for name in PLANTS}
    assert len(plants) == len(PLANTS)
    assert set(PLANTS) <= set(preset_names())


def test_friction_is_less_by_the_percentage_in_the_name() -> None:
    less = plant_settings("friction-10").valve
    for key in ("static_friction_n", "coulomb_friction_n", "viscous_friction_n_s_per_m"):
        assert getattr(less, key) == pytest.approx(0.9 * getattr(_NOMINAL.valve, key))


def test_a_league_without_the_nominal_plant_compares_on_the_first_and_names_it(tmp_path: Path) -> None:
    assert (reference_plant(PLANTS), reference_plant(("graphite", "spring-10"))) == (NOMINAL, "graphite")
    arguments = ["--laws", "pi", "--plants", "spring-10", "--seeds", "1", "--setpoints", "80,73", "--dwell", "0.05"]
    assert main(["league", *arguments, "--out", str(tmp_path), "--workers", "1"]) == 0
    assert "| law | spring-10, % |" in (tmp_path / "league.md").read_text(encoding="utf-8")


def test_setpoints_in_reach_go_where_the_real_valve_can_go_and_the_believed_one_cannot() -> None:
    for plant in ("paper", "spring-20", "friction+20"):
        check_setpoints(setpoints_in_reach(plant), (plant,))  # raises where one is not
    low_mm, high_mm = restartable_mm(_NOMINAL)
    beyond = [setpoint_mm for setpoint_mm in setpoints_in_reach("spring-20") if not low_mm < setpoint_mm < high_mm]
    assert len(beyond) >= 3
    assert max(beyond) > 112.0


@pytest.mark.slow(short="test_an_interrupted_league_plays_only_the_missing_bouts")
def test_after_a_restart_the_law_has_the_table_that_it_learned(tmp_path: Path) -> None:
    command = [
        "league",
        "--laws",
        "nmpc",
        "--plants",
        "friction-20",
        "--seeds",
        "1",
        "--setpoints",
        "reach",
        "--dwell",
        "0.3",
    ]
    assert main([*command, "--out", str(tmp_path / "first"), "--workers", "1"]) == 0
    assert main([*command, "--restart", "--out", str(tmp_path / "again"), "--workers", "1"]) == 0
    first, again = (json.loads((tmp_path / each / "league.json").read_text()) for each in ("first", "again"))
    assert first["settings"]["setpoints_mm"] is None
    assert (first["settings"]["restarted"], again["settings"]["restarted"]) == (False, True)
    assert first["standings"][0]["travel_ratio"] != again["standings"][0]["travel_ratio"]
