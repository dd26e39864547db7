"""The signature of emulated valves: the plant's parameters are the truth."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from acceptance_signature import Case, run
from daemon_helpers import write_configuration
from slow_cases import slow

from plant_emulator.presets import plant_settings
from positioner.bus.address import BusAddress
from positioner.cli.main import main
from positioner.commissioning.identified import Interval
from positioner.commissioning.loop_branches import lagged
from positioner.commissioning.procedure import ProcedureLimits
from positioner.commissioning.readings import smooth
from positioner.commissioning.record import Kind
from positioner.commissioning.signature import SignatureError, signature
from positioner.commissioning.signature_limits import beyond_limits
from positioner.commissioning.signature_report import as_json, remarks
from positioner.commissioning.signature_stages import signature_experiment
from positioner.commissioning.stages import Stroke
from positioner.errors import ExitCode
from positioner.guard.settings import GuardSettings
from positioner.health.reference import reference_of
from positioner.health.settings import AlarmSettings, Category, HealthTable
from positioner.report.page import Status
from positioner.report.quantities import quantity_table
from positioner.report.signature_charts import signature_verdict
from positioner.studies.identified_plant import experiment_on
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.presets import PRESETS
from positioner.wire.messages import Health

if TYPE_CHECKING:
    from pathlib import Path

    from plant_emulator.parameters import PlantSettings
    from positioner.commissioning.signature import Signature

PERIOD_S = 0.004
LOW = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
HIGH = {"noise_of_reading": 0.02, "noise_of_span": 0.0}


def believed(preset: str) -> ValveParameters:
    keys: dict[str, Any] = dict(PRESETS["graphite" if preset == "seated" else preset])
    return ValveParameters(id="FV-101", **{**keys, "actuator": ActuatorParameters(**keys.get("actuator", {}))})


def limits_of(valve: ValveParameters) -> ProcedureLimits:
    return ProcedureLimits.of(valve, GuardSettings())


def measured(
    preset: str, sensor: dict[str, float], known: ValveParameters | None = None, seed: int = 5, **plant: Any
) -> tuple[Signature, PlantSettings]:
    settings = plant_settings(preset, {"sensor": sensor, **plant})
    valve = known or believed(preset)
    limits = limits_of(valve)
    memory, time_s = experiment_on(settings, signature_experiment(valve, limits, PERIOD_S), seed)
    assert not memory.aborted
    assert 60.0 < time_s < 240.0
    return signature(memory.stretches, valve, limits, PERIOD_S), settings


@cache
def well_measured(preset: str) -> tuple[Signature, PlantSettings]:
    return measured(preset, LOW)


@pytest.mark.parametrize("exact", [1.0, 5.0], ids=["0.05 % of span", "2 % of reading"])
@pytest.mark.parametrize("preset", ["paper", *slow("graphite", "seated")])
def test_it_shows_the_plant_s_parameters(preset: str, exact: float) -> None:
    found, settings = well_measured(preset) if exact == 1.0 else measured(preset, HIGH)
    truth = settings.valve
    assert found.spring_n_per_m.value == pytest.approx(truth.spring_rate_n_per_m, rel=0.002 * exact)
    assert found.sliding_n.value == pytest.approx(truth.coulomb_friction_n, rel=0.005 * exact)
    assert found.static_n.value == pytest.approx(truth.static_friction_n, rel=0.005 * exact)
    worst = max(abs(each.friction_n / truth.coulomb_friction_n - 1.0) for each in found.by_place)
    assert worst < 0.02 * exact
    hysteresis_m = 2.0 * truth.coulomb_friction_n / truth.spring_rate_n_per_m
    assert found.hysteresis_m == pytest.approx(hysteresis_m, rel=0.005 * exact)
    closed_n = found.preload_n.value
    open_n = closed_n + found.spring_n_per_m.value * truth.span_m
    upper_n = truth.bench_set_n + truth.spring_rate_n_per_m * truth.span_m
    assert open_n == pytest.approx(upper_n, rel=0.002 * exact)
    assert closed_n == pytest.approx(truth.bench_set_n, abs=0.005 * exact * upper_n)
    assert len(found.breakaways) >= 9


def test_the_error_band_is_that_of_the_loop_that_4_to_20_ma_drive() -> None:
    found, settings = well_measured("paper")
    truth, gain = settings.valve, 333.637
    low_m = (4.0 * gain + truth.coulomb_friction_n) / truth.spring_rate_n_per_m
    high_m = (20.0 * gain - truth.coulomb_friction_n) / truth.spring_rate_n_per_m
    # the stem stands at one end still while it already stands at the other: the whole loop, less its lag
    assert found.dynamic_error_band_m == pytest.approx(high_m - low_m, rel=0.02)
    assert found.reached_m[0] == pytest.approx(low_m, abs=2e-4)
    assert found.reached_m[1] == pytest.approx(high_m, abs=3e-4)


def test_stops_are_found_and_the_seat_load_is_preload_less_pressure() -> None:
    found, settings = well_measured("seated")
    truth, valve = settings.valve, believed("seated")
    assert found.closed_m == pytest.approx(0.0, abs=5e-5)
    assert math.isnan(found.open_m)
    assert found.seat_load_n == pytest.approx(truth.bench_set_n - 4.0 * valve.force_gain_n_per_ma, rel=0.03)
    graphite, _ = well_measured("graphite")
    assert graphite.open_m == pytest.approx(0.03, abs=5e-5)
    assert math.isnan(graphite.closed_m)
    assert math.isnan(graphite.seat_load_n), "no stroke met the closed stop"
    assert any("met the open stop, at 30.0" in line for line in remarks(graphite, believed("graphite")))


@pytest.mark.slow(short="test_a_lag_is_exact_and_a_mean_skips_lost_readings")
def test_a_lag_that_is_configured_or_a_pressure_that_is_measured_does_not_look_like_friction() -> None:
    lag = {"fill_time_constant_s": 0.1, "vent_time_constant_s": 0.1}
    told = replace(believed("paper"), actuator=ActuatorParameters(**lag))
    exact, settings = measured("paper", LOW, told, actuator=lag)
    blind, _ = measured("paper", LOW, actuator=lag)
    seen, _ = measured("paper", {**LOW, "reports_pressure": True}, actuator=lag)
    truth_n = settings.valve.coulomb_friction_n
    assert exact.sliding_n.value == pytest.approx(truth_n, rel=0.01)
    assert seen.sliding_n.value == pytest.approx(truth_n, rel=0.01)
    # 1 mA/s for 0.1 s
    assert blind.sliding_n.value == pytest.approx(truth_n + 0.1 * 333.637, rel=0.01)


@pytest.mark.slow(short="test_where_a_stem_sticks_again_and_again_quick_strokes_show_the_friction_by_place")
def test_friction_by_place_follows_the_friction_of_the_place() -> None:
    found, settings = measured(
        "friction-by-place", LOW, believed("paper"), packing={"place_fraction": 0.05, "direction_fraction": 0.0}
    )
    values = np.array([each.friction_n for each in found.by_place])
    assert values.std() > 0.02 * values.mean()
    other, _ = measured(
        "friction-by-place", LOW, believed("paper"), 9, packing={"place_fraction": 0.05, "direction_fraction": 0.0}
    )
    again = np.array([each.friction_n for each in other.by_place])
    assert settings.valve.coulomb_friction_n == pytest.approx(values.mean(), rel=0.2)
    assert np.corrcoef(values, again)[0, 1] > 0.95


def test_where_a_stem_sticks_again_and_again_quick_strokes_show_the_friction_by_place() -> None:
    _, errors, _ = run(Case("stochastic", 240))
    assert errors["correlation"] > 0.9
    valve = believed("graphite")
    stages = signature_experiment(valve, limits_of(valve), PERIOD_S).stages
    # strong damping: a quick stroke would show viscous friction only
    assert len({each.rate_ma_per_s for each in stages if isinstance(each, Stroke) and each.records}) == 1


@pytest.mark.slow(short="test_the_error_band_is_that_of_the_loop_that_4_to_20_ma_drive")
def test_the_error_band_contains_the_lag_and_the_friction_does_not() -> None:
    # 100 ms of lag make the band 1.3 mm of 10 mm wider; over the pressure it would be missing
    _, errors, _ = run(Case("graphite", 210))
    assert abs(errors["dynamic error band"]) < 1.0
    assert abs(errors["sliding friction"]) < 1.0


def test_a_valve_that_does_not_move_shows_no_signature() -> None:
    valve = believed("paper")
    limits = limits_of(valve)
    settings = plant_settings("paper", {"sensor": LOW})
    memory, _ = experiment_on(settings, signature_experiment(valve, limits, PERIOD_S), 1)
    short = [each for each in memory.stretches if each.kind is not Kind.STROKE or each.direction > 0.0]
    with pytest.raises(SignatureError, match=r"over 0 bins of 5 mm only"):
        signature(short, valve, limits, PERIOD_S)


def test_what_the_strokes_did_not_show_has_no_value_and_what_lies_beyond_them_is_extrapolated() -> None:
    found, valve = well_measured("paper")[0], believed("paper")
    document = as_json(found, valve, "bar")
    told = {row["name"]: row for row in document["rows"]}
    assert told["seat load"] == {
        "name": "seat load",
        "unit": "N",
        "value": None,
        "low": None,
        "high": None,
        "seen": False,
        "note": "",
    }
    cells = {row[0]: row[2:] for row in quantity_table(document["rows"]).rows}
    assert cells["seat load"] == ("–", "not measured")
    ends = [told[f"bench set, at {part} %"] for part in (0, 100)]
    assert [each["note"] for each in ends] == ["extrapolated"] * 2, "it slid over 52 to 100 mm of 0 to 127"
    assert ends[1]["low"] <= 1.0343 <= ends[1]["high"], "52538 N/m times 127 mm over 645.2 cm²"
    assert f"{cells['bench set, at 100 % (extrapolated)'][0]}" == "1.034"
    reached = replace(found, reached_m=(-1e-4, 0.127), closed_m=0.0, seat_load_n=310.0)
    rows = {row["name"]: row for row in as_json(reached, valve, "bar")["rows"]}
    assert [rows[f"bench set, at {part} %"]["note"] for part in (0, 100)] == ["", ""]
    assert rows["seat load"]["value"] == 310.0
    assert json.dumps(document, allow_nan=False)


def test_a_static_friction_that_no_breakaway_has_shown_is_neither_told_nor_compared() -> None:
    valve, (found, _) = believed("paper"), well_measured("paper")
    blind = replace(found, static_n=Interval(9e9, 9e9, 9e9, seen=False), breakaways=())
    document = as_json(blind, valve, "bar")
    assert document["quantities"]["static_n"] is None
    assert {row[0]: row[2:] for row in quantity_table(document["rows"]).rows}["static friction"] == (
        "–",
        "not measured",
    )
    health, span_m = HealthTable(), valve.span_m
    assert beyond_limits(blind, as_json(found, valve, "bar"), health, span_m) == ()
    assert beyond_limits(found, document, health, span_m) == ()
    reference = reference_of(valve, signature=("2026-01-01T00:00:00Z", document))
    assert reference.static_n == valve.static_friction_n, "as configured"


def test_a_change_since_the_reference_is_told() -> None:
    valve = believed("paper")
    before, _ = well_measured("paper")
    after, _ = measured("paper", LOW, valve={"coulomb_friction_n": 1.2 * 1423.0, "static_friction_n": 1.2 * 1707.7})
    table = quantity_table(as_json(after, valve, "bar")["rows"], as_json(before, valve, "psi")["rows"])
    changes = {cells[:2]: cells[-1] for cells in table.rows}
    assert changes["sliding friction", "N"] == changes["static friction", "N"] == "+20.0\N{NARROW NO-BREAK SPACE}%"
    assert changes["bench set, at 100 % (extrapolated)", "bar"] == "–", "the reference has it in another unit"


def test_a_reference_that_is_none_is_refused_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_configuration(tmp_path, BusAddress(interface="virtual", channel="none"))
    (tmp_path / "bad.json").write_text("{}", encoding="utf-8")
    arguments = ["signature", "--config", str(path), "--yes", "--reference", str(tmp_path / "bad.json")]
    assert main(arguments) == ExitCode.USAGE
    assert "is no signature" in capsys.readouterr().err


def test_a_lag_is_exact_and_a_mean_skips_lost_readings() -> None:
    step = np.r_[0.0, np.ones(20)]
    assert lagged(step, 0.1, 0.1, 0.01)[10] == pytest.approx(1.0 - math.exp(-1.0), rel=1e-9)
    assert smooth(np.array([1.0, math.nan, 3.0]), 3).tolist() == [1.0, 2.0, 3.0]


def test_a_change_beyond_its_limit_is_told_with_its_category_and_remedy() -> None:
    valve, health = believed("paper"), HealthTable()
    before, _ = well_measured("paper")
    reference = json.loads(json.dumps(as_json(before, valve, "bar")))

    def told(health: HealthTable = health, **changes: float) -> list[tuple[str, Health]]:
        values: dict[str, Any] = {name: Interval(value, value, value) for name, value in changes.items()}
        found = beyond_limits(replace(before, **values), reference, health, valve.span_m)
        return [(each.cause.key, each.category) for each in found]

    assert told() == []
    assert told(sliding_n=1.19 * before.sliding_n.value) == []
    assert told(sliding_n=1.21 * before.sliding_n.value) == [("friction_high", Health.MAINTENANCE_REQUIRED)]
    assert told(static_n=0.55 * before.static_n.value) == [("friction_low", Health.OUT_OF_SPECIFICATION)]
    assert told(spring_n_per_m=0.9 * before.spring_n_per_m.value + 1.0) == [
        ("spring_rate", Health.MAINTENANCE_REQUIRED)
    ]
    shift_n = 0.051 * before.spring_n_per_m.value * valve.span_m
    assert told(preload_n=before.preload_n.value - shift_n) == [("spring_force", Health.MAINTENANCE_REQUIRED)]
    wide = HealthTable(friction_high=AlarmSettings(limit=0.3), spring_rate=AlarmSettings(category=Category.OFF))
    assert told(wide, sliding_n=1.29 * before.sliding_n.value, spring_n_per_m=50_000.0) == []
    (one,) = beyond_limits(replace(before, sliding_n=Interval(1800.0, 1800.0, 1800.0)), reference, health, valve.span_m)
    assert str(one).startswith("friction has risen: +26.5 %, limit 20 %: look at the packing")


def test_the_page_judges_a_signature_by_its_limits_and_the_first_one_not_at_all() -> None:
    assert signature_verdict({"compared": False, "beyond_limits": []}) is None
    good = signature_verdict({"compared": True, "beyond_limits": []})
    text = "friction has risen: +26.5 %, limit 20 %: look at the packing"
    one = {"category": "maintenance_required", "text": text}
    risen = signature_verdict({"compared": True, "beyond_limits": [one]})
    worse = signature_verdict({"compared": True, "beyond_limits": [one, {**one, "category": "out_of_specification"}]})
    statuses = [each.status for each in (good, risen, worse) if each is not None]
    assert statuses == [Status.GOOD, Status.MAINTENANCE_REQUIRED, Status.OUT_OF_SPECIFICATION]
    assert risen is not None
    assert risen.sentence == "Since the reference: friction has risen: +26.5 %, limit 20 %."
    assert risen.action == "Look at the packing."
