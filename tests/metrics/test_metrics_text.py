"""The text of the metrics: what the official parsers read from it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from prometheus_client.openmetrics.parser import text_string_to_metric_families as read_openmetrics
from prometheus_client.parser import text_string_to_metric_families as read_prometheus

from positioner.config.reader import parse_config
from positioner.cycle.alarms import packed
from positioner.cycle.counters import Counters
from positioner.cycle.events import Controlled
from positioner.cycle.link import FeedbackState, LastSetpoint, LinkState
from positioner.cycle.plausibility import ReadingHistory
from positioner.cycle.sent import OutputState, SentCommand, SentCommands
from positioner.cycle.state import CycleState
from positioner.guard.state import GuardState
from positioner.health.counters import Counters as Kept
from positioner.health.monitor import begin_health
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision
from positioner.laws.move_reason import MoveReason
from positioner.metrics.exposition import text_of
from positioner.metrics.snapshot import snapshot_of
from positioner.shadow.differences import Differences
from positioner.valve.state import StemState
from positioner.wire.messages import Cause, Counted, Health, Mode

CONFIGURATION = parse_config('[valve]\nid = "FV-101"\npreset = "paper"\n', "test", Path())
Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def snapshot(state: CycleState, valve: str = "FV-101", kept: Kept | None = None) -> dict[str, Any]:
    """Return a snapshot as the metrics writer gets it."""
    health = begin_health(CONFIGURATION.health_settings, {})
    health.counting.counters = kept or Kept()
    made = snapshot_of(CONFIGURATION.valve, state, health if kept else None, 1.7e9) | {"valve": valve}
    told: dict[str, Any] = json.loads(json.dumps(made))
    return told


def compared() -> Differences:
    """Return the differences of three cycles, in two of which the shadow began a move: 0.05, -2 and 0.25 mA."""
    found, bounds = Differences(0), Bounds(-1.0, 1.0, 4.0, 20.0)
    reason, stem = MoveReason(1e-3, 12.0, 0.06), StemState(0.05, 0.0, True, 1.0)
    for number, (apart_ma, own, other) in enumerate(((0.05, None, reason), (-2.0, reason, reason), (0.25, None, None))):
        acting, shadow = (
            Controlled(0.0, 0.06, 0.05, stem, Decision(each_ma, bounds, reason=why), each_ma, Mode.ACTIVE, 0)
            for each_ma, why in ((12.0, own), (12.0 + apart_ma, other))
        )
        found.add(number, acting, shadow)
    return found


def test_a_law_in_the_shadow_is_told_where_there_is_one() -> None:
    assert not [name for name, _ in samples_of(text_of([snapshot(busy_state())], "1.2.3")) if "shadow" in name]
    made = snapshot_of(CONFIGURATION.valve, busy_state(), None, 1.7e9, compared())
    text = text_of([json.loads(json.dumps(made))], "1.2.3")
    found = samples_of(text)
    assert samples_of(text, read_prometheus) == found
    own = frozenset({("valve", "FV-101")})
    assert {name: value for (name, labels), value in found.items() if "shadow" in name and labels == own} == {
        "positioner_shadow_cycles_total": 3.0,
        "positioner_shadow_differing_cycles_total": 2.0,
        "positioner_shadow_mean_difference_amperes": pytest.approx(2.3e-3 / 3),
        "positioner_shadow_largest_difference_amperes": pytest.approx(-2e-3),
    }
    for law, moves in (("acting", 1.0), ("shadow", 2.0)):
        assert found["positioner_shadow_moves_total", own | {("law", law)}] == moves


def samples_of(text: str, read: Any = read_openmetrics) -> Samples:
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in read(text)
        for sample in family.samples
    }


def busy_state() -> CycleState:
    return CycleState(
        link=LinkState(
            feedback=FeedbackState(readings=ReadingHistory(position_m=0.06)),
            setpoint=LastSetpoint(0.062, 3),
            pressure_pa=150e3,
        ),
        guard=GuardState(mode=Mode.HOLD, cause=Cause.SETPOINT_STALE),
        output=OutputState(sent=SentCommands(newest=(SentCommand(7, 12.5),))),
        counters=Counters({Counted.LOST: 5}, refused_frames=2, fallbacks=3, learned=300),
        alarms=packed(Health.FAILURE, 1 << 12, 0),
    )


KEPT = Kept(travel_m=1.25, reversals=40, slips=17, mode_us=(0, 0, 2_500_000, 0, 0, 0), stuck_us=1_500_000)


def test_both_official_parsers_read_the_same_numbers() -> None:
    text = text_of([snapshot(busy_state(), kept=KEPT), snapshot(CycleState(), "FV-102")], "1.2.3")
    found = samples_of(text)
    assert samples_of(text, read_prometheus) == found
    own = frozenset({("valve", "FV-101")})
    expected = {
        "positioner_setpoint_meters": 0.062,
        "positioner_current_amperes": 0.0125,
        "positioner_pressure_pascals": 150e3,
        "positioner_span_meters": 0.127,
        "positioner_updated_timestamp_seconds": 1.7e9,
        "positioner_armed": 0.0,
        "positioner_refused_frames_total": 2.0,
        "positioner_fallbacks_total": 3.0,
        "positioner_learned_samples_total": 300.0,
        "positioner_travel_meters_total": 1.25,
        "positioner_reversals_total": 40.0,
        "positioner_slips_total": 17.0,
        "positioner_stuck_seconds_total": 1.5,
    }
    assert {name: found[name, own] for name in expected} == pytest.approx(expected)
    assert found["positioner_build_info", frozenset({("version", "1.2.3")})] == 1.0
    assert found["positioner_events_total", own | {("event", "lost")}] == 5.0
    assert found["positioner_mode_seconds_total", own | {("mode", "active")}] == pytest.approx(2.5)
    for name, label, value in (
        ("mode", "mode", "hold"),
        ("cause", "cause", "setpoint_stale"),
        ("health", "signal", "failure"),
        ("alarm", "alarm", "stuck"),
    ):
        ones = [labels for (key, labels), number in found.items() if key == f"positioner_{name}" and number == 1.0]
        assert own | {(label, value)} in ones
        assert len([labels for labels in ones if own <= labels]) == 1
    other = frozenset({("valve", "FV-102")})
    assert ("positioner_armed", other) in found
    assert ("positioner_setpoint_meters", other) not in found
    assert ("positioner_travel_meters_total", other) not in found


def test_every_family_has_a_help_and_each_unit_ends_its_name() -> None:
    read: Any = read_openmetrics
    families = list(read(text_of([snapshot(busy_state(), kept=KEPT)], "1")))
    assert len(families) > 25
    for family in families:
        assert family.documentation.endswith(".")
        assert family.type in {"gauge", "counter"}
        assert family.name.endswith(f"_{family.unit}" if family.unit else "")
    units = {family.unit for family in families}
    assert units == {"", "seconds", "meters", "ratio", "amperes", "pascals"}


@settings(max_examples=20)
@given(valve=st.text(st.characters(codec="utf-8", exclude_characters="\r"), max_size=20))
def test_any_name_of_a_valve_comes_back(valve: str) -> None:
    names = {dict(labels).get("valve") for _, labels in samples_of(text_of([snapshot(CycleState(), valve)], "1"))}
    assert names == {valve, None}


def test_without_a_valve_there_is_still_an_exposition() -> None:
    assert samples_of(text_of([], "1")) == {("positioner_build_info", frozenset({("version", "1")})): 1.0}
