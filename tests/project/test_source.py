"""What `make rules` cannot see: that pure modules bring nothing of the outside world, and how large a module is."""

from __future__ import annotations

import ast
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MOST_LINES = 500

OUTSIDE_WORLD = {
    *("time", "os", "io", "socket", "select", "signal", "subprocess", "threading", "asyncio"),
    *("random", "secrets", "logging", "sqlite3", "can", "osqp", "tqdm"),
}
"""Clocks, environment, disks, sockets, chance, logs, the bus and the solver."""

PURE_ROOMS = ("wire", "valve", "laws", "guard", "cycle")
PURE_BESIDE = ("positioner.optimization.qp", *(f"plant_emulator.{name}" for name in ("valve", "stem", "device")))


@dataclass(frozen=True)
class Module:
    """A source file: its dotted name, its docstring and what it imports when it runs."""

    name: str
    docstring: str
    lines: int
    imported: frozenset[str]


def imports_of(nodes: list[ast.stmt]) -> frozenset[str]:
    found: set[str] = set()
    for node in (inner for statement in nodes for inner in ast.walk(statement)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def is_type_checking(node: ast.stmt) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def read(path: Path) -> Module:
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    imported = imports_of([node for node in tree.body if not is_type_checking(node)])
    return Module(name, ast.get_docstring(tree) or "", len(text.splitlines()), imported)


MODULES = [read(path) for folder in ("positioner", "plant_emulator") for path in sorted((ROOT / folder).rglob("*.py"))]
PURE = [module for module in MODULES if "Pure" in module.docstring]


def test_the_core_is_declared_pure() -> None:
    core = {module.name for module in MODULES if module.name.startswith(tuple(f"positioner.{r}." for r in PURE_ROOMS))}
    assert len(core) > 60
    assert {*core, *PURE_BESIDE} <= {module.name for module in PURE}


@pytest.mark.parametrize("module", PURE, ids=lambda module: module.name)
def test_a_pure_module_imports_nothing_of_the_outside_world(module: Module) -> None:
    assert not {name.split(".")[0] for name in module.imported} & OUTSIDE_WORLD


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.name)
def test_a_module_holds_one_idea(module: Module) -> None:
    assert module.lines <= MOST_LINES, f"{module.name} has {module.lines} lines"


def test_the_checks_see_what_they_look_for() -> None:
    source = "from __future__ import annotations\nimport os.path\nif TYPE_CHECKING:\n    from can import Message\n"
    tree = ast.parse(source)
    assert imports_of([node for node in tree.body if is_type_checking(node)]) == {"can.Message"}
    assert imports_of(tree.body[:2]) == {"__future__.annotations", "os.path"}
    assert "os" in OUTSIDE_WORLD <= {*sys.stdlib_module_names, "can", "osqp", "tqdm"}
