"""The classes that the compiled build makes of dataclasses do what the dataclasses do."""

from __future__ import annotations

import ast
import copy
import dataclasses
import inspect
import pickle
import sys
import traceback
from types import ModuleType
from typing import Any

import pytest
from harness.plan import PROJECT
from pydantic import TypeAdapter, ValidationError

from building import native
from building.compile import compiled_modules, with_lines_of_source
from building.edits import Edits
from building.expand import expand, replacements_of
from building.values import values_of

SOURCE = '''
from __future__ import annotations

from dataclasses import KW_ONLY, field
from enum import IntEnum
from typing import Annotated, ClassVar

from annotated_types import Interval
from positioner.inputs.table import SettingsTable
from positioner.values import dataclass, replace


_LEAST, MOST = 1.5, -2
NAMES = ("a", "b")


class Numbered(IntEnum):
    """An enumeration with a text of each member."""

    ONE = 1, "first"
    TWO = 2, "second"

    text: str

    def __new__(cls, number: int, text: str) -> Numbered:
        member = int.__new__(cls, number)
        member._value_ = number
        member.text = text
        return member


@dataclass(frozen=True, slots=True, order=True)
class Point:
    """A place."""

    x_m: float
    y_m: float = 2.0

    @property
    def sum_m(self) -> float:
        return self.x_m + self.y_m


@dataclass(frozen=True, slots=True)
class Path(Point):
    points: tuple[Point, ...] = ()
    seen: dict[str, int] = field(default_factory=dict, compare=False)
    _: KW_ONLY
    name: str = "µ"
    count: int = field(init=False, default=3)


@dataclass(slots=True)
class Moving:
    kind: ClassVar[str] = "moving"
    at: Point = field(default_factory=lambda: Point(0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings(SettingsTable):
    low_m: Annotated[float, Interval(ge=0.0)]
    high_m: float = 1.0

    def __post_init__(self) -> None:
        if self.low_m > self.high_m:
            raise ValueError("wrong order")


def moved(point: Point, by_m: float) -> Point:
    return replace(
        point,
        x_m=point.x_m + by_m,
    )


def swapped(point: Point) -> Point:
    return replace(replace(point, x_m=point.y_m), y_m=point.x_m)


def copied(moving: Moving) -> Moving:
    return replace(moving)


def fails() -> None:
    raise ValueError("here")
'''


def loaded(name: str, source: bytes) -> Any:
    module = ModuleType(name)
    sys.modules[name] = module
    exec(compile(source, f"{name}.py", "exec"), module.__dict__)  # noqa: S102 - the text above
    return module


@pytest.fixture(scope="module")
def expanded() -> tuple[bytes, list[int]]:
    tree = ast.parse(SOURCE)
    values = values_of({"source": tree})["source"]
    return expand(SOURCE.encode(), tree, values, replacements_of([tree], values.values()))


@pytest.fixture(scope="module")
def plain(expanded: tuple[bytes, list[int]]) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "positioner.native", native)
        patch.setattr("positioner.native", native, raising=False)
        mypy_extensions = ModuleType("mypy_extensions")
        text = expanded[0].replace(b"if typing.TYPE_CHECKING:", b"if True:")
        mypy_extensions.mypyc_attr = lambda **_: lambda cls: cls  # type: ignore[attr-defined]
        patch.setitem(sys.modules, "mypy_extensions", mypy_extensions)
        yield loaded("expanded", text)


@pytest.fixture(scope="module")
def original() -> Any:
    return loaded("original", SOURCE.encode())


@pytest.fixture(params=["plain", "original"])
def module(request: pytest.FixtureRequest) -> Any:
    return request.getfixturevalue(request.param)


def test_no_dataclass_and_no_call_of_replace_is_left(expanded: tuple[bytes, list[int]]) -> None:
    code = expanded[0].decode().split("import positioner.native")[0]
    assert "@dataclass" not in code
    assert " replace(" not in code


def test_numbers_are_final_and_what_is_no_number_is_not(expanded: tuple[bytes, list[int]], module: Any) -> None:
    code = expanded[0].decode()
    assert "; _LEAST: _typing.Final = 1.5; MOST: _typing.Final = -2\nNAMES = (" in code
    assert (module._LEAST, module.MOST, module.NAMES) == (1.5, -2, ("a", "b"))


def test_a_value_has_its_fields_their_defaults_and_its_methods(module: Any) -> None:
    path = module.Path(1.0, points=(module.Point(3.0),), name="b")
    assert (path.x_m, path.y_m, path.sum_m, path.points[0].y_m) == (1.0, 2.0, 3.0, 2.0)
    assert (path.seen, path.name, path.count, module.Moving().at.x_m) == ({}, "b", 3, 0.0)
    assert module.Path(1.0).seen is not module.Path(1.0).seen
    with pytest.raises(TypeError):
        module.Path(1.0, 2.0, (), {}, "name by position")


def test_values_are_compared_ordered_and_hashed_by_their_fields(module: Any) -> None:
    point, path = module.Point(1.0), module.Path(1.0, seen={"a": 1})
    assert point == module.Point(1.0, 2.0) != module.Point(1.0, 3.0)
    assert path == module.Path(1.0)
    assert point != path
    assert point < module.Point(1.0, 3.0) <= module.Point(2.0) > point
    assert module.Point(2.0) >= point
    assert len({point, module.Point(1.0), module.Point(2.0)}) == 2
    with pytest.raises(TypeError):
        hash(module.Moving())


def test_replaced_fields_are_new_and_the_others_stay(module: Any) -> None:
    path = module.Path(1.0, points=(module.Point(3.0),), name="b")
    moved = module.moved(path, 2.0)
    assert (type(moved), moved.x_m, moved.points, moved.name) == (module.Path, 3.0, path.points, "b")
    assert module.swapped(module.Point(1.0, 5.0)) == module.Point(5.0, 1.0)
    moving = module.Moving()
    copied = module.copied(moving)
    copied.at = module.Point(9.0)
    assert moving.at == module.Point(0.0)


def test_a_value_is_printed_copied_pickled_and_taken_apart(module: Any) -> None:
    path = module.Path(1.0, name="b")
    assert repr(path) == "Path(x_m=1.0, y_m=2.0, points=(), seen={}, name='b', count=3)"
    assert pickle.loads(pickle.dumps(path)) == path == copy.deepcopy(path)  # noqa: S301 - pickled here
    assert dataclasses.asdict(path)["name"] == "b"
    assert dataclasses.replace(module.Point(1.0), y_m=0.0) == module.Point(1.0, 0.0)
    assert [each.name for each in dataclasses.fields(module.Path)] == ["x_m", "y_m", "points", "seen", "name", "count"]
    match module.Point(1.0):
        case module.Point(x_m, y_m):
            assert (x_m, y_m) == (1.0, 2.0)
    assert inspect.getdoc(module.Point) == "A place."


def test_settings_are_read_with_their_limits(module: Any) -> None:
    adapter = TypeAdapter(module.Settings)
    read = adapter.validate_python({"low_m": 0.5})
    assert (read.low_m, read.high_m) == (0.5, 1.0)
    for wrong in ({"low_m": -1.0}, {"low_m": 0.5, "unknown": 1}, {"low_m": 2.0}, {"low_m": float("nan")}):
        with pytest.raises(ValidationError):
            adapter.validate_python(wrong)
    with pytest.raises(ValueError, match="wrong order"):
        module.Settings(low_m=2.0)


def test_members_of_an_enumeration_keep_their_texts(module: Any) -> None:
    assert [(int(each), each.text) for each in module.Numbered] == [(1, "first"), (2, "second")]


def test_a_line_of_the_expanded_code_is_traced_to_its_line_of_the_source(
    plain: Any, expanded: tuple[bytes, list[int]]
) -> None:
    wanted = SOURCE.splitlines().index('    raise ValueError("here")') + 1
    with pytest.raises(ValueError, match="here") as raised:
        plain.fails()
    line = traceback.extract_tb(raised.value.__traceback__)[-1].lineno
    assert line is not None
    assert line != wanted
    code = f'  CPy_AddTraceback("a/b.py", "fails", {line}, globals);'
    assert with_lines_of_source(code, {"a/b.py": expanded[1]}) == code[1:].replace(str(line), str(wanted))


def test_edits_keep_the_lines_of_what_they_do_not_touch() -> None:
    edits = Edits(b"a\nb\nc\nd\n")
    edits.replace(2, 3, "x\ny\nz")
    edits.replace(4, 7, "")
    text, lines = edits.result()
    assert text == b"a\nx\ny\nz\n\n"
    assert lines[:5] == [1, 2, 2, 2, 4]


def test_what_does_input_and_output_is_not_compiled() -> None:
    files = compiled_modules(PROJECT)
    assert {"positioner/cycle/step.py", "plant_emulator/valve.py"} < set(files)
    assert not {"plant_emulator/daemon.py", "positioner/optimization/solver.py"} & set(files)
