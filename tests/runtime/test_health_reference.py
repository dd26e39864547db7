"""What the kept results of test procedures give to the health of a valve."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from virtual_shell import VirtualShell

from positioner.commissioning.results import keep, kept
from positioner.config.reader import parse_config
from positioner.health.counters_document import COUNTERS
from positioner.health.monitor import begin_health, sections_of
from positioner.health.trends_document import TRENDS
from positioner.runtime.health_reference import measured_health_settings
from positioner.store.health_document import HealthDocument, to_plain
from positioner.store.health_file import HEALTH, HealthFile
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.config.schema import Configuration


def configuration(folder: Path, days: float = 0.0) -> Configuration:
    text = (
        f'[valve]\nid = "FV-1"\npreset = "paper"\n[health]\nstroke_test_days = {days}\n[state]\ndirectory = "state"\n'
    )
    return parse_config(text, "fv1.toml", folder)


def identified(spring_n_per_m: float) -> dict[str, Any]:
    found = {"spring_rate_n_per_m": spring_n_per_m, "coulomb_friction_n": 1400.0, "static_friction_n": 1700.0}
    return {"valve": "FV-1", "configuration": {"valve": found}}


def step_test(t86_s: float) -> dict[str, Any]:
    return {"valve": "FV-1", "sizes": [{"size": 1.0, "direction": "up", "t86_s": {"median": t86_s}}]}


PASSED: dict[str, Any] = {"valve": "FV-1", "stop": None, "findings": [], "verdict": "passed"}


def test_the_first_kept_result_is_the_reference_until_the_user_names_another(tmp_path: Path) -> None:
    own, said = configuration(tmp_path), list[str]()
    assert measured_health_settings(own, said.append).watch.reference.source == "configuration"
    keep(own.state_directory, "identify", identified(5e4))
    keep(own.state_directory, "identify", identified(6e4))
    reference = measured_health_settings(own, said.append).watch.reference
    assert (reference.source, reference.spring_n_per_m) == ("identify", 5e4)
    instant = kept(own.state_directory, "identify")[0].recorded
    assert datetime.fromisoformat(reference.recorded) == instant, "two of one day are two references"
    keep(own.state_directory, "identify", identified(7e4), as_reference=True)
    assert measured_health_settings(own, said.append).watch.reference.spring_n_per_m == 7e4
    assert said == []


def test_the_newest_step_test_is_compared_with_the_first_and_the_newest_stroke_test_counts(tmp_path: Path) -> None:
    own = configuration(tmp_path, days=30.0)
    settings = measured_health_settings(own, pytest.fail).watch
    assert settings.response is None
    assert settings.stroke_test_due_s == 0.0, "none was ever made"
    for t86_s in (0.02, 0.01, 0.05):
        keep(own.state_directory, "step-test", step_test(t86_s))
    keep(own.state_directory, "stroke-test", {**PASSED, "verdict": "failed"})
    settings = measured_health_settings(own, pytest.fail).watch
    assert settings.response is not None
    assert settings.response.value == 2.5
    assert settings.stroke_test.value == 1.0
    assert settings.stroke_test_due_s == pytest.approx(30.0 * 86_400.0, abs=60.0)
    keep(own.state_directory, "stroke-test", PASSED)
    assert measured_health_settings(own, pytest.fail).watch.stroke_test.value == 0.0


def test_a_result_of_another_form_is_told_and_leaves_the_configured_valve(tmp_path: Path) -> None:
    own, said = configuration(tmp_path, days=30.0), list[str]()
    keep(own.state_directory, "stroke-test", {"valve": "FV-1"})
    assert measured_health_settings(own, said.append).watch.stroke_test.value == 0.0
    assert "has no document.verdict: not used" in said.pop()
    keep(own.state_directory, "signature", {"valve": "FV-1"})
    assert measured_health_settings(own, said.append, aside=True).watch.reference.source == "configuration"
    assert ["has no document.quantities: not used, moved aside to" in line for line in said] == [True, False]
    path = keep(own.state_directory, "signature", {"valve": "FV-1"})
    path.write_text(json.dumps({"format": "another"}))
    assert measured_health_settings(own, said.append).watch.reference.source == "configuration"
    assert said[2].startswith(f"{path} is damaged")


def test_a_reference_of_another_valve_or_another_travel_is_told_and_not_used(tmp_path: Path) -> None:
    own, said = configuration(tmp_path), list[str]()
    keep(own.state_directory, "identify", {**identified(5e4), "valve": "FV-2"})
    assert measured_health_settings(own, said.append).watch.reference.source == "configuration"
    assert said == [f"{own.state_directory}: identify of valve FV-2 is left out: this is FV-1"]
    said.clear()
    valve = own.valve
    travel_m = [valve.travel_min_m, valve.travel_max_m, valve.span_m]
    keep(own.state_directory, "identify", {**identified(6e4), "travel_m": [0.0, 0.03, 0.025]}, as_reference=True)
    assert measured_health_settings(own, said.append).watch.reference.source == "configuration"
    (line,) = [each for each in said if "FV-2" not in each]
    assert "a travel from 0 to 30 mm and a span of 25 mm: measure it again with --as-reference" in line
    keep(own.state_directory, "identify", {**identified(7e4), "travel_m": travel_m}, as_reference=True)
    assert measured_health_settings(own, said.append).watch.reference.spring_n_per_m == 7e4


def test_a_result_of_the_future_is_as_one_of_this_moment(tmp_path: Path) -> None:
    own = configuration(tmp_path, days=30.0)
    path = keep(own.state_directory, "stroke-test", PASSED)
    path.write_text(json.dumps({**json.loads(path.read_text()), "recorded": "2096-01-01T00:00:00Z"}))
    assert measured_health_settings(own, pytest.fail).watch.stroke_test_due_s == 30.0 * 86_400.0


def sections(slips: int, **changed: Any) -> dict[str, Any]:
    """Return sections as the health of a valve has them, with this count and with some counters changed."""
    with_none: Any = sections_of(begin_health(configuration_of_a_test().health_settings, {}))
    return {**with_none, COUNTERS: {**with_none[COUNTERS], "slips": slips, **changed}}


def trend(**changed: Any) -> dict[str, Any]:
    """Return sections with some values of the friction's trend changed."""
    section: dict[str, Any] = sections(7)[TRENDS]
    return {**sections(7), TRENDS: {**section, "friction": {**section["friction"], **changed}}}


def configuration_of_a_test() -> Configuration:
    return parse_config('[valve]\nid = "FV-101"\npreset = "paper"\n', "fv101.toml", Path())


IMPOSSIBLE: dict[str, dict[str, Any]] = {
    "a huge integer": {"sections": sections(10**400)},
    "a count beyond 2^63": {"sections": sections(1 << 63)},
    "a huge number": {"sections": sections(7, travel_m=1e300)},
    "no counters": {"sections": {COUNTERS: []}},
    "trends of another form": {"sections": {**sections(7), TRENDS: {"against": 3}}},
    "a friction that no move shows": {
        "sections": {**sections(7), TRENDS: trend(normal=[1e4, 0.0, 0.0, -1e4, 0.0, 1e4])}
    },
    "a breakaway beyond belief": {"sections": {**sections(7), TRENDS: trend(static_log=800.0)}},
    "sections that are none": {"sections": 3},
    "an odd date": {"started": 7},
    "an odd generation": {"generation": -(10**30)},
}


@pytest.mark.parametrize("change", IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_a_daemon_starts_from_the_good_copy_whatever_kept_files_with_a_right_digest_hold(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    state = tmp_path / "state"
    state.mkdir()
    good = HealthDocument("FV-101", "2026-05-09T07:35:25Z", sections=sections(41))
    file = HealthFile(state, "FV-101")
    file.save(good)
    file.save(good)
    odd = HealthDocument(**{"valve_id": "FV-101", "started": good.started, "sections": sections(42), **change})
    (state / HEALTH).write_text(json.dumps(to_plain(odd)))
    result = keep(state, "identify", {**identified(5e4), "valve": "FV-101"})
    whole = json.loads(result.read_text())
    odd_result = result.with_name("identify-20200101T000000Z.json")
    odd_result.write_text(json.dumps({**whole, "document": {"valve": "FV-101", "configuration": ["x"]}}))
    with VirtualShell(tmp_path) as shell:
        shell.arm()
        health = shell.session.health.state
        assert shell.session.state.guard.mode is Mode.ACTIVE
    assert health is not None
    assert health.counting.so_far.slips == 41
    assert len([line for line in shell.lines if line.startswith(f"{state / HEALTH} ")]) == 1
    (told,) = [line for line in shell.lines if line.startswith(f"{odd_result} ")]
    (aside,) = result.parent.glob("identify-20200101T000000Z.damaged-*.json")
    assert told.endswith(f"moved aside to {aside}")
    (aside,) = state.glob("health.damaged-*.json")
    assert json.loads(aside.read_text()) == to_plain(odd)
