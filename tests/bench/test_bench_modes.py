"""Modes of a bench run, from its frames: cause and duration; a run without control is no success."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import own_address
from hypothesis import given
from hypothesis import strategies as st

from positioner.bench import runner
from positioner.bench.modes import ModeReport, ModeSpan, active_fraction, complaint, mode_lines, mode_spans
from positioner.bench.recording import Recording
from positioner.cli.main import main
from positioner.errors import ExitCode
from positioner.wire.codec import make_codec
from positioner.wire.messages import Cause, CurrentCommand, Health, Mode, PlantTruth, PositionerStatus

if TYPE_CHECKING:
    from pathlib import Path

CODEC = make_codec()
FAILS_SAFE = """
name = "hasty"
title = "the guard waits for a setpoint for less than the host's period"
sample_period_s = 0.001
setpoints_mm = [73.0]
dwell_s = 0.4
guard = { setpoint_hold_s = 0.004, setpoint_failsafe_s = 0.008 }
"""


def spans(
    *mode_reports: ModeReport, duration_s: float = 10.0, silent_after_s: float = 100.0
) -> list[tuple[object, ...]]:
    return [
        (span.mode, span.cause, pytest.approx(span.begin_s), pytest.approx(span.end_s))
        for span in mode_spans(mode_reports, duration_s, silent_after_s)
    ]


def test_a_mode_lasts_until_the_next_and_a_status_gives_its_cause_from_its_beginning() -> None:
    assert spans(
        ModeReport(0.0, Mode.ACTIVE),
        ModeReport(0.1, Mode.ACTIVE, Cause.NONE),
        ModeReport(2.0, Mode.HOLD),
        ModeReport(2.5, Mode.FAILSAFE),
        ModeReport(2.6, Mode.FAILSAFE, Cause.FEEDBACK_STALE),
        ModeReport(9.0, Mode.FAILSAFE),
    ) == [
        (Mode.ACTIVE, Cause.NONE, 0.0, 2.0),
        (Mode.HOLD, None, 2.0, 2.5),
        (Mode.FAILSAFE, Cause.FEEDBACK_STALE, 2.5, 10.0),
    ]


def test_a_cause_that_changes_within_a_mode_begins_a_span() -> None:
    assert spans(ModeReport(0.0, Mode.ACTIVE, Cause.NONE), ModeReport(4.0, Mode.ACTIVE, Cause.LAW_LATE)) == [
        (Mode.ACTIVE, Cause.NONE, 0.0, 4.0),
        (Mode.ACTIVE, Cause.LAW_LATE, 4.0, 10.0),
    ]


def test_before_the_first_frame_the_mode_is_init_and_a_disarmed_positioner_is_not_silent() -> None:
    assert spans(
        ModeReport(1.0, Mode.ACTIVE),
        ModeReport(2.0, Mode.READY, Cause.DISARMED),
        ModeReport(9.9, Mode.ACTIVE),
        silent_after_s=3.0,
    ) == [
        (Mode.INIT, None, 0.0, 1.0),
        (Mode.ACTIVE, Cause.NONE, 1.0, 2.0),
        (Mode.READY, Cause.DISARMED, 2.0, 9.9),
        (Mode.ACTIVE, Cause.NONE, 9.9, 10.0),
    ]


def test_a_positioner_that_sends_no_commands_is_silent_whatever_its_last_mode() -> None:
    assert spans(ModeReport(0.0, Mode.ACTIVE), ModeReport(5.0, Mode.ACTIVE), silent_after_s=0.1) == [
        (Mode.ACTIVE, Cause.NONE, 0.0, 0.1),
        (None, None, 0.1, 5.0),
        (Mode.ACTIVE, Cause.NONE, 5.0, 5.1),
        (None, None, 5.1, 10.0),
    ]


@given(
    st.lists(
        st.builds(
            ModeReport,
            st.floats(-1.0, 12.0),
            st.sampled_from(Mode),
            st.none() | st.sampled_from([Cause.NONE, Cause.FEEDBACK_STALE]),
        )
    ),
    st.floats(0.01, 20.0),
)
def test_the_spans_cover_the_run_without_gaps_whatever_was_reported(
    mode_reports: list[ModeReport], silent_after_s: float
) -> None:
    found = mode_spans(mode_reports, 10.0, silent_after_s)
    assert (found[0].begin_s, found[-1].end_s) == (0.0, 10.0)
    assert all(one.end_s == other.begin_s for one, other in pairwise(found))
    assert all(span.duration_s > 0.0 for span in found)
    assert 0.0 <= active_fraction(found) <= 1.0 + 1e-12


def test_a_recording_takes_the_mode_from_commands_and_the_cause_from_statuses() -> None:
    recording = Recording(CODEC, 300, 0.001, 10, lockstep=True)
    for counter in range(300):
        mode = Mode.ACTIVE if counter < 150 else Mode.FAILSAFE
        recording.add(CODEC.encode(PlantTruth(0.08, 0.0), counter), 0.0)
        recording.add(CODEC.encode(CurrentCommand(12.0, position_counter=counter % 256, mode=mode), counter), 0.0)
        if counter % 100 == 0:
            cause = Cause.NONE if mode is Mode.ACTIVE else Cause.LAW_FAILED
            status = PositionerStatus(mode, cause, Health.GOOD, True, True, 0, 0, 0)
            recording.add(CODEC.encode(status, counter // 100), 0.0)
    assert spans(*recording.mode_reports, duration_s=0.3) == [
        (Mode.ACTIVE, Cause.NONE, 0.0, 0.15),
        (Mode.FAILSAFE, Cause.LAW_FAILED, 0.15, 0.3),
    ]


THROUGHOUT = (ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, 10.0),)
FAILED = (
    ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, 0.243),
    ModeSpan(Mode.HOLD, None, 0.243, 0.25),
    ModeSpan(Mode.FAILSAFE, Cause.FEEDBACK_STALE, 0.25, 10.0),
)


def test_the_lines_give_mode_cause_and_time() -> None:
    assert mode_lines(THROUGHOUT) == ("ACTIVE 100 % of the time",)
    assert mode_lines(FAILED) == (
        "ACTIVE 2.43 % of the time",
        "    0.243 to 0.250 s  HOLD: cause unknown",
        "    0.250 to 10.000 s  FAILSAFE: feedback stale",
    )
    many = tuple(ModeSpan((Mode.ACTIVE, Mode.HOLD)[n % 2], Cause.SETPOINT_STALE, n, n + 1.0) for n in range(40))
    assert mode_lines(many)[-1] == "and 28 more: see result.json"


def test_a_run_with_less_than_99_percent_active_gets_one_line_with_mode_cause_instant_and_what_to_do() -> None:
    assert complaint(FAILED, "out/positioner.log") == (
        "ACTIVE for 2.43 % of the run: below 99 % its figures are not the law's; FAILSAFE (feedback stale) for "
        "9.750 s, first at 0.250 s; this machine was too slow for this period: free a processor, or choose a longer "
        "sample_period_s; see out/positioner.log"
    )


@pytest.mark.parametrize(("lost_s", "complains"), [(0.0, False), (0.09, False), (0.11, True), (10.0, True)])
def test_one_percent_without_control_is_the_limit(lost_s: float, complains: bool) -> None:
    edges = [ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, 10.0 - lost_s), ModeSpan(None, None, 10.0 - lost_s, 10.0)]
    line = complaint([span for span in edges if span.duration_s > 0.0], "log")
    assert (line is not None) == complains
    assert line is None or "SILENT" in line


def test_less_than_the_whole_run_is_never_100_percent() -> None:
    nearly = (ModeSpan(Mode.HOLD, Cause.NONE, 0.0, 1e-6), ModeSpan(Mode.ACTIVE, Cause.NONE, 1e-6, 10.0))
    assert mode_lines(nearly)[0] == "ACTIVE 99.99 % of the time"


@pytest.mark.bus
def test_a_bench_that_fails_safe_shows_it_everywhere_and_ends_with_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    monkeypatch.setattr(runner, "draw_trend", lambda _path, data: drawn.append(data))
    monkeypatch.setattr(runner, "draw_moves", lambda *_arguments: None)
    scenario, out = tmp_path / "scenario.toml", tmp_path / "out"
    scenario.write_text(FAILS_SAFE, encoding="utf-8")
    command = ["bench", "--scenario", str(scenario), "--bus", str(own_address()), "--out", str(out)]
    assert main(command) == ExitCode.FAILURE
    printed = capsys.readouterr()
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert result["modes"][-1]["mode"] == "FAILSAFE"
    assert result["modes"][-1]["cause"] == "SETPOINT_STALE"
    assert result["active_fraction"] < 0.1
    assert "FAILSAFE: setpoint stale" in printed.out
    assert printed.err.splitlines()[-1].startswith("positioner: ACTIVE for ")
    assert "FAILSAFE (setpoint stale)" in printed.err.splitlines()[-1]
    assert "let it be longer than setpoint_period_s" in printed.err.splitlines()[-1]
    assert drawn[0].modes[-1].mode is Mode.FAILSAFE
    # the same run with the usual timeouts is in control from its first sample to its last
    scenario.write_text(
        FAILS_SAFE.replace("setpoint_hold_s = 0.004, setpoint_failsafe_s = 0.008", ""), encoding="utf-8"
    )
    assert main(command) == ExitCode.OK
    assert "modes    ACTIVE 100 % of the time\n" in capsys.readouterr().out
    assert drawn[1].modes == (ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, 0.4),)


@pytest.mark.bus
def test_a_bench_that_nothing_arms_draws_its_picture_and_gives_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario, out = tmp_path / "scenario.toml", tmp_path / "out"
    scenario.write_text(
        FAILS_SAFE.replace("setpoint_hold_s = 0.004, setpoint_failsafe_s = 0.008", "auto_arm = false"), encoding="utf-8"
    )
    command = ["bench", "--scenario", str(scenario), "--clock", "realtime", "--bus", str(own_address())]
    assert main([*command, "--out", str(out)]) == ExitCode.FAILURE
    printed = capsys.readouterr()
    assert "ACTIVE for 0 % of the run" in printed.err
    assert "nothing armed it: do not set guard.auto_arm to false" in printed.err
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert [dwell["command_variation_ma"] for dwell in result["dwells"]] == [0.0] * len(result["dwells"])
    assert (out / "trend.png").stat().st_size > 10_000
