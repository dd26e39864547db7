"""`positioner health` on a state directory and on a record; the numbers of both are the same."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from several_loop import SeveralLoop
from stem import REFERENCE

from positioner.cli.main import main
from positioner.health.alarms import Watched, dated, judged
from positioner.health.causes import LIMITS, AlarmCause
from positioner.health.counters import Counters, CounterSettings
from positioner.health.counters_report import as_values, histograms
from positioner.health.trends_document import trends_from, trends_in
from positioner.store import access

if TYPE_CHECKING:
    from pathlib import Path

    Output = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the state and the record of a run, and its configuration."""
    folder = tmp_path_factory.mktemp("run")
    with SeveralLoop(folder, ["FV-1"], record=folder / "bus.log") as loop:
        loop.run_to(2500)
    return folder


def values(run: Path, capsys: Output, *arguments: str) -> dict[str, object]:
    assert main(["health", "--config", str(run / "plant.toml"), "--json", *arguments]) == 0
    found = json.loads(capsys.readouterr().out)
    assert isinstance(found, dict)
    return found


def test_what_is_kept_is_what_the_record_gives_to_the_last_digit(run: Path, capsys: Output) -> None:
    kept, counted = values(run, capsys), values(run, capsys, "--from", str(run / "bus.log"))
    assert kept["counters"] == counted["counters"]
    assert kept["trends"] == counted["trends"]
    assert kept["valve"] == "FV-1"
    assert str(kept["started"]).endswith("Z")
    assert counted["started"] is None


def test_a_replay_and_a_recount_leave_the_kept_counters_as_they_are(run: Path, capsys: Output) -> None:
    before = values(run, capsys)
    assert main(["replay", str(run / "bus.log"), "--config", str(run / "plant.toml")]) == 0
    capsys.readouterr()
    values(run, capsys, "--from", str(run / "bus.log"))
    assert values(run, capsys) == before


def test_with_a_state_directory_a_record_goes_on_from_there(run: Path, capsys: Output) -> None:
    once = values(run, capsys)["counters"]
    assert isinstance(once, dict)
    state = str(run / "state")
    twice = values(run, capsys, "--from", str(run / "bus.log"), "--state", state)["counters"]
    assert isinstance(twice, dict)
    assert twice["observed_cycles"] == 2 * once["observed_cycles"]
    assert twice["starts"] == 2


def test_the_text_names_each_counter_and_draws_the_histograms(run: Path, capsys: Output) -> None:
    assert main(["health", "--config", str(run / "plant.toml")]) == 0
    text = capsys.readouterr().out
    assert text.startswith("FV-1: no alarm is active\ncounted since 20")
    for word in ("hours of operation", "ACTIVE", "cycles", "strokes", "failed pushes", "seconds"):
        assert word in text
    assert "  ####" in text


def test_the_report_shows_alarms_trend_histograms_and_counters_of_the_state_and_of_the_record(
    run: Path, tmp_path: Path, capsys: Output
) -> None:
    shown = []
    for more in ([], ["--from", str(run / "bus.log")]):
        page = tmp_path / "health.html"
        assert main(["health", "--config", str(run / "plant.toml"), "--report", str(page), *more]) == 0
        assert f"report: {page}" in capsys.readouterr().err
        text = page.read_text(encoding="utf-8")
        for title in ("Alarms", "Friction trend", "Histograms", "Counters"):
            assert f"{title} " in text or f"{title}<" in text
        shown.append([line for line in text.splitlines() if line.startswith(("<rect", "<div><dt>slips"))])
    assert len(shown[0]) > 40
    assert shown[0] == shown[1]
    missing = tmp_path / "nowhere" / "health.html"
    assert main(["health", "--config", str(run / "plant.toml"), "--report", str(missing)]) == 74
    assert capsys.readouterr().err == f"positioner: {missing}: cannot be written: No such file or directory\n"


def test_a_reset_asks_backs_up_and_begins_anew(run: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    reset = ["health", "--config", str(run / "plant.toml"), "--reset"]
    assert main(reset) == 74, "nobody to ask"
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda _question: "n")
    before = values(run, capsys)
    assert main(reset) == 0
    capsys.readouterr()
    assert values(run, capsys) == before
    assert main([*reset, "--yes"]) == 0
    assert "before-health-reset" in capsys.readouterr().out
    after = values(run, capsys)
    assert after["trends"] == before["trends"]
    counters = after["counters"]
    assert isinstance(counters, dict)
    assert (counters["slips"], counters["hours"]) == (0, 0.0)


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (["--reset", "--from", "x.log"], 2, "goes neither with"),
        (["--state", "elsewhere"], 74, "holds no health of a valve yet"),
        (["--from", "missing.log"], 74, "missing.log"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    tmp_path: Path,
    run: Path,
    capsys: Output,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    code: int,
    why: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere" / "FV-1").mkdir(parents=True)
    assert main(["health", "--config", str(run / "plant.toml"), *arguments]) == code
    error = capsys.readouterr().err
    assert why in error
    assert error.count("\n") == 1


def test_a_valve_that_has_done_nothing_can_be_shown() -> None:
    settings = CounterSettings(0.1, 0.0, 0.01, 0.0, 0.0005)
    assert as_values(settings, Counters())["stuck_share"] is None
    assert [rows for _, rows in histograms(Counters())] == [[], [], []]


def with_alarm(path: Path) -> None:
    """Put an alarm into the kept health, as a daemon leaves it."""
    document = access.health(path)
    watched = [Watched(AlarmCause.FRICTION_HIGH, 0.3, 0.01, "200 moves")]
    limits = {AlarmCause.FRICTION_HIGH: LIMITS[AlarmCause.FRICTION_HIGH]}
    alarms, _ = judged((), limits, watched, 0.0)
    alarms, _ = judged(alarms, limits, watched, 5.0)
    trends = trends_from(document.sections["trends"], REFERENCE)
    access.change_health(path, {"trends": trends_in(replace(trends, alarms=dated(alarms, "2026-11-22T10:00:00Z")))})


def test_an_alarm_is_shown_and_acknowledged_and_leaves_the_counters_as_they_are(run: Path, capsys: Output) -> None:
    config, before = ["health", "--config", str(run / "plant.toml")], values(run, capsys)
    with_alarm(run / "state" / "FV-1")
    assert main(config) == 1, "an alarm is active"
    text = capsys.readouterr().out
    assert "maintenance required: friction has risen: 30 %, limit 20, since 2026-11-22T10:00:00Z, not acknowl" in text
    assert "remedy: look at the packing" in text
    assert main([*config, "--acknowledge", "stuck"]) == 0
    assert "no such alarm waits" in capsys.readouterr().out
    assert main([*config, "--acknowledge", "all"]) == 0
    assert capsys.readouterr().out == "acknowledged: friction_high\n"
    assert main([*config, "--json"]) == 1
    after = json.loads(capsys.readouterr().out)
    assert [each["acknowledged"] for each in after["alarms"]] == [True]
    assert (after["counters"], after["started"]) == (before["counters"], before["started"])
    assert main([*config, "--acknowledge", "frction"]) == 2
    assert "no such alarm; one of all, friction_high" in capsys.readouterr().err
