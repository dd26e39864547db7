"""What the kept results of test procedures give to the health of a valve."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from positioner.commissioning.results import FOLDER, keep
from positioner.config.reader import parse_config
from positioner.runtime.health_reference import measured_health_settings

if TYPE_CHECKING:
    from pathlib import Path

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
    assert "is not as expected" in said.pop()
    keep(own.state_directory, "signature", {"valve": "FV-1"})
    assert measured_health_settings(own, said.append).watch.reference.source == "configuration"
    assert len(said) == 1
    assert "is not as expected" in said[0]
    path = next((own.state_directory / FOLDER).glob("signature-*.json"))
    path.write_text(json.dumps({"format": "another"}))
    assert measured_health_settings(own, said.append).watch.reference.source == "configuration"
    assert "is no kept result" in said[1]


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
