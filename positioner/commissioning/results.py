"""Kept results: each finished test procedure leaves its `--json` document in the valve's state directory. Shell.

One file each, `results/KIND-DATE.json`, with its number in the sequence of its kind, the date, the versions and the
valve. The sequence orders them, since a wall clock may be stepped; files of earlier versions have no number, and stand
before all others, by their dates. The first of a kind is the reference, until the user names another:
`results/reference-KIND.json` holds its file name.
"""

from __future__ import annotations

import importlib.metadata
import platform
import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any

import positioner
from positioner.commissioning.kept_documents import check_document
from positioner.errors import StateError, in_one_line
from positioner.machine import kept_files
from positioner.machine.build import is_compiled

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

FOLDER = "results"
_FORMAT, _SCHEMA = "positioner-result", 1
_KIND = re.compile(r"[a-z][a-z0-9]*(-[a-z][a-z0-9]*)*")
_LAST = 1 << 53
"""Of the sequence: the largest integer that every JSON reader holds."""
_NAME_TIME, _TIME = "%Y%m%dT%H%M%SZ", "%Y-%m-%dT%H:%M:%SZ"


@dataclass(frozen=True, slots=True)
class KeptResult:
    """The document of a finished procedure; `recorded` is its date in UTC, `versions` by program.

    sequence: its number among those of its kind, from 1 on; 0 in a file of an earlier version.
    """

    kind: str
    name: str
    valve: str
    recorded: datetime
    versions: dict[str, str]
    document: dict[str, Any]
    sequence: int = 0


def new_result(kind: str, document: dict[str, Any]) -> KeptResult:
    """Return a result of this moment that is not kept; `document["valve"]` names the valve."""
    return KeptResult(_checked(kind), "", str(document["valve"]), datetime.now(UTC), versions(), document)


def keep(directory: Path, kind: str, document: dict[str, Any], *, as_reference: bool = False) -> Path:
    """Keep the document of a procedure in the state directory, and return its file.

    `document["valve"]` names the valve. With `as_reference` later results are compared with this one.

    Raises:
        StateError: it cannot be written.
    """
    made = new_result(kind, document)
    whole = {
        "format": _FORMAT,
        "schema": _SCHEMA,
        "kind": made.kind,
        "sequence": 0,
        "valve": made.valve,
        "recorded": made.recorded.strftime(_TIME),
        "versions": made.versions,
        "document": document,
    }
    with kept_files.writable(directory, FOLDER, "the result") as folder:
        before = kept_files.used(folder, _names(folder, kind), partial(_result, kind), lambda _name, _error: None)
        whole["sequence"] = 1 + max((each.sequence for each in before), default=0)
        name = kept_files.free_name(folder, f"{kind}-{made.recorded.strftime(_NAME_TIME)}")
        kept_files.write(folder, name, whole)
        if as_reference:
            kept_files.write(folder, f"reference-{kind}.json", {"file": name})
    return directory / FOLDER / name


def check_writable(directory: Path) -> None:
    """Do nothing where results can be kept in the state directory; look before a valve moves.

    Raises:
        StateError: they cannot.
    """
    with kept_files.writable(directory, FOLDER, "the result") as folder:
        kept_files.check_writable(folder)


def kept(
    directory: Path, kind: str, report: Callable[[str], object] | None = None, *, aside: bool = False
) -> tuple[KeptResult, ...]:
    """Return the kept results of a kind, the newest last; `report` gets a line for each file that is none.

    With `aside`, for who holds the directory, such a file is moved aside.

    Raises:
        StateError: the directory cannot be read.
    """
    rejected: list[tuple[str, Exception]] = []
    take, reject = partial(_result, _checked(kind)), _gathered(rejected)
    try:
        with kept_files.opened(directory, FOLDER) as folder:
            found = tuple(kept_files.used(folder, _names(folder, kind), take, reject))
    except FileNotFoundError:
        return ()
    except OSError as error:
        message = f"{directory / FOLDER}: cannot be read: {error.strerror}; become the owner of the directory"
        raise StateError(message) from error
    _report(directory, rejected, report or _to_stderr, aside=aside)
    return tuple(sorted(found, key=_order))


def kept_of(
    directory: Path, kind: str, valve: str, report: Callable[[str], object] | None = None, *, aside: bool = False
) -> tuple[KeptResult, ...]:
    """Return the kept results of this valve as `kept`; `report` gets a line where some are of another one.

    Raises:
        StateError: as `kept`.
    """
    found, report = kept(directory, kind, report, aside=aside), report or _to_stderr
    for other in sorted({each.valve for each in found} - {valve}):
        report(f"{directory}: {kind} of valve {other} is left out: this is {valve}")
    return tuple(each for each in found if each.valve == valve)


def reference(
    directory: Path, kind: str, valve: str, report: Callable[[str], object] | None = None, *, aside: bool = False
) -> KeptResult | None:
    """Return the result of this valve with which later ones are compared: the one the user named, or else the first.

    Raises:
        StateError: as `kept`.
    """
    return reference_of(directory, kept_of(directory, kind, valve, report, aside=aside), report, aside=aside)


def reference_of(
    directory: Path,
    results: tuple[KeptResult, ...],
    report: Callable[[str], object] | None = None,
    *,
    aside: bool = False,
) -> KeptResult | None:
    """Return the reference among the kept results of one kind, None where there are none; the rest is as in `kept`."""
    if not results:
        return None
    rejected: list[tuple[str, Exception]] = []
    named = None
    with suppress(OSError), kept_files.opened(directory, FOLDER) as folder:
        name = f"reference-{results[0].kind}.json"
        named = next(kept_files.used(folder, [name], lambda _, plain: str(plain["file"]), _gathered(rejected)), None)
    _report(directory, rejected, report or _to_stderr, aside=aside)
    return next((each for each in results if each.name == named), results[0])


def versions() -> dict[str, str]:
    """Return the versions of the programs that compute a result."""
    build = "compiled" if is_compiled() else "interpreted"
    others = {name: importlib.metadata.version(name) for name in ("numpy", "osqp")}
    return {"positioner": f"{positioner.__version__} ({build})", "python": platform.python_version(), **others}


def _checked(kind: str) -> str:
    if not _KIND.fullmatch(kind):
        raise ValueError(f"{kind!r} is no kind of result: small letters, digits and hyphens only")
    return kind


def _names(folder: int, kind: str) -> list[str]:
    pattern = re.compile(rf"{kind}-\d{{8}}T\d{{6}}Z(-\d+)?\.json")
    return sorted(filter(pattern.fullmatch, kept_files.names(folder)))


def _order(result: KeptResult) -> tuple[int, str, int]:
    """Return by what results of one kind are sorted: the sequence; without one the second, and the number in it."""
    time, _, number = result.name.removesuffix(".json").rpartition("Z")
    return result.sequence, time, int(number.removeprefix("-") or 1)


def _gathered(rejected: list[tuple[str, Exception]]) -> Callable[[str, Exception], object]:
    return lambda name, error: rejected.append((name, error))


def _report(
    directory: Path, rejected: list[tuple[str, Exception]], report: Callable[[str], object], *, aside: bool
) -> None:
    """Report the files that are not used; with `aside` those with another content are moved aside."""
    folder = directory / FOLDER
    for name, error in rejected:
        moved = None
        if aside and not isinstance(error, OSError):
            with suppress(OSError):
                ((_, moved),) = kept_files.set_aside(folder, name, kept_files.DAMAGED)
        done = f"moved aside to {moved}" if moved else "move it away"
        report(f"{folder / name} {kept_files.why(error)}: not used, {done}")


def _to_stderr(line: str) -> None:
    sys.stderr.write(f"{in_one_line(line)}\n")


def _result(kind: str, name: str, content: dict[str, Any]) -> KeptResult:
    if (content["format"], content["schema"], content["kind"]) != (_FORMAT, _SCHEMA, kind):
        raise ValueError("is no result of this kind that this version knows")
    recorded = datetime.strptime(content["recorded"], _TIME).replace(tzinfo=UTC)
    sequence = content.get("sequence", 0)
    if type(sequence) is not int or not 0 <= sequence <= _LAST:
        raise ValueError("has an impossible sequence")
    told = {str(key): str(each) for key, each in content["versions"].items()}
    document = content["document"]
    check_document(kind, document)
    if document["valve"] != content["valve"]:
        raise ValueError("names two valves")
    return KeptResult(kind, name, content["valve"], recorded, told, document, sequence)
