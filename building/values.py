"""The dataclasses of a set of modules: their fields, with the inherited ones, as the source writes them."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


@dataclass(frozen=True)
class Field:
    """One field of a dataclass. `default` is an expression, empty without one; a factory's is its call."""

    name: str
    annotation: str
    default: str = ""
    made: bool = False
    init: bool = True
    compare: bool = True
    keyword: bool = False


@dataclass(frozen=True)
class Value:
    """One dataclass: its node, its decorator, and its fields in order, inherited ones first."""

    node: ast.ClassDef
    decorator: ast.expr
    fields: tuple[Field, ...]
    options: Mapping[str, bool]

    @property
    def name(self) -> str:
        """The name of the class."""
        return self.node.name

    @property
    def parameters(self) -> list[Field]:
        """The fields that `__init__` takes, those that are given by position first."""
        taken = [each for each in self.fields if each.init]
        return [each for each in taken if not each.keyword] + [each for each in taken if each.keyword]


def values_of(trees: Mapping[str, ast.Module]) -> dict[str, dict[str, Value]]:
    """Return the dataclasses of the modules by module and name; `trees` are the modules by name."""
    values: dict[str, dict[str, Value]] = {module: {} for module in trees}
    for module, tree in trees.items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                _read(module, node.name, trees, values)
    return values


def _read(module: str, name: str, trees: Mapping[str, ast.Module], values: dict[str, dict[str, Value]]) -> Value | None:
    """Return the dataclass that is called `name` in a module, its own or an imported one; None if it is none."""
    for node in trees[module].body if module in trees else ():
        if isinstance(node, ast.ImportFrom) and any(each.name == name for each in node.names):
            return _read(node.module or "", name, trees, values)
        if not (isinstance(node, ast.ClassDef) and node.name == name):
            continue
        decorator = decorator_of(node)
        if decorator is None or name in values[module]:
            return values[module].get(name)
        keywords = decorator.keywords if isinstance(decorator, ast.Call) else []
        options = {"eq": True} | {each.arg: ast.literal_eval(each.value) for each in keywords if each.arg}
        fields: dict[str, Field] = {}
        for base in node.bases:
            inherited = _read(module, base.id, trees, values) if isinstance(base, ast.Name) else None
            fields |= {each.name: each for each in inherited.fields} if inherited else {}
        fields |= {each.name: each for each in _own_fields(node, keyword=options.get("kw_only", False))}
        values[module][name] = Value(node, decorator, tuple(fields.values()), options)
    return values[module].get(name) if module in values else None


def decorator_of(node: ast.ClassDef) -> ast.expr | None:
    """Return the decorator that makes a class a dataclass, None without one."""
    for each in node.decorator_list:
        name = each.func if isinstance(each, ast.Call) else each
        if isinstance(name, ast.Name) and name.id == "dataclass":
            return each
    return None


def field_nodes(node: ast.ClassDef) -> list[ast.AnnAssign]:
    """Return the fields of a class's body, and the marker of those that are given by name only."""
    return [
        each
        for each in node.body
        if isinstance(each, ast.AnnAssign) and not ast.unparse(each.annotation).startswith("ClassVar")
    ]


def _own_fields(node: ast.ClassDef, *, keyword: bool) -> Iterator[Field]:
    for each in field_nodes(node):
        annotation = ast.unparse(each.annotation)
        if annotation == "KW_ONLY":
            keyword = True
            continue
        name = ast.unparse(each.target)
        if not (isinstance(each.value, ast.Call) and ast.unparse(each.value.func) == "field"):
            default = "" if each.value is None else ast.unparse(each.value)
            yield Field(name, annotation, default, keyword=keyword)
            continue
        given = {option.arg: option.value for option in each.value.keywords}
        text = {option: ast.unparse(value) for option, value in given.items()}
        default, factory = text.get("default", ""), given.get("default_factory")
        if factory is not None:
            default = ast.unparse(factory.body if isinstance(factory, ast.Lambda) else ast.Call(factory, [], []))
        init, compare = text.get("init") != "False", text.get("compare") != "False"
        yield Field(name, annotation, default, factory is not None, init, compare, keyword)
