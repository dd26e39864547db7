"""The reference of the configuration, from its dataclasses: their limits, their defaults, their docstrings. Pure.

A key is described in the docstring of its table's class, as `key: text.` or `key, key: text.`, with its further lines
indented. `positioner check --example` shows the same keys as a file.
"""

from __future__ import annotations

import ast
import dataclasses
import enum
import inspect
import re
import textwrap
import types
import typing
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from annotated_types import Interval, MultipleOf

from positioner.config.schema import Configuration
from positioner.health.causes import LIMITS
from positioner.inputs.toml_reader import unit_of
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from collections.abc import Iterator

_KINDS = {float: "number", int: "integer", str: "text", bool: "true or false", Path: "path"}
_INTRODUCTION = """\
# Configuration

Every key that a configuration may hold, as `positioner run` reads it. `positioner check FILE` reports every mistake
with its line, its limits and the nearest known key; `positioner check --example` prints a file with every key.

Units are SI; the loop current is in mA. The end of a key names its unit. Every key may be left out, but for those of
`[valve]`: give all of them, or `preset = "paper"` or `"graphite"` for a valve with a name. Their column *default* shows
the paper's valve. In a file with several valves each table may stand at the top or in a `[[valve]]`
([how](../install.md#several-valves-in-one-process)).
"""
_NAMES = re.compile(r"^(\w+(?:, \w+)*): (.*)$")


@dataclasses.dataclass(frozen=True)
class Key:
    """One key of a table: its name, what a value may be, its unit, its default, and what it is for."""

    name: str
    kind: str
    limits: str
    unit: str
    default: str
    text: str


@dataclasses.dataclass(frozen=True)
class Table:
    """One table of the file: its names, each with what it is for, and its keys."""

    names: tuple[str, ...]
    texts: tuple[str, ...]
    keys: tuple[Key, ...]


def described(cls: type[Any]) -> dict[str, str]:
    """Return what the docstring of `cls`, or the one behind a field, says about each of its fields."""
    own = {field.name for field in dataclasses.fields(cls)}
    found = _behind_fields(cls)
    names: list[str] = []
    for line in inspect.cleandoc(cls.__doc__ or "").splitlines()[1:]:
        start = _NAMES.match(line)
        if start and set(start[1].split(", ")) <= own:
            names = start[1].split(", ")
            found |= dict.fromkeys(names, start[2])
        elif line.startswith(" ") and names:
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
        else:
            names = []
    return found


def tables() -> list[Table]:
    """Return every table of a configuration, in the order of the example."""
    return tables_of(Configuration, Configuration(valve=ValveParameters(id="FV-101")))


def tables_of(cls: type[Any], defaults: Any) -> list[Table]:
    """Return every table of a file that is read into `cls`; `defaults` is an instance of it."""
    return list(_tables(cls, defaults, "", ""))


def page() -> str:
    """Return the reference in Markdown."""
    return _INTRODUCTION + "".join(section(table) for table in tables() if table.keys)


def _behind_fields(cls: type[Any]) -> dict[str, str]:
    """Return the strings that stand behind fields in the source, in one line each."""
    body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0].body  # type: ignore[attr-defined]
    return {
        ast.unparse(field.target): " ".join(str(text.value.value).split())
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }


def _tables(cls: type[Any], default: Any, name: str, text: str) -> Iterator[Table]:
    hints, texts = typing.get_type_hints(cls, include_extras=True), described(cls)
    keys: list[Key] = []
    inner: dict[type[Any], list[tuple[str, Any]]] = {}
    for field in dataclasses.fields(cls):
        kind, value = hints[field.name], getattr(default, field.name) if default is not None else None
        if below := _table_class(kind):
            inner.setdefault(below, []).append((field.name, value))
        else:
            keys.append(_key(field.name, kind, value, texts.get(field.name, "")))
    if name or keys:
        yield Table((name,), (text,), tuple(keys))
    for below, fields in inner.items():
        paths = [f"{name}.{field}".lstrip(".") for field, _ in fields]
        if len(fields) == 1:
            own = (below.__doc__ or "").splitlines()[0]
            several = isinstance(fields[0][1], tuple)
            path, value = (f"[{paths[0]}]", None) if several else (paths[0], fields[0][1])
            yield from _tables(below, value, path, texts.get(fields[0][0], own))
        else:
            alike = next(_tables(below, fields[0][1], paths[0], ""))
            yield Table(tuple(paths), tuple(texts.get(field, "") for field, _ in fields), alike.keys)


def _table_class(kind: Any) -> type[Any] | None:
    """Return the dataclass of a field that is a table, or may be one."""
    return next((each for each in (kind, *typing.get_args(kind)) if isinstance(each, type) and _is_table(each)), None)


def _is_table(kind: type[Any]) -> bool:
    return dataclasses.is_dataclass(kind) and kind not in {Interval, MultipleOf}


def _key(name: str, kind: Any, value: Any, text: str) -> Key:
    return Key(name, _kind(kind), _limits(kind), unit_of(name).strip(), _value(value), text)


def _kind(kind: Any) -> str:
    """Return in words what a value may be."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return _kind(arguments[0])
    if origin in {typing.Union, types.UnionType}:
        return " or ".join(dict.fromkeys(_kind(each) for each in arguments if each is not types.NoneType))
    if origin is dict:
        return f"table of {_kind(arguments[1])}"
    if origin in {tuple, list}:
        return "list"
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return ", ".join(f"`{_toml(each.value)}`" for each in kind)
    return _KINDS[kind]


def _limits(kind: Any) -> str:
    """Return the limits of a value in words; empty where there are none."""
    words = []
    for each in (kind, *typing.get_args(kind)):
        for limit in getattr(each, "__metadata__", ()):
            if isinstance(limit, Interval):
                low = f"above {limit.gt:g}" if limit.ge is None else f"{limit.ge:g}"
                high = f"below {limit.lt:g}" if limit.le is None else f"{limit.le:g}"
                words.append(f"{low} to {high}")
            elif isinstance(limit, MultipleOf):
                words.append(f"multiples of {limit.multiple_of:g}")
    return ", ".join(words)


def _value(value: Any) -> str:
    return "" if value in (None, {}) else f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return f"{value:.10g}" if value else "0"
    return f'"{value}"' if isinstance(value, str) else str(value)


def section(table: Table) -> str:
    """Return one table of the reference in Markdown."""
    heading = table.names[0] if len(table.names) == 1 else f"{table.names[0].rpartition('.')[0]}.NAME"
    lines = [f"\n## [{heading}]\n" if heading else "\n## At the top\n"]
    if len(table.names) > 1:
        lines += ["`NAME` is one of these:\n", *_alike(table), ""]
    elif table.texts[0]:
        lines += [f"{table.texts[0]}\n"]
    lines += ["| key | value | limits | unit | default | what it is |", "|---|---|---|---|---|---|"]
    for key in table.keys:
        shown = "" if len(table.names) > 1 else key.default
        lines.append(f"| `{key.name}` | {key.kind} | {key.limits} | {key.unit} | {shown} | {key.text} |")
    return "\n".join(lines) + "\n"


def _alike(table: Table) -> list[str]:
    """Return a row for each of several tables with the same keys; those of alarms show their usual limits."""
    rows = ["| NAME | what it is | usual limit | NE 107 | usual serious limit | NE 107 |", "|---|---|---|---|---|---|"]
    usual = {cause.key: limits for cause, limits in LIMITS.items()}
    names = [name.rpartition(".")[2] for name in table.names]
    if not set(names) <= set(usual):
        return [f"- `{name}`: {text}" for name, text in zip(names, table.texts, strict=True)]
    for name, text in zip(names, table.texts, strict=True):
        limits = usual[name]
        serious = f"{limits.serious_limit:g}" if limits.serious_limit else ""
        category = _words(limits.serious_category) if serious else ""
        rows.append(f"| `{name}` | {text} | {limits.limit:g} | {_words(limits.category)} | {serious} | {category} |")
    return rows


def _words(member: enum.Enum) -> str:
    return member.name.lower().replace("_", " ")
