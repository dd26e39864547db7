"""Plays the robustness test on a pool of workers, and continues where it was interrupted. Shell.

Baselines are kept: a change of the judged law leaves the digest of their code as it was (`studies.code_digest`).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.campaign.study import play_all
from positioner.errors import BenchError
from positioner.robustness.judgement import undecided, verdicts
from positioner.robustness.play import OPTIMAL, Dwell, Played, Run, play
from positioner.studies.code_digest import code_digest
from positioner.studies.pool import EVERY_CORE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.robustness.cases import Case
    from positioner.robustness.judgement import Verdict
    from positioner.studies.pool import Workers

OURS = "nmpc"
BASELINES = ("pi", "pi-deadband", "two-move-retry", "constant-reinforcement")


@dataclass(frozen=True, slots=True)
class Study:
    """Everything that was played: every dwell that is judged, and why some runs ended before their time."""

    laws: tuple[str, ...]
    verdicts: tuple[Verdict, ...]
    failures: tuple[tuple[str, str, str], ...]
    """Label of the case, law and reason."""

    @property
    def judged(self) -> str:
        """The law that is judged, the first one."""
        return self.laws[0]

    @property
    def baselines(self) -> tuple[str, ...]:
        """The laws that it is compared with."""
        return self.laws[1:]


def play_study(cases: Sequence[Case], laws: Sequence[str], folder: Path, workers: Workers = EVERY_CORE) -> Study:
    """Return the study of `laws` on `cases`; the first law is judged, the others are its baselines.

    `folder` holds a journal for the judged law, and one for each baseline.

    Raises:
        AlreadyRunningError: another study writes into `folder`.
        BenchError: no case could be played.
        StateError: `folder` cannot be written.
    """
    played: dict[str, dict[str, Played]] = {case.label: {} for case in cases}
    for law in dict.fromkeys((OPTIMAL, *laws[1:], laws[0])):
        runs = [Run(case, law) for case in cases]
        for run, outcome in zip(runs, _play(runs, law, folder, workers), strict=True):
            played[run.case.label][law] = outcome
    unsure = [Run(case, laws[0], informed=True) for case in cases if undecided(case, played[case.label])]
    outcomes = _play(unsure, laws[0], folder, workers)
    informed = {run.case.label: outcome for run, outcome in zip(unsure, outcomes, strict=True)}
    failures = tuple(
        (label, law, each.failure) for label, by_law in played.items() for law, each in by_law.items() if each.failure
    )
    judged = verdicts(cases, played, informed)
    if not judged:
        raise BenchError(f"no case could be played: {failures[0][2] if failures else 'there are none'}")
    return Study(tuple(laws), tuple(judged), failures)


def _play(runs: Sequence[Run], law: str, folder: Path, workers: Workers) -> list[Played]:
    return play_all(runs, play, played_of, folder / law.replace("/", "-"), workers, {law: code_of(law)}) if runs else []


def code_of(law: str) -> str:
    """Return a digest of the code on which the figures of `law` depend."""
    own = Path(__file__).with_name("play.py").read_bytes()
    return hashlib.sha256(code_digest("pi" if law == OPTIMAL else law).encode() + own).hexdigest()


def played_of(kept: dict[str, Any]) -> Played:
    """Return the figures in a line of the journal.

    Raises:
        TypeError: they are of a version with other figures.
    """
    return Played(tuple(Dwell(**each) for each in kept["dwells"]), tuple(kept["optimal_s"]), kept["failure"])
