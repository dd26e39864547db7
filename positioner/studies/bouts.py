"""Items of a study, spread over workers, each with its result in a file. Shell.

A study that was interrupted continues where it stopped. An item is computed again when its code has changed.
"""

from __future__ import annotations

import json
import re
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from tqdm import tqdm

from positioner.bench.metrics import DwellMetrics
from positioner.cycle.events import LawFellBack
from positioner.errors import writing
from positioner.laws.registry import is_outside
from positioner.studies.code_digest import code_digest, code_of_each
from positioner.studies.pool import spread_out

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from positioner.cycle.events import Event
    from positioner.studies.pool import Workers


class Playable(Protocol):
    """An item: what is played or computed, and the name of its result."""

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


def file_name(text: str) -> str:
    """Return `text` as a part of a file's name: names of laws and plants may be paths."""
    return re.sub(r"[^\w.+-]+", "-", text)[-100:]


def played(
    bouts: Sequence[B], play: Callable[[B], tuple[DwellMetrics, ...]], folder: Path, workers: Workers
) -> dict[B, tuple[DwellMetrics, ...]]:
    """Return the figures of every bout, in their order; one with a result of the same code is not played again.

    Raises:
        StateError: `folder` cannot be written.
    """
    found = computed(bouts, play, folder, workers, _as_json)
    return {bout: tuple(DwellMetrics(**dwell) for dwell in dwells) for bout, dwells in found.items()}


def _as_json(dwells: tuple[DwellMetrics, ...]) -> list[dict[str, Any]]:
    return [asdict(dwell) for dwell in dwells]


def law_failure(law: str, events: Iterable[Event]) -> str:
    """Return the first error that a law from outside raised in a run, empty where it raised none."""
    if not is_outside(law):
        return ""
    return next((each.why for each in events if isinstance(each, LawFellBack) and " failed: " in each.why), "")


def computed(
    items: Sequence[B],
    function: Callable[[B], Any],
    folder: Path,
    workers: Workers,
    as_json: Callable[[Any], Any] = lambda result: result,
) -> dict[B, Any]:
    """Return the result of every item as JSON has it, in their order; what the same code has stored is not repeated.

    Raises:
        StateError: `folder` cannot be written.
    """
    of_law = {law: code_digest(law) for law in {item.law for item in items}}
    code = dict(zip(items, code_of_each(items, of_law), strict=True))
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        return _resumed(items, function, folder, workers, as_json, code)


def _resumed(
    items: Sequence[B],
    function: Callable[[B], Any],
    folder: Path,
    workers: Workers,
    as_json: Callable[[Any], Any],
    code: Mapping[B, str],
) -> dict[B, Any]:
    found: dict[B, Any] = {}
    for item in items:
        known = _stored(folder / f"{item.key}.json", code[item])
        if known is not None:
            found[item] = known
    missing = [item for item in items if item not in found]
    with (
        tqdm(total=len(items), initial=len(found), unit=" bouts", disable=None) as bar,
        closing(spread_out(function, missing, workers)) as results,
    ):
        for item, result in results:
            found[item] = as_json(result)
            text = json.dumps({"code": code[item], "result": found[item]})
            (folder / f"{item.key}.json").write_text(text, encoding="utf-8")
            bar.set_postfix_str(item.title)
            bar.update()
    return {item: found[item] for item in items}


def _stored(path: Path, code: str) -> Any:
    try:
        stored: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return stored["result"] if stored["code"] == code else None
    except (OSError, ValueError, KeyError, TypeError):
        return None  # not computed yet, or cut off while it was written
