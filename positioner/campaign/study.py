"""Plays a campaign, or any runs, on a pool of workers, and continues where it was interrupted. Shell."""

from __future__ import annotations

import hashlib
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from tqdm import tqdm

from positioner.campaign.check import check_points
from positioner.campaign.journal import Journal
from positioner.campaign.run import Outcome, PlayedRun, Run, outcome_of, play
from positioner.errors import writing
from positioner.store import lock
from positioner.studies.code_digest import code_digest, code_of_each
from positioner.studies.pool import EVERY_CORE, spread_out

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from _typeshed import DataclassInstance

    from positioner.campaign.plan import Campaign
    from positioner.studies.pool import Workers

JOURNAL = "runs.jsonl"


class Playable(Protocol):
    """What is played: a run with its law, a key of all that its outcome depends on except the code, and a name."""

    @property
    def law(self) -> str:
        """Name of the law."""

    @property
    def key(self) -> str:
        """The digest."""

    @property
    def label(self) -> str:
        """What the progress bar shows."""


R = TypeVar("R", bound=Playable)
Result = TypeVar("Result", bound="DataclassInstance")


def play_campaign(
    campaign: Campaign,
    folder: Path,
    workers: Workers = EVERY_CORE,
    function: Callable[[Run], Outcome] = play,
) -> list[PlayedRun]:
    """Return every run with its outcome, in the order of the campaign.

    A run whose outcome is in the journal of `folder`, of the same code, is not played again. `function` plays a run.

    Raises:
        ConfigurationError: some point cannot be played.
        AlreadyRunningError: another campaign writes into `folder`.
        StateError: `folder` cannot be written.
    """
    points = tqdm(campaign.points(), desc="checked", unit=" points", disable=None, delay=2.0, leave=False)
    check_points(campaign, points)
    every = list(campaign.runs())
    code = {law: code_of(law) for law in campaign.laws}
    outcomes = play_all(every, function, outcome_of, folder, workers, code)
    return [PlayedRun(run, outcome) for run, outcome in zip(every, outcomes, strict=True)]


def play_all(
    every: Sequence[R],
    function: Callable[[R], Result],
    outcome_of: Callable[[dict[str, Any]], Result],
    folder: Path,
    workers: Workers,
    code: Mapping[str, str],
) -> list[Result]:
    """Return the outcome of every run, in their order; runs with the same key are one.

    Args:
        every: the runs.
        function: plays a run; importable, as `studies.pool` asks.
        outcome_of: makes an outcome of its fields in a line of the journal.
        folder: holds the journal; a run whose outcome is there, of the same code, is not played again.
        workers: where the runs are played.
        code: by the law of a run, a digest of the code on which its outcome depends; that of a plant's own physics is
            added here.

    Raises:
        AlreadyRunningError: another study writes into `folder`.
        StateError: `folder` cannot be written.
    """
    keys = [run.key for run in every]
    runs = dict(zip(keys, every, strict=True))
    code_by_key = dict(zip(keys, code_of_each(every, code), strict=True))
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with lock.held(folder, timeout_s=0.0), Journal(folder / JOURNAL, outcome_of) as journal:
        kept = {key: journal.outcome(key, code_by_key[key]) for key in runs}
        outcomes = {key: outcome for key, outcome in kept.items() if outcome is not None}
        missing = [run for key, run in runs.items() if key not in outcomes]
        with (
            tqdm(total=len(runs), initial=len(outcomes), unit=" runs", disable=None) as bar,
            closing(spread_out(function, missing, workers)) as results,
        ):
            for run, outcome in results:
                key = run.key
                journal.add(key, code_by_key[key], outcome)
                outcomes[key] = outcome
                bar.set_postfix_str(run.label)
                bar.update()
    return [outcomes[key] for key in keys]


def code_of(law: str) -> str:
    """Return a digest of the code on which the outcome of a run of `law` depends."""
    own = Path(__file__).with_name("run.py").read_bytes()
    return hashlib.sha256(code_digest(law).encode() + own).hexdigest()
