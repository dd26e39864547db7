"""The tables and keys of a settings file, from the dataclasses that check it: limits, defaults, docstrings. Pure.

A key is described in the docstring of its table's class, as `key: text.` or `key, key: text.`, with its further lines
indented, or in a string behind the field.
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

from annotated_types import Interval, Len, MultipleOf

from positioner.inputs.toml_reader import unit_of

if TYPE_CHECKING:
    from collections.abc import Iterator

_KINDS = {float: "number", int: "integer", str: "text", bool: "true or false", Path: "path"}
_COUNTED = (float, int, str, Path)
"""Kinds whose words have a plural with an s."""
REQUIRED = "required"
"""What stands in place of a default where a key must be given."""
_NAMES = re.compile(r"^(\w+(?:, \w+)*): (.*)$")


@dataclasses.dataclass(frozen=True)
class Key:
    """One key of a table: its name, what a value may be, its unit, its default or `required`, and what it is for."""

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


def tables_of(cls: type[Any], defaults: Any = None) -> list[Table]:
    """Return every table of a file that is read into `cls`; `defaults` is an instance of it, None: its own defaults."""
    return list(_tables(cls, defaults, "", ""))


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
        kind, value = hints[field.name], _default(field) if default is None else getattr(default, field.name)
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
            (only, value), container = fields[0], typing.get_origin(_bare(hints[fields[0][0]]))
            path = f"[{paths[0]}]" if container is tuple else f"{paths[0]}.NAME" if container is dict else paths[0]
            yield from _tables(below, value if dataclasses.is_dataclass(value) else None, path, texts.get(only, own))
        else:
            alike = next(_tables(below, fields[0][1], paths[0], ""))
            yield Table(tuple(paths), tuple(texts.get(field, "") for field, _ in fields), alike.keys)


def _default(field: dataclasses.Field[Any]) -> Any:
    """Return what a class gives a field that nobody gives; MISSING where there is no such value."""
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def _bare(kind: Any) -> Any:
    """Return a type hint without its limits."""
    return typing.get_args(kind)[0] if typing.get_origin(kind) is typing.Annotated else kind


def _table_class(kind: Any) -> type[Any] | None:
    """Return the dataclass of a field that is a table, or may be one, or has some by position or by name."""
    bare = _bare(kind)
    return next((each for each in (bare, *typing.get_args(bare)) if isinstance(each, type) and _is_table(each)), None)


def _is_table(kind: type[Any]) -> bool:
    return dataclasses.is_dataclass(kind) and kind not in {Interval, MultipleOf}


def _key(name: str, kind: Any, value: Any, text: str) -> Key:
    return Key(name, _kind(kind), _limits(kind), unit_of(name).strip(), _value(value), text)


def _kind(kind: Any) -> str:
    """Return in words what a value may be."""
    kind = _bare(kind)
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in {typing.Union, types.UnionType}:
        return " or ".join(dict.fromkeys(_kind(each) for each in arguments if each is not types.NoneType))
    if origin is dict:
        return "table" if arguments[1] is Any else f"table of {_plural(arguments[1])}"
    if origin in {tuple, list}:
        return f"list of {_plural(arguments[0])}"
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return ", ".join(f"`{_toml(each.value)}`" for each in kind)
    return _KINDS[kind]


def _plural(kind: Any) -> str:
    bare = _bare(kind)
    if typing.get_origin(bare) in {typing.Union, types.UnionType}:
        return " or ".join(_plural(each) for each in typing.get_args(bare))
    words = _kind(bare)
    return f"{words}s" if bare in _COUNTED else words.replace("list ", "lists ", 1)


def _limits(kind: Any) -> str:
    """Return the limits of a value in words; empty where there are none."""
    bare = _bare(kind)
    words = [_limit(limit, bare) for limit in getattr(kind, "__metadata__", ())]
    inner = [found for each in typing.get_args(bare) if each is not Ellipsis and (found := _limits(each))]
    words += [f"each {found}" for found in inner] if typing.get_origin(bare) is tuple else inner
    return ", ".join(words)


def _limit(limit: Any, kind: Any) -> str:
    if isinstance(limit, MultipleOf):
        return f"multiples of {limit.multiple_of:g}"
    if isinstance(limit, Len):
        things = "characters" if kind is str else "entries"
        if limit.max_length is None:
            return f"at least {limit.min_length} of them" if things == "entries" else "not empty"
        return f"{limit.min_length} to {limit.max_length} {things}"
    low = f"above {_number(limit.gt)}" if limit.ge is None else _number(limit.ge)
    if limit.le is None and limit.lt is None:
        return low if limit.ge is None else f"at least {low}"
    return f"{low} to below {_number(limit.lt)}" if limit.le is None else f"{low} to {_number(limit.le)}"


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _value(value: Any) -> str:
    if value is dataclasses.MISSING:
        return REQUIRED
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
