"""Plays a campaign on a pool of workers, and continues where it was interrupted. Shell."""

from __future__ import annotations

import hashlib
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.campaign.check import check_points
from positioner.campaign.journal import Journal
from positioner.campaign.run import Outcome, PlayedRun, Run, play
from positioner.errors import writing
from positioner.store import lock
from positioner.studies.code_digest import code_digest
from positioner.studies.pool import EVERY_CORE, spread_out

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.campaign.plan import Campaign
    from positioner.studies.pool import Workers

JOURNAL = "runs.jsonl"


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
    code = {law: code_of(law) for law in campaign.laws}
    every = [(run.key, run) for run in campaign.runs()]
    runs = dict(every)  # points that differ in nothing are one run
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with lock.held(folder, timeout_s=0.0), Journal(folder / JOURNAL) as journal:
        kept = {key: journal.outcome(key, code[run.law]) for key, run in runs.items()}
        outcomes = {key: outcome for key, outcome in kept.items() if outcome is not None}
        missing = [run for key, run in runs.items() if key not in outcomes]
        with (
            tqdm(total=len(runs), initial=len(outcomes), unit=" runs", disable=None) as bar,
            closing(spread_out(function, missing, workers)) as results,
        ):
            for run, outcome in results:
                key = run.key
                journal.add(key, code[run.law], outcome)
                outcomes[key] = outcome
                bar.set_postfix_str(f"{run.law} at point {run.point}")
                bar.update()
    return [PlayedRun(run, outcomes[key]) for key, run in every]


def code_of(law: str) -> str:
    """Return a digest of the code on which the outcome of a run of `law` depends."""
    own = Path(__file__).with_name("run.py").read_bytes()
    return hashlib.sha256(code_digest(law).encode() + own).hexdigest()
