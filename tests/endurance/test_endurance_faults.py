"""The short form of `make fault-test`: a law of each kind, a move of each, and proof that silence would be found."""

from __future__ import annotations

from dataclasses import replace

import pytest

from endurance import faulty_loop
from endurance.faults import Series, calm, late, report, trials
from endurance.faulty_loop import FAULTS
from positioner.cycle import deviation
from positioner.wire.messages import Cause


@pytest.mark.parametrize(("law", "sensor"), [("nmpc", "noisy"), ("pi", "noise-free"), ("two-move-retry", "noisy")])
def test_every_fault_is_reported_within_two_seconds(law: str, sensor: str) -> None:
    found = trials(Series(law, sensor, 1, 3))
    assert [trial.fault for trial in found] == [fault.name for fault in FAULTS]
    assert late(found) == [], "\n".join(report(found, []))
    causes = {trial.fault: trial.cause for trial in found}
    assert causes["frozen sensor"] is (Cause.FEEDBACK_FROZEN if sensor == "noisy" else Cause.DEVIATION)
    assert causes["doubled sensor, first loses 1 %"] is Cause.FEEDBACK_DISPUTED
    assert causes["stem stuck"] is Cause.DEVIATION


def test_without_the_deviation_they_would_be_silent_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faulty_loop, "FAULTS", FAULTS[-1:])
    monkeypatch.setattr("endurance.faults.FAULTS", FAULTS[-1:])
    monkeypatch.setattr(deviation, "PROGRESS_OF_LIMIT", 0.0)  # every reading is a step towards the setpoint
    found = trials(Series("pi", "noisy", 1, 3))
    assert [trial.fault for trial in late(found)] == ["stem stuck"]
    assert any(line.startswith("SILENT OR LATE") for line in report(found, []))


@pytest.mark.parametrize(
    ("law", "plant", "sensor"),
    [("nmpc", "stochastic", "held"), ("pi", "friction+20", "quantised"), ("knocker", "spring-20", "noise-free")],
)
def test_without_a_fault_nothing_is_reported(law: str, plant: str, sensor: str) -> None:
    run = calm((law, plant, sensor))
    assert (run.true, run.false) == ((), ())


def test_a_law_that_lands_elsewhere_deviates_truly() -> None:
    run = calm(("two-move", "spring-20", "noisy"))
    assert run.false == ()
    assert run.true
    assert all(line.startswith("DEVIATION") for line in run.true)
    lines = [*report([], [run, replace(run, true=(), false=("LAW_LATE at 1 s",))])]
    assert lines[0].startswith("true report: two-move on spring-20, noisy: DEVIATION")
    assert lines[-1] == "FALSE ALARM: two-move on spring-20, noisy: LAW_LATE at 1 s"
