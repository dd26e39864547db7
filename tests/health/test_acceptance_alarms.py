"""The short form of `acceptance_alarms.py`: one run of friction that rises, and one that falls."""

from __future__ import annotations

import pytest
from acceptance_alarms import judged, play

from positioner.health.causes import AlarmCause


@pytest.mark.slow(short="test_the_runner_counts_what_is_missed_and_what_is_called_friction_wrongly")
@pytest.mark.parametrize(
    ("kind", "cause"),
    [
        ("friction +10 % in 100 moves", AlarmCause.FRICTION_HIGH),
        ("friction -10 % in 100 moves", AlarmCause.FRICTION_LOW),
    ],
)
def test_friction_that_drifts_is_told_soon_after_it_has_passed_20_percent(kind: str, cause: AlarmCause) -> None:
    outcome = play((kind, 7, 400))
    assert list(outcome.alarms) == [cause]
    assert outcome.crossed is not None
    assert -20 <= outcome.alarms[cause] - outcome.crossed <= 100


def test_the_runner_counts_what_is_missed_and_what_is_called_friction_wrongly() -> None:
    missed = play(("friction +10 % in 100 moves", 7, 30))
    assert missed.alarms == {}
    reached = {what: is_reached for what, _, _, is_reached in judged([missed])}
    assert reached["recall"] is False
    assert reached["moves from 20 % to the alarm"] is False
