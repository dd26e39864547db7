"""Settings files: every mistake at once, with its line, its limit and the nearest known key."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import pytest
from annotated_types import Interval

from positioner.errors import ConfigurationError, ExitCode
from positioner.guard.settings import GuardSettings
from positioner.inputs import toml_reader
from positioner.inputs.toml_reader import parse, read_text


@dataclass(frozen=True, slots=True, kw_only=True)
class Friction:
    __pydantic_config__: ClassVar = {"extra": "forbid"}
    static_n: Annotated[float, Interval(gt=0.0)] = 1878.47
    coulomb_n: Annotated[float, Interval(gt=0.0)] = 1423.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Valve:
    __pydantic_config__: ClassVar = {"extra": "forbid"}
    mass_kg: Annotated[float, Interval(gt=0.0, le=200.0)]
    name: str = ""
    friction: Friction = field(default_factory=Friction)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    __pydantic_config__: ClassVar = {"extra": "forbid"}
    valve: Valve
    spare: Valve | None = None
    seed: Annotated[int, Interval(ge=0)] = 0
    setpoints_m: tuple[float, ...] = ()
    directory: Path = Path("runs")


def mistakes(text: str) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        parse(text, Settings, "valve.toml")
    assert str(caught.value) == "\n".join(f"valve.toml: {problem}" for problem in caught.value.problems)
    assert caught.value.exit_code is ExitCode.CONFIG
    return [str(problem) for problem in caught.value.problems]


def test_a_settings_file_becomes_its_dataclass(tmp_path: Path) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(
        """
        seed = 7
        setpoints_m = [0.073, 0.087]
        directory = "bench"
        spare = { mass_kg = 2 }
        valve.name = "Ventil µ"
        valve.mass_kg = 1.361
        [valve.friction]
        coulomb_n = 1
        """,
        encoding="utf-8",
    )
    assert parse(read_text(path), Settings, str(path)) == Settings(
        valve=Valve(mass_kg=1.361, name="Ventil µ", friction=Friction(coulomb_n=1.0)),
        spare=Valve(mass_kg=2.0),
        seed=7,
        setpoints_m=(0.073, 0.087),
        directory=Path("bench"),
    )


def test_several_mistakes_are_reported_at_once_in_the_order_of_their_lines() -> None:
    text = """# a valve
seed = -1
sead = 3

[valve]
mass_kg = 1361
mas_kg = 3

[valve.friction]
coulomb_n = "1423"
static_n = 0
[spare]
name = 4
"""
    assert mistakes(text) == [
        "line 2: seed = -1: must be greater than or equal to 0",
        "line 3: sead: unknown key; did you mean 'seed'?",
        "line 6: valve.mass_kg = 1361: must be less than or equal to 200 kg",
        "line 7: valve.mas_kg: unknown key; did you mean 'mass_kg'?",
        "line 10: valve.friction.coulomb_n = '1423': must be a valid number",
        "line 11: valve.friction.static_n = 0: must be greater than 0 N",
        "line 12: spare.mass_kg: is required and missing",
        "line 13: spare.name = 4: must be a valid string",
    ]


def test_the_same_key_in_two_tables_has_the_line_of_its_own_table() -> None:
    text = "[spare]\nmass_kg = 1\n[valve]\nmass_kg = 0\n"
    assert mistakes(text) == ["line 4: valve.mass_kg = 0: must be greater than 0 kg"]


def test_an_unknown_key_near_to_none_lists_what_is_known() -> None:
    assert mistakes("[valve]\nmass_kg = 1\n[valve.friction]\nzzz = 1\n") == [
        "line 4: valve.friction.zzz: unknown key; known here: static_n, coulomb_n"
    ]


def test_a_quoted_key_has_its_line() -> None:
    assert mistakes('[valve]\n"mass_kg" = 0\n') == ["line 2: valve.mass_kg = 0: must be greater than 0 kg"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[valve]\nmass_kg = 1\nfriction = { static_n = 0, zzz = 1 }\n", ["line 3", "line 3"]),
        ("[valve]\nmass_kg = 1\nfriction.static_n = 0\nfriction . coulomb = 1\n", ["line 3", "line 4"]),
        ("valve.mass_kg = 0\nvalve.friction.static_n = 0\n", ["line 1", "line 2"]),
        ("[valve]\nmass_kg = 1\n[ 'valve' . \"friction\" ] # of the packing\n'static_n' = 0\n", ["line 4"]),
        ("seed = 1\n[valve.friction]\nstatic_n = 1\n", ["line 2"]),
    ],
)
def test_dotted_quoted_and_inline_keys_have_their_line(text: str, expected: list[str]) -> None:
    assert [mistake.partition(":")[0] for mistake in mistakes(text)] == expected


def test_a_missing_table_is_reported() -> None:
    assert mistakes("seed = 1\n") == ["valve: is required and missing"]


@pytest.mark.parametrize("value", ["200", "1e-9"])
def test_a_value_within_its_limits_is_taken(value: str) -> None:
    assert parse(f"[valve]\nmass_kg = {value}\n", Settings, "valve.toml").valve.mass_kg == float(value)


@pytest.mark.parametrize("value", ["0", "-1", "200.001", "inf", "-inf", "nan", "true", '"1.361"', "2024-01-01", "[1]"])
def test_a_value_beyond_its_limits_or_of_another_kind_is_refused(value: str) -> None:
    (mistake,) = mistakes(f"[valve]\nmass_kg = {value}\n")
    assert mistake.startswith("line 2: valve.mass_kg = ")
    assert ": must be " in mistake


@pytest.mark.parametrize(
    ("text", "line"), [("seed = 1\nvalve = [\n", None), ("seed = 1\n[valve\n", 2), ("seed = 1\nseed : 2\n", 2)]
)
def test_a_text_that_is_not_toml_is_reported_with_its_line(text: str, line: int | None) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse(text, Settings, "valve.toml")
    (problem,) = caught.value.problems
    assert problem.where == "TOML"
    assert problem.line == line


def test_a_file_that_is_missing_or_a_directory_is_named(tmp_path: Path) -> None:
    gone = tmp_path / "gone.toml"
    with pytest.raises(ConfigurationError) as caught:
        read_text(gone)
    assert str(caught.value) == f"{gone}: file: cannot be read: No such file or directory"
    with pytest.raises(ConfigurationError, match="cannot be read: Is a directory"):
        read_text(tmp_path)


def test_a_file_that_is_not_utf_8_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "valve.toml"
    path.write_text('[valve]\nname = "Ventil µ"\n', encoding="cp1252")
    with pytest.raises(ConfigurationError, match="is not UTF-8 text"):
        read_text(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[" * 5000 + "]" * 5000, "TOML: is nested too deeply"),
        ("b = 1\n" + ".".join(["a"] * 3000) + " = 1", "line 2: TOML: has a key of more than 50 parts"),
        ("[" + " . ".join(["a"] * 52) + "]", "line 1: TOML: has a key of more than 50 parts"),
        ("a = " + "9" * 5000, "TOML: cannot be used: Exceeds the limit (4300 digits)"),
        ("a = 0x" + "f" * 5000, "TOML: cannot be used: Exceeds the limit (4300 digits)"),
    ],
)
def test_what_python_cannot_hold_is_one_clear_line(text: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        toml_reader.tables(text, "x.toml")
    assert str(caught.value).startswith(f"x.toml: {message}")
    assert "\n" not in str(caught.value)


def test_ten_thousand_mistakes_are_fifty_lines_and_a_count() -> None:
    text = "\n".join(f"surprise{number} = 1" for number in range(10_000))
    with pytest.raises(ConfigurationError) as caught:
        toml_reader.parse(text, GuardSettings, "x.toml")
    lines = str(caught.value).splitlines()
    assert len(lines) == 51
    assert lines[0].startswith("x.toml: line 1: surprise0: unknown key")
    assert lines[-1] == "x.toml: line 50: file: has 9950 more mistake(s); mend these first"


def test_a_value_that_is_very_long_is_cut() -> None:
    with pytest.raises(ConfigurationError) as caught:
        toml_reader.parse(f'frozen_s = "{"x" * 100_000}"', GuardSettings, "x.toml")
    assert 600 < len(str(caught.value)) < 1300


def test_a_file_that_never_ends_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="is larger than 1024 KiB: no settings file is"):
        read_text(Path("/dev/zero"))
