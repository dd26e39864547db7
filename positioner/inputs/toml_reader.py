"""TOML in, frozen dataclass out: every mistake at once, with its line, its limits and the nearest known key.

Shell. The positioner and the plant emulator share it; it contains no physics. Limits stand beside the parameters, as
`Annotated[float, Interval(gt=0.0, le=200.0)]`, and pydantic checks them.
"""

from __future__ import annotations

import difflib
import itertools
import json
import re
import tomllib
from copy import deepcopy
from dataclasses import fields, is_dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from positioner.errors import TEMPORARY_ERRNOS, ConfigurationError, Problem
from positioner.inputs.toml_lines import line_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from pydantic_core import ErrorDetails

T = TypeVar("T")

_LARGEST_BYTES = 1 << 20
_MOST_PROBLEMS = 50
_LIMITS = frozenset({"greater_than", "greater_than_equal", "less_than", "less_than_equal"})
_UNITS = {
    "_m3_per_s_pa": "m³/(s Pa)", "_n_s_per_m": "N s/m", "_n_per_m": "N/m", "_m_per_s": "m/s", "_pa_per_ma": "Pa/mA",
    "_ma_per_s": "mA/s", "_ma_per_m_s": "mA/(m s)", "_ma_s_per_m": "mA s/m", "_ma_per_m": "mA/m", "_per_cm2": "1/cm²",
    "_per_ma2": "1/mA²", "_pa_per_s": "Pa/s", "_n_per_s": "N/s", "_per_m": "1/m", "_per_s": "1/s", "_kg": "kg",
    "_m2": "m²", "_m3": "m³", "_ma": "mA", "_pa": "Pa", "_hz": "Hz", "_mm": "mm", "_n": "N", "_m": "m", "_s": "s",
    "_days": "d",
}  # fmt: skip
"""Suffix of a key and its unit, longer suffixes first."""
_RULE = "value_error"
"""The type of an error that a table's own rule between several keys raises; its message names them."""
_MOST_DOTS = 50
_BETWEEN = re.compile(r"[,=\[\]{}]")
_LINE_IN_TOML_ERROR = re.compile(r"\(at line (\d+)")


def read_text(path: Path) -> str:
    """Return the text of a settings file.

    Raises:
        ConfigurationError: the file cannot be read, or is not UTF-8 text.
        OSError: the system refuses for now, see `TEMPORARY_ERRNOS`.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST_BYTES + 1)
        if len(data) > _LARGEST_BYTES:
            text = f"is larger than {_LARGEST_BYTES >> 10} KiB: no settings file is"
            raise _unusable(str(path), "file", text)
        return data.decode("utf-8")
    except OSError as error:
        if error.errno in TEMPORARY_ERRNOS:
            raise
        raise _unusable(str(path), "file", f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise _unusable(str(path), "file", f"is not UTF-8 text: {error}") from error


def _unusable(source: str, where: str, text: str, line: int | None = None) -> ConfigurationError:
    return ConfigurationError(source, (Problem(where, line, text),))


def parse(text: str, kind: type[T], source: str) -> T:
    """Return the settings in `text` as a `kind`; `source` names the text in the messages.

    Raises:
        ConfigurationError: the text is not TOML, or a key is unknown, or a value is out of its limits.
    """
    return build(tables(text, source), kind, source, text)


def tables(text: str, source: str) -> dict[str, Any]:
    """Return the TOML `text` as nested dictionaries.

    Raises:
        ConfigurationError: the text is not TOML; the message gives the line.
    """
    if deep := _dotted(text):
        raise _unusable(source, "TOML", f"has a key of more than {_MOST_DOTS} parts", deep)
    try:
        values = tomllib.loads(text)
        json.dumps(values, default=str)  # fails for tables nested too deeply, and for a number that is too long
    except tomllib.TOMLDecodeError as error:
        found = _LINE_IN_TOML_ERROR.search(str(error))
        line = int(found.group(1)) if found else None
        raise _unusable(source, "TOML", str(error), line) from error
    except RecursionError as error:
        raise _unusable(source, "TOML", "is nested too deeply") from error
    except (ValueError, OverflowError) as error:
        raise _unusable(source, "TOML", f"cannot be used: {error}") from error
    return values


def _dotted(text: str) -> int | None:
    """Return the number of the first line with a key of too many parts: tomllib's time grows with their square."""
    lines = enumerate(text.splitlines(), start=1)
    long = ((number, line) for number, line in lines if line.count(".") > _MOST_DOTS and not line.startswith("#"))
    return next((n for n, line in long if any(key.count(".") > _MOST_DOTS for key in _BETWEEN.split(line))), None)


def changes_of(pairs: Sequence[str], example: str) -> dict[str, Any]:
    """Return `KEY=VALUE` pairs of a command line as nested tables; a value that is no TOML is taken as a string.

    Raises:
        ConfigurationError: one is no pair, or they contradict each other; `example` shows how to write one.
    """
    return tables("\n".join(_toml_line(pair, example) for pair in pairs), "--set")


def laid_over(base: Mapping[str, Any], top: Mapping[str, Any]) -> dict[str, Any]:
    """Return the nested tables `base` with those of `top` laid over them."""
    merged = dict(base)
    for key, value in top.items():
        below = merged.get(key)
        merged[key] = laid_over(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged


def build(values: dict[str, Any], kind: type[T], source: str, text: str = "") -> T:
    """Return `values` as a `kind`; lines are looked up in `text`.

    A table with a wrong value is not asked for its rules between several keys. So after the first mistakes the wrong
    values are left out, and the table is asked again, until no rule is left that is broken by values that stand there.

    Raises:
        ConfigurationError: a key is unknown, or a value is out of its limits; every mistake is in `problems`.
    """
    try:
        return _validated(values, kind)
    except ValidationError as error:
        found = list(error.errors(include_url=False))
    items, left, out = list(found), values, set[str]()
    while found and len(items) <= _MOST_PROBLEMS:
        left, removed = _without(left, found)
        if not removed:
            break
        out |= removed
        try:
            _validated(left, kind)
            break
        except ValidationError as error:
            found = [item for item in error.errors(include_url=False) if item["type"] == _RULE]
        items += [item for item in found if item["loc"] and not out & _words(item["msg"])]
    problems = sorted((_problem(item, kind, text) for item in items[:_MOST_PROBLEMS]), key=lambda p: p.line or 0)
    if more := len(items) - len(problems):
        problems.append(Problem("file", problems[-1].line, f"has {more} more mistake(s); mend these first"))
    raise ConfigurationError(source, tuple(problems))


def _validated(values: dict[str, Any], kind: type[T]) -> T:
    # JSON in between: its strict mode takes tables as dataclasses and still refuses "1.361" as a number
    built: T = _adapter(kind).validate_json(json.dumps(values, default=str), strict=True)  # type: ignore[arg-type]
    return built


def _without(values: dict[str, Any], found: Sequence[ErrorDetails]) -> tuple[dict[str, Any], set[str]]:
    """Return the tables without the values that are wrong, or that a broken rule names; and the keys left out."""
    left, removed = deepcopy(values), set[str]()
    for item in found:
        path = tuple(str(part) for part in itertools.takewhile(lambda part: isinstance(part, str), item["loc"]))
        table: Any = left
        for part in path if item["type"] == _RULE else path[:-1]:
            table = table.get(part) if isinstance(table, dict) else None
        if isinstance(table, dict):
            keys = _words(item["msg"]) & table.keys() if item["type"] == _RULE else {*path[-1:]} & table.keys()
            removed |= keys
            for key in keys:
                del table[key]
    return left, removed


def _words(message: str) -> set[str]:
    return set(re.findall(r"\w+", message))


@lru_cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _toml_line(pair: str, example: str) -> str:
    key, equals, value = pair.partition("=")
    if not equals:
        raise _unusable("--set", pair, f"is no KEY=VALUE; write it like {example}")
    try:
        tables(pair, "--set")
    except ConfigurationError:
        return f'{key} = "{value}"'
    return pair


def _problem(item: ErrorDetails, kind: type[Any], text: str) -> Problem:
    path = tuple(str(part) for part in item["loc"] if not isinstance(part, int))
    key = ".".join(path) or "file"
    line = line_of(text, path)
    if item["type"] == "unexpected_keyword_argument":
        return Problem(key, line, f"unknown key{_nearest(path, kind)}")
    if item["type"] in {"missing", "missing_argument"}:
        return Problem(key, line_of(text, path[:-1]), "is required and missing")
    if item["type"] == _RULE:
        return Problem(key, line, item["msg"].removeprefix("Value error, "))
    message = item["msg"].replace("Input should be", "must be").replace("a valid boolean", "true or false")
    if item["type"] in _LIMITS:
        message += unit_of(path[-1]) + _in_millimetres(path[-1], item)
    return Problem(f"{key} = {written(item['input'])}", line, message)


def written(value: object) -> str:
    """Return a value as a TOML file has it, or nearly so."""
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _in_millimetres(key: str, item: ErrorDetails) -> str:
    """Return the question whether a length in m was given in mm; empty where that would be out of its limits, too."""
    value, limit = item["input"], next(iter(item.get("ctx", {}).values()), None)
    if unit_of(key) != " m" or not isinstance(value, int | float) or not isinstance(limit, int | float):
        return ""
    metres = value / 1000.0
    is_fit = metres <= limit if item["type"].startswith("less") else metres >= limit
    return f"; did you mean {metres:.12g}? Lengths are in m" if is_fit else ""


def unit_of(key: str) -> str:
    """Return the unit in which `key` is given, with a space before it; empty where it has none."""
    return next((f" {unit}" for suffix, unit in _UNITS.items() if key.endswith(suffix)), "")


def _nearest(path: tuple[str, ...], kind: type[Any]) -> str:
    known = [field.name for field in fields(owner)] if (owner := _owner(path[:-1], kind)) else []
    close = difflib.get_close_matches(path[-1], known, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else f"; known here: {', '.join(known)}"


def _owner(path: tuple[str, ...], kind: Any) -> Any:
    """Return the dataclass that the table `path` is read into, or None."""
    for part in path:
        if get_origin(kind) is dict:  # tables with names of the user's choice
            kind = get_args(kind)[1]
        elif is_dataclass(kind):
            hint = get_type_hints(kind, include_extras=False).get(part)
            kind = next((arg for arg in (hint, *get_args(hint)) if is_dataclass(arg) or get_origin(arg) is dict), None)
    return kind if is_dataclass(kind) else None
