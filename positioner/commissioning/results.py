"""Kept results: each finished test procedure leaves its `--json` document in the valve's state directory. Shell.

One file each, `results/KIND-DATE.json`, with the date, the versions and the valve. The first of a kind is the
reference, until the user names another: `results/reference-KIND.json` holds its file name.
"""

from __future__ import annotations

import importlib.metadata
import platform
import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import positioner
from positioner.errors import StateError
from positioner.machine import kept_files
from positioner.machine.build import is_compiled

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

FOLDER = "results"
_FORMAT, _SCHEMA = "positioner-result", 1
_KIND = re.compile(r"[a-z][a-z0-9]*(-[a-z][a-z0-9]*)*")
_NAME_TIME, _TIME = "%Y%m%dT%H%M%SZ", "%Y-%m-%dT%H:%M:%SZ"


@dataclass(frozen=True, slots=True)
class KeptResult:
    """The document of a finished procedure; `recorded` is its date in UTC, `versions` by program."""

    kind: str
    name: str
    valve: str
    recorded: datetime
    versions: dict[str, str]
    document: dict[str, Any]


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
        "valve": made.valve,
        "recorded": made.recorded.strftime(_TIME),
        "versions": made.versions,
        "document": document,
    }
    with kept_files.writable(directory, FOLDER, "the result") as folder:
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


def kept(directory: Path, kind: str, report: Callable[[str], object] | None = None) -> tuple[KeptResult, ...]:
    """Return the kept results of a kind, the newest last; `report` gets a line for each file that is none.

    Raises:
        StateError: the directory cannot be read.
    """
    report = report or _to_stderr
    pattern = re.compile(rf"{_checked(kind)}-\d{{8}}T\d{{6}}Z(-\d+)?\.json")
    found = []
    try:
        with kept_files.opened(directory, FOLDER) as folder:
            for name in sorted(filter(pattern.fullmatch, kept_files.names(folder)), key=_order):
                try:
                    found.append(_result(kept_files.read(folder, name), kind, name))
                except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
                    why = error.strerror if isinstance(error, OSError) else "it is damaged"
                    report(f"{directory / FOLDER / name}: is no kept result ({why}): remove it")
    except FileNotFoundError:
        return ()
    except OSError as error:
        message = f"{directory / FOLDER}: cannot be read: {error.strerror}; become the owner of the directory"
        raise StateError(message) from error
    return tuple(found)


def kept_of(
    directory: Path, kind: str, valve: str, report: Callable[[str], object] | None = None
) -> tuple[KeptResult, ...]:
    """Return the kept results of this valve as `kept`; `report` gets a line where some are of another one.

    Raises:
        StateError: as `kept`.
    """
    found, report = kept(directory, kind, report), report or _to_stderr
    for other in sorted({each.valve for each in found} - {valve}):
        report(f"{directory}: {kind} of valve {other} is left out: this is {valve}")
    return tuple(each for each in found if each.valve == valve)


def reference(
    directory: Path, kind: str, valve: str, report: Callable[[str], object] | None = None
) -> KeptResult | None:
    """Return the result of this valve with which later ones are compared: the one the user named, or else the first.

    Raises:
        StateError: as `kept`.
    """
    return reference_of(directory, kept_of(directory, kind, valve, report))


def reference_of(directory: Path, results: tuple[KeptResult, ...]) -> KeptResult | None:
    """Return the reference among the kept results of one kind, None where there are none."""
    if not results:
        return None
    named = None
    with suppress(OSError, ValueError, KeyError, TypeError), kept_files.opened(directory, FOLDER) as folder:
        named = kept_files.read(folder, f"reference-{results[0].kind}.json")["file"]
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


def _order(name: str) -> tuple[str, int]:
    """Return by what names of one kind are sorted: the second, and the number of the result in it."""
    time, _, number = name.removesuffix(".json").rpartition("Z")
    return time, int(number.removeprefix("-") or 1)


def _to_stderr(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def _result(content: dict[str, Any], kind: str, name: str) -> KeptResult:
    if (content["format"], content["schema"], content["kind"]) != (_FORMAT, _SCHEMA, kind):
        raise ValueError("another format")
    recorded = datetime.strptime(content["recorded"], _TIME).replace(tzinfo=UTC)
    told = {str(key): str(each) for key, each in content["versions"].items()}
    document = content["document"]
    if not isinstance(document, dict) or not isinstance(content["valve"], str):
        raise TypeError("no document")
    return KeptResult(kind, name, content["valve"], recorded, told, document)
