"""Bouts: runs of one law on one plant, spread over workers, each with its result in a file. Shell.

A study that was interrupted continues where it stopped. A bout is played again when its code has changed.
"""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from tqdm import tqdm

from positioner.bench.metrics import DwellMetrics
from positioner.errors import writing
from positioner.studies.code_digest import code_digest
from positioner.studies.pool import spread_out

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from positioner.studies.pool import Workers


class Playable(Protocol):
    """A bout: what is played, and the name of its result."""

    @property
    def law(self) -> str:
        """Name of the law."""

    @property
    def key(self) -> str:
        """Name of the result file; it changes with all that the result depends on, except the code."""

    @property
    def title(self) -> str:
        """What the progress bar shows."""


B = TypeVar("B", bound=Playable)


def played(
    bouts: Sequence[B], play: Callable[[B], tuple[DwellMetrics, ...]], folder: Path, workers: Workers
) -> dict[B, tuple[DwellMetrics, ...]]:
    """Return the figures of every bout, in their order; one with a result of the same code is not played again.

    Raises:
        StateError: `folder` cannot be written.
    """
    code = {law: code_digest(law) for law in {bout.law for bout in bouts}}
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        return _resumed(bouts, play, folder, code, workers)


def _resumed(
    bouts: Sequence[B],
    play: Callable[[B], tuple[DwellMetrics, ...]],
    folder: Path,
    code: dict[str, str],
    workers: Workers,
) -> dict[B, tuple[DwellMetrics, ...]]:
    found: dict[B, tuple[DwellMetrics, ...]] = {}
    for bout in bouts:
        known = _stored(folder / f"{bout.key}.json", code[bout.law])
        if known is not None:
            found[bout] = known
    missing = [bout for bout in bouts if bout not in found]
    with (
        tqdm(total=len(bouts), initial=len(found), unit=" bouts", disable=None) as bar,
        closing(spread_out(play, missing, workers)) as results,
    ):
        for bout, dwells in results:
            found[bout] = dwells
            _store(folder / f"{bout.key}.json", code[bout.law], dwells)
            bar.set_postfix_str(bout.title)
            bar.update()
    return {bout: found[bout] for bout in bouts}


def _stored(path: Path, code: str) -> tuple[DwellMetrics, ...] | None:
    try:
        stored: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if stored["code"] != code:
            return None
        return tuple(DwellMetrics(**dwell) for dwell in stored["dwells"])
    except (OSError, ValueError, KeyError, TypeError):
        return None  # not played yet, or cut off while it was written


def _store(path: Path, code: str, dwells: tuple[DwellMetrics, ...]) -> None:
    path.write_text(json.dumps({"code": code, "dwells": [asdict(dwell) for dwell in dwells]}), encoding="utf-8")
