"""The result file and its table for the terminal."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from positioner.bench.dwell_length import dwell_notes
from positioner.bench.inprocess import configure
from positioner.bench.metrics import DwellMetrics, totals
from positioner.bench.modes import ModeSpan
from positioner.bench.own_plant import with_plant
from positioner.bench.result import Result, RunInfo, TableSummary, blocks, installed_versions, summary_of, to_json
from positioner.bench.scenario import load_scenario, parse_scenario
from positioner.report.text import plain
from positioner.valve.stiction import Direction, Quantity, StictionTable
from positioner.wire.messages import Cause, Mode

DWELL = DwellMetrics(
    setpoint_mm=73.00000000000001,
    mean_abs_error_pct=0.0812345678,
    max_abs_error_pct=0.21,
    settle_1pct_s=0.0063,
    settle_2pct_s=None,
    overshoot_pct=0.0,
    reversals=2,
    limit_cycle=True,
    travel_mm=14.5,
    ideal_travel_mm=14.0,
    iae_mm_s=0.5,
    command_variation_ma=20.25,
)
SCENARIO = parse_scenario(
    "name='s'\ntitle='t'\nsetpoints_mm=[73]\nvisits=2\ndwell_s=1\n[plant.valve]\nx=0.123456789\n", "s.toml"
)
RUN = RunInfo(
    bus="virtual:bench",
    clock="lockstep",
    started_at="2025-01-01T00:00:00Z",
    wall_s=41.2,
    machine="x86_64",
    versions=installed_versions(),
)
MODES = (ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, 1.5), ModeSpan(Mode.HOLD, None, 1.5, 2.0))
DWELLS = (DWELL, replace(DWELL, setpoint_mm=87.0, limit_cycle=False, settle_1pct_s=None, iae_mm_s=123.25))


def text_of(shown: Result) -> str:
    return plain(blocks(shown))


def result(run: RunInfo = RUN) -> Result:
    return Result(
        scenario=SCENARIO,
        span_mm=127.0,
        modes=MODES,
        totals=totals(DWELLS),
        dwells=DWELLS,
        table_before=summary_of(StictionTable()),
        table_after=summary_of(StictionTable().record(Quantity.STICK_SPEED, 0.08, Direction.OPENING, 0.01)),
        run=run,
    )


def test_figures_have_six_significant_digits_and_no_negative_zero() -> None:
    text = to_json(replace(result(), dwells=(replace(DWELL, overshoot_pct=-0.0),)))
    dwell = json.loads(text)["dwells"][0]
    assert dwell["mean_abs_error_pct"] == 0.0812346
    assert dwell["setpoint_mm"] == 73.0
    assert "-0.0" not in text
    assert dwell["settle_2pct_s"] is None


def test_the_scenario_is_repeated_as_it_was_written() -> None:
    assert json.loads(to_json(result()))["scenario"]["plant"]["valve"]["x"] == 0.123456789


def test_only_the_run_object_depends_on_the_machine_and_the_hour() -> None:
    other = replace(RUN, bus="socketcan:can0", clock="real-time", started_at="2026-01-01T00:00:00Z", wall_s=1.0)
    one, two = to_json(result()), to_json(result(other))
    assert one != two
    assert one.split('"run":')[0] == two.split('"run":')[0]


def test_the_last_digits_of_a_figure_do_not_reach_the_file() -> None:
    shifted = replace(result(), dwells=(replace(DWELL, travel_mm=14.5 + 1e-12), DWELLS[1]))
    assert to_json(shifted) == to_json(result())
    visible = replace(result(), dwells=(replace(DWELL, travel_mm=14.501), DWELLS[1]))
    assert to_json(visible) != to_json(result())


def test_the_keys_stand_in_the_order_of_the_dataclasses() -> None:
    assert list(json.loads(to_json(result()))) == [
        "scenario", "span_mm", "modes", "totals", "dwells", "table_before", "table_after", "run", "notes",
        "active_fraction",
    ]  # fmt: skip


def test_modes_and_causes_stand_in_the_file_by_name_and_in_the_table_with_their_time() -> None:
    values = json.loads(to_json(result()))
    assert values["modes"] == [
        {"mode": "ACTIVE", "cause": "NONE", "begin_s": 0.0, "end_s": 1.5},
        {"mode": "HOLD", "cause": None, "begin_s": 1.5, "end_s": 2.0},
    ]
    assert values["active_fraction"] == 0.75
    lines = text_of(result()).splitlines()
    first = lines.index("modes    ACTIVE 75 % of the time")
    assert lines[first + 1].split() == ["1.500", "to", "2.000", "s", "HOLD:", "cause", "unknown"]


def test_a_figure_that_is_not_a_number_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_json(replace(result(), span_mm=float("nan")))


def test_the_versions_are_those_of_the_installed_packages() -> None:
    versions = json.loads(to_json(result()))["run"]["versions"]
    assert set(versions) == {"positioner", "python", "numpy", "osqp", "cantools", "python_can"}
    assert all(re.match(r"\d+\.\d+", number) for number in versions.values())


def test_the_summary_of_a_table_counts_cells_recorded_and_kept_samples() -> None:
    table = StictionTable()
    for _ in range(12):
        table = table.record(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.CLOSING, 9.0)
    table = table.record(Quantity.LANDING_BIAS, 0.08, Direction.OPENING, 0.0)
    expected = TableSummary(cells=2, recorded=13, stick_speeds=0, breakaway_currents=10, landing_biases=1)
    assert summary_of(table) == expected


def test_the_table_is_aligned_and_fits_a_hundred_columns() -> None:
    lines = text_of(result()).splitlines()
    first = next(index for index, line in enumerate(lines) if "setpoint" in line)
    table = lines[first : first + 6]
    assert len({len(line) for line in table}) == 1
    assert all(len(line) <= 100 for line in lines)
    # decimal points of the last three columns stand below each other
    points = {tuple(match.start() for match in re.finditer(r"\.", table[row]))[-3:] for row in (3, 4, 5)}
    assert len(points) == 1


def test_the_table_shows_which_dwells_settle_and_which_cycle() -> None:
    text = text_of(result())
    one, two = (line.split() for line in text.splitlines() if re.match(r"[12]\s+\d", line))
    assert one == ["1", "73.0", "0.08", "0.21", "6.3", "never", "0.00", "2", "yes", "14.50", "0.50", "20.2"]
    assert two == ["2", "87.0", "0.08", "0.21", "never", "never", "0.00", "2", "no", "14.50", "123.25", "20.2"]
    assert "settled  1 to 1 %, 0 to 2 %, of 2" in text
    assert "table    0 → 1 samples, 0 → 1 cells" in text
    assert "travel   1.04 times" in text


def test_a_run_without_moves_has_a_dash_for_its_travel_ratio() -> None:
    still = totals([replace(DWELL, ideal_travel_mm=0.0)])
    assert "travel   – times" in text_of(replace(result(), totals=still))


def noted(dwell_s: float, settled_s: tuple[float | None, ...], plant: str, **changes: Any) -> tuple[str, ...]:
    scenario = replace(with_plant(load_scenario("paper-valve"), plant), dwell_s=dwell_s, law="nmpc")
    dwells = [replace(DWELL, settle_1pct_s=each, ideal_travel_mm=14.0) for each in settled_s]
    return dwell_notes(replace(scenario, **changes), configure(scenario), dwells)


def test_a_dwell_that_is_too_short_for_the_valve_is_told_with_one_that_is_long_enough() -> None:
    own = str(Path(__file__).parents[2] / "examples" / "plant.toml")
    first, second = noted(0.8, (0.1, 0.7, None), own)
    assert first == (
        "0.8 s are too short for this valve: in 2 of 3 dwells the stem was outside of 1 % of span in its last 0.4 s, "
        "of which the error is the mean"
    )
    found = re.fullmatch(r"by its model .* take (\d\.\d) s: play it with --dwell (\d\.?\d?)", second)
    assert found
    needed_s, advised_s = map(float, found.groups())
    assert 0.8 < needed_s < 2.0
    assert (advised_s >= 1.6, advised_s >= needed_s, advised_s % 0.5) == (True, True, 0.0)
    told = noted(3.0, (0.1, None), own)
    assert told[0].startswith("in 1 of 2 dwells")
    assert told[1].endswith("the law still learns it; --dwell 6 shows which")


def test_nothing_is_said_of_dwells_in_which_the_stem_was_there_in_time_or_whose_setpoint_moves() -> None:
    assert noted(1.2, (0.1, 0.7), "paper") == ()
    assert noted(1.2, (None, None), "paper", edges_s=(0.0, 1.2, 2.4)) == ()
    assert noted(1.2, (None, None), "paper", law="pi") == ()  # it may never come there, however long it has
    (line,) = noted(1.2, (0.1, 0.8), "paper", law="pi")
    assert line.endswith("--dwell 2.5 shows the error at rest")


def test_the_notes_stand_in_the_text_and_in_the_file() -> None:
    shown = replace(result(), notes=("too short", "play longer"))
    assert "dwell    too short\n         play longer\n" in text_of(shown)
    assert json.loads(to_json(shown))["notes"] == ["too short", "play longer"]
    assert "dwell " not in text_of(result())
