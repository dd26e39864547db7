"""Dataclasses as plain classes with an explicit `__init__`, which mypyc makes 30 times as fast as dataclasses.

`replace(value, field=...)` becomes a call of a generated method of the value's class. What such a class lacks of a
dataclass is added when its module is imported, by `native.py`.
"""

from __future__ import annotations

import ast
from typing import TYPE_CHECKING

from building.edits import Edits
from building.values import Value, field_nodes

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

NATIVE = "positioner.native"
"""The module that completes the classes; it is in the compiled build only."""


_SERIALIZABLE = """import typing
if typing.TYPE_CHECKING:
    import mypy_extensions
@mypy_extensions.mypyc_attr(serializable=True, allow_interpreted_subclasses=True)"""
"""Before settings: pydantic makes them without `__init__`; with the first option alone, mypyc never calls it."""


def replacements_of(trees: Iterable[ast.Module], values: Iterable[Value]) -> list[tuple[str, ...]]:
    """Return the sorted names of the fields of every call of `replace` for which there is a class."""
    called = {names for tree in trees for node in ast.walk(tree) if (names := _replaced(node)) is not None}
    known = list(values)
    return sorted(names for names in called if any(_takes(value, names) for value in known))


def expand(
    source: bytes, tree: ast.Module, values: Mapping[str, Value], replacements: list[tuple[str, ...]]
) -> tuple[bytes, list[int]]:
    """Return the source with plain classes in place of its dataclasses, and for each line that of the source.

    values: the dataclasses of this module, by name. replacements: what `replacements_of` finds in all modules.
    """
    edits, completed = Edits(source), ""
    for node in tree.body:
        value = values.get(node.name) if isinstance(node, ast.ClassDef) else None
        if isinstance(node, ast.ClassDef) and ast.unparse(node.bases[0] if node.bases else node).endswith("Enum"):
            _expand_enum(edits, node)
        if value is not None:
            _expand_class(edits, value, replacements)
            completed += f"_native.complete({value.name}, {_twin(value)!r}, globals())\n"
    _expand_constants(edits, tree)
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and _replaced(call) in replacements:
            _expand_replace(edits, call)
    if completed:
        edits.replace(len(source), len(source), f"import {NATIVE} as _native\nimport typing\n{completed}")
    return edits.result()


def _expand_constants(edits: Edits, tree: ast.Module) -> None:
    """Declare the numbers of a module as final: mypyc writes them where they are used, and looks up what may change."""
    imported = "import typing as _typing; "
    for node in tree.body:
        constants = _numbers(node)
        if constants:
            text = "; ".join(f"{name}: _typing.Final = {value}" for name, value in constants)
            edits.replace(*edits.span(node), f"{imported}{text}")
            imported = ""


def _numbers(node: ast.stmt) -> list[tuple[str, str]]:
    """Return the names and values of an assignment of numbers, nothing if it is another statement."""
    if not (isinstance(node, ast.Assign) and len(node.targets) == 1):
        return []
    target, value = node.targets[0], node.value
    targets, values = ([each] if not isinstance(each, ast.Tuple) else each.elts for each in (target, value))
    if len(targets) != len(values):
        return []
    found = [(ast.unparse(name), ast.unparse(number)) for name, number in zip(targets, values, strict=True)]
    return found if all(map(_is_name, targets)) and all(map(_is_number, values)) else []


def _is_name(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id.isupper()


def _is_number(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node = node.operand
    return isinstance(node, ast.Constant) and type(node.value) in {int, float}


def _replaced(node: ast.AST) -> tuple[str, ...] | None:
    """Return the sorted names of the fields that a node replaces, None if it is no call of `replace`."""
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "replace"):
        return None
    if len(node.args) != 1 or not all(each.arg for each in node.keywords):
        return None
    return tuple(sorted(each.arg for each in node.keywords if each.arg))


def _takes(value: Value, names: tuple[str, ...]) -> bool:
    if not names:  # a copy, which only what changes in place needs
        return not value.options.get("frozen")
    return {each.name for each in value.parameters}.issuperset(names)


def _expand_replace(edits: Edits, call: ast.Call) -> None:
    """Write `replace(value, field=...)` as `(value).with_field(field=...)`."""
    begin, (name_end, value_end) = edits.span(call)[0], (edits.span(each)[1] for each in (call.func, call.args[0]))
    after = value_end
    if call.keywords:
        first = call.keywords[0]
        after = edits.span(first.value)[0] - len(f"{first.arg}=")
    edits.replace(begin, name_end, "")
    edits.replace(value_end, after, f").{_method(_replaced(call) or ())}(")


def _method(names: Iterable[str]) -> str:
    return f"_with__{'__'.join(names)}"


def _expand_enum(edits: Edits, node: ast.ClassDef) -> None:
    """Take `__new__` out of an enumeration: in it, mypyc would check its result before there is a class."""
    for method in node.body:
        if isinstance(method, ast.FunctionDef) and method.name == "__new__":
            name = f"_new_{node.name}"
            arguments = [ast.arg(each.arg) for each in method.args.args]
            untyped = ast.FunctionDef(name, ast.arguments([], arguments, None, [], [], None, []), method.body, [])
            begin = edits.span(node)[0]
            edits.replace(begin, begin, f"{ast.unparse(ast.fix_missing_locations(untyped))}\n")
            edits.replace(*edits.span(method), f"__new__ = {name}")


def _expand_class(edits: Edits, value: Value, replacements: list[tuple[str, ...]]) -> None:
    begin, end = edits.span(value.decorator)
    settings = [base for base in value.node.bases if ast.unparse(base) == "SettingsTable"]
    edits.replace(begin - 1, end, _SERIALIZABLE if settings else "")  # with its @
    for base in settings:  # an interpreted class, whose place in the configuration `native.py` keeps
        edits.replace(*edits.span(base), "")
    for each in field_nodes(value.node):
        marker = ast.unparse(each.annotation) == "KW_ONLY"
        end = edits.span(each)[1]
        edits.replace(edits.span(each.annotation)[1], end, "") if not marker else edits.replace(
            edits.span(each)[0], end, ""
        )
    methods = [_init(value), *(_with(value, names) for names in replacements if _takes(value, names))]
    if value.options["eq"]:
        methods.append(_eq(value))
        methods += [_hash(value)] if value.options.get("frozen") else []
    if value.options.get("order"):
        methods += [_order(value, name, sign) for name, sign in _ORDER.items()]
    methods.insert(0, "__dataclass_fields__: 'typing.ClassVar[dict[str, typing.Any]]'")
    text = "\n".join(methods).replace("\n", "\n    ")
    end = edits.span(value.node)[1]
    edits.replace(end, end, f"\n    {text}\n")


def _init(value: Value) -> str:
    parameters, star, body = ["self"], False, []
    for each in value.parameters:
        if each.keyword and not star:
            parameters, star = [*parameters, "*"], True
        annotation = f"{each.annotation} | None" if each.made else each.annotation
        default = " = None" if each.made else f" = {each.default}" if each.default else ""
        parameters.append(f"{each.name}: {annotation}{default}")
        given = f"{each.default} if {each.name} is None else {each.name}" if each.made else each.name
        body.append(f"self.{each.name} = {given}")
    body += [f"self.{each.name} = {each.default}" for each in value.fields if not each.init and each.default]
    names = {node.name for node in value.node.body if isinstance(node, ast.FunctionDef)}
    body += ["self.__post_init__()"] if "__post_init__" in names else []
    return f"def __init__({', '.join(parameters)}) -> None:\n    {'; '.join(body) or 'pass'}"


def _with(value: Value, names: tuple[str, ...]) -> str:
    by_name = {each.name: each for each in value.fields}
    parameters = ", ".join(
        ["self", *(["*"] if names else []), *(f"{name}: {by_name[name].annotation}" for name in names)]
    )
    given = ", ".join(
        f"{f'{each.name}=' if each.keyword else ''}{'' if each.name in names else 'self.'}{each.name}"
        for each in value.parameters
    )
    return f"def {_method(names)}({parameters}) -> {_self(value)}:\n    return {value.name}({given})"


def _self(value: Value) -> str:
    generic = [ast.unparse(each) for each in value.node.bases if isinstance(each, ast.Subscript)]
    return value.name + (f"[{generic[0].split('[', 1)[1]}" if generic else "")


def _eq(value: Value) -> str:
    same = " and ".join(f"self.{each.name} == other.{each.name}" for each in value.fields if each.compare)
    return (
        "def __eq__(self, other: object) -> bool:\n"
        f"    if not isinstance(other, {value.name}) or other.__class__ is not self.__class__:\n"
        "        return NotImplemented\n"
        f"    return bool({same or True})"
    )


def _order(value: Value, name: str, sign: str) -> str:
    mine, other = (
        "".join(f"{each}.{field.name}, " for field in value.fields if field.compare) for each in ("self", "other")
    )
    return (
        f"def {name}(self, other: object) -> bool:\n"
        f"    if not isinstance(other, {value.name}) or other.__class__ is not self.__class__:\n"
        "        return NotImplemented\n"
        f"    return ({mine}) {sign} ({other})"
    )


_ORDER = {"__lt__": "<", "__le__": "<=", "__gt__": ">", "__ge__": ">="}


def _hash(value: Value) -> str:
    compared = "".join(f"self.{each.name}, " for each in value.fields if each.compare)
    return f"def __hash__(self) -> int:\n    return hash(({compared}))"


def _twin(value: Value) -> str:
    """Return the source of the class without its methods: a dataclass from which the native one is completed."""
    body: list[ast.stmt] = [each for each in value.node.body if isinstance(each, ast.AnnAssign)]
    if ast.get_docstring(value.node) is not None:
        body.insert(0, value.node.body[0])
    twin = ast.ClassDef(value.name, value.node.bases, [], body or [ast.Pass()], [value.decorator])
    return ast.unparse(twin)
