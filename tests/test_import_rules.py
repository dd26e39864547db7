"""Who may import whom, and how large a module may be; read from the source, so that no path escapes the tests."""

from __future__ import annotations

import ast
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MOST_LINES = 250
LONGER: dict[str, str] = {}
"""Modules that may be longer, each with its reason; none is."""

OUTSIDE_WORLD = {
    *("time", "os", "io", "socket", "select", "signal", "subprocess", "threading", "asyncio"),
    *("random", "secrets", "logging", "sqlite3", "can", "osqp", "tqdm"),
}
"""Clocks, environment, disks, sockets, chance, logs, the bus and the solver."""

STAGES = (
    *("model", "estimate", "stick_slip", "stiction", "bounds", "qp", "planner"),
    *("guard", "guard_settings", "guard_state", "arming", "stall", "arrivals", "cadence"),
    *("plausibility", "frozen", "deviation", "inbox", "link", "tally", "events", "timing_events", "trust_events"),
    *("cycle", "cycle_state", "closed_loop", "outbox", "acting", "credible", "learning"),
)
LAYERS = (
    ("positioner.cli",),
    ("positioner.replay",),
    ("positioner.bench", "positioner.doctor"),
    ("positioner.daemon",),
    (
        "positioner.config",
        "positioner.clock",
        "positioner.trace",
        "positioner.record",
        "positioner.journal",
        "positioner.store",
    ),
    ("positioner.cycle",),
    ("positioner.closed_loop", "positioner.outbox"),
    ("positioner.cycle_state",),
    ("positioner.inbox", "positioner.tally"),
    ("positioner.link",),
    ("positioner.events",),
    ("positioner.timing_events", "positioner.trust_events"),
    ("positioner.laws",),
    ("positioner.stick_slip", "positioner.plausibility", "positioner.planner"),
    ("positioner.guard",),
    ("positioner.arming",),
    ("positioner.stall",),
    ("positioner.guard_state", "positioner.guard_settings"),
    ("positioner.estimate", "positioner.bounds", "positioner.qp"),
    ("positioner.model", "positioner.stiction", "positioner.wire"),
)
"""From the shell down: a module imports from its own layer and those below, never from one above."""

PLUMBING = (
    "positioner.wire",
    "positioner.bus",
    "positioner.bus_open",
    "positioner.machine_time",
    "positioner.ports",
    "positioner.arrivals",
    "positioner.bus_address",
    "positioner.console",
    "positioner.errors",
    "positioner.settings",
    "positioner.nearest",
    "positioner.parser",
    "positioner.plain_text",
    "positioner.notify",
    "positioner.line_sink",
    "positioner.start",
)
"""What the plant emulator shares with the positioner: the wire and tools, no physics."""


@dataclass(frozen=True)
class Module:
    """A source file: its dotted name, its docstring and everything that it imports, type hints included or not."""

    name: str
    docstring: str
    lines: int
    imported: frozenset[str]
    imported_for_types: frozenset[str]


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
    return Module(
        name,
        ast.get_docstring(tree) or "",
        len(text.splitlines()),
        imports_of([node for node in tree.body if not is_type_checking(node)]),
        imports_of([node for node in tree.body if is_type_checking(node)]),
    )


MODULES = [read(path) for folder in ("positioner", "plant_emulator") for path in sorted((ROOT / folder).rglob("*.py"))]
PURE = [module for module in MODULES if "Pure" in module.docstring]


def inside(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


def layer_of(name: str) -> int | None:
    return next((i for i, packages in enumerate(LAYERS) if any(inside(name, package) for package in packages)), None)


def test_the_tree_was_found() -> None:
    assert len(MODULES) > 60
    assert len(PURE) > 30


@pytest.mark.parametrize("name", STAGES)
def test_the_stages_are_declared_pure(name: str) -> None:
    assert f"positioner.{name}" in {module.name for module in PURE}


def test_the_laws_the_wire_and_the_plant_are_declared_pure() -> None:
    pure = {module.name for module in PURE}
    for module in MODULES:
        if inside(module.name, "positioner.laws") or inside(module.name, "positioner.wire"):
            assert module.name in pure
    assert {f"plant_emulator.{name}" for name in ("valve", "stem", "friction", "sensor", "actuator", "device")} <= pure


@pytest.mark.parametrize("module", PURE, ids=lambda module: module.name)
def test_a_pure_module_imports_nothing_of_the_outside_world(module: Module) -> None:
    assert not {name.split(".")[0] for name in module.imported} & OUTSIDE_WORLD


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.name)
def test_a_module_imports_no_layer_above_its_own(module: Module) -> None:
    own = layer_of(module.name)
    if own is None:
        return
    for name in module.imported | module.imported_for_types:
        other = layer_of(name)
        # a hint may look up: the registry of laws says what a law is made of, events say what they carry
        assert other is None or other >= own or name in module.imported_for_types, f"{module.name} imports {name}"


@pytest.mark.parametrize(
    "module", [module for module in MODULES if inside(module.name, "plant_emulator")], ids=lambda module: module.name
)
def test_the_plant_shares_the_wire_and_the_plumbing_and_no_physics(module: Module) -> None:
    shared = {name for name in module.imported | module.imported_for_types if inside(name, "positioner")}
    assert all(
        name == "positioner.__version__" or any(inside(name, package) for package in PLUMBING) for name in shared
    )


def test_the_positioner_knows_the_plant_on_the_bench_only() -> None:
    knowing = {
        module.name
        for module in MODULES
        if inside(module.name, "positioner")
        and any(inside(name, "plant_emulator") for name in module.imported | module.imported_for_types)
    }
    assert all(inside(name, "positioner.bench") for name in knowing)


def test_only_the_solver_imports_the_solver_and_only_the_shell_the_bus() -> None:
    def importers(package: str) -> set[str]:
        return {module.name for module in MODULES if any(inside(name, package) for name in module.imported)}

    assert importers("osqp") == {"positioner.solver"}
    on_the_bus = {
        "positioner.bus",
        "positioner.bus_open",
        "positioner.bus_address",
        "positioner.bench.recording",
        "positioner.replay.log",
    }
    assert {"positioner.bus"} <= importers("can") <= on_the_bus


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.name)
def test_a_module_holds_one_idea(module: Module) -> None:
    assert module.lines <= MOST_LINES or module.name in LONGER, f"{module.name} has {module.lines} lines"


def test_no_module_is_excused_from_its_length() -> None:
    assert LONGER == {}


def test_the_checks_see_what_they_look_for() -> None:
    source = "from __future__ import annotations\nimport os.path\nif TYPE_CHECKING:\n    from can import Message\n"
    tree = ast.parse(source)
    assert imports_of([node for node in tree.body if is_type_checking(node)]) == {"can.Message"}
    assert imports_of(tree.body[:2]) == {"__future__.annotations", "os.path"}
    assert "os" in OUTSIDE_WORLD <= {*sys.stdlib_module_names, "can", "osqp", "tqdm"}
    assert layer_of("positioner.wire.codec") == len(LAYERS) - 1
    assert layer_of("positioner.errors") is None
