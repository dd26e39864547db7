"""The configuration of one positioner: every mistake at once, with its line, its limits and the nearest known key."""

from __future__ import annotations

import re
import tomllib
from dataclasses import fields, is_dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import pytest

from positioner.cli.check import warnings
from positioner.config.reader import load_config, parse_config
from positioner.config.schema import Configuration
from positioner.errors import ConfigurationError, ExitCode
from positioner.laws.registry import LAWS
from positioner.wire.messages import StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator

RETIRED = {"control.nmpc"}
DBC = """VERSION ""
BU_: PLANT POSITIONER
BO_ 512 VALVE_FEEDBACK: 8 PLANT
 SG_ StemPosition : 0|32@1+ (0.001,0) [0|0] "mm" POSITIONER
"""
OWN_FRAMES = """[valve]
id = "v"
preset = "paper"
[wire]
dbc = "{dbc}"
[wire.stem_position]
message = "VALVE_FEEDBACK"
signals = {{ position_m = "{signal}" }}
"""


def problems_of(text: str, base: Path = Path()) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        parse_config(text, "valve.toml", base)
    assert caught.value.exit_code is ExitCode.CONFIG
    return str(caught.value).splitlines()


def test_an_id_and_the_name_of_a_valve_are_all_it_takes() -> None:
    configuration = parse_config('[valve]\nid = "FV-101"\npreset = "paper"\n', "valve.toml", Path())
    assert configuration == Configuration(valve=configuration.valve)
    assert configuration.valve.id == "FV-101"
    assert configuration.make_law().name == "nmpc"
    assert configuration.make_codec().by_kind[StemPosition].arbitration_id == 0x110


def test_settings_of_an_older_version_have_no_effect_and_are_told_in_one_line() -> None:
    minimal = '[valve]\nid = "FV-101"\npreset = "real-valve"\n'
    old = "[control.nmpc]\ntolerance_m = 1e-4\n[control.nmpc.lagged]\nlag_doubt = 0.3\n"
    found = parse_config(minimal + old, "valve.toml", Path())
    (line,) = found.retired
    assert line == "[control.nmpc] is of an older version and has no effect; leave it out: tolerance_m, lagged"
    assert line in warnings(found)
    plain = parse_config(minimal, "valve.toml", Path())
    assert plain.retired == ()
    assert found.make_law().name == plain.make_law().name == "nmpc"


def test_the_commented_example_shows_the_defaults() -> None:
    text = (resources.files("positioner") / "example.toml").read_text(encoding="utf-8")
    minimal = parse_config('[valve]\nid = "FV-101"\npreset = "paper"\n', "valve.toml", Path())
    assert parse_config(text, "example.toml", Path()) == minimal


def test_the_commented_example_shows_every_key_and_no_other() -> None:
    text = (resources.files("positioner") / "example.toml").read_text(encoding="utf-8")
    keys = ({".".join(key) for key in keys_of(Configuration)} | {"valve.preset"}) - RETIRED
    # a key without a default stands behind a comment, with an example
    uncommented = re.sub(r"^# (\w+ = |\[)", r"\1", text, flags=re.MULTILINE)
    shown = set(shown_keys(tomllib.loads(uncommented), (), keys))
    assert sorted(keys - shown) == []
    assert sorted(shown - keys) == []


def keys_of(kind: Any, table: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield every key that a configuration may have, from its dataclasses."""
    hints = get_type_hints(kind)
    for each in fields(kind):
        kinds = (hints[each.name], *get_args(hints[each.name]))
        below = next((inner for inner in kinds if is_dataclass(inner)), None)
        if below is None:
            yield (*table, each.name)
        else:
            yield from keys_of(below, (*table, each.name))


def shown_keys(tables: dict[str, Any], table: tuple[str, ...], keys: set[str]) -> Iterator[str]:
    """Yield the keys in a file; a table that is itself a key, such as the options of a bus, is one."""
    for name, value in tables.items():
        key = ".".join((*table, name))
        if isinstance(value, dict) and key not in keys:
            yield from shown_keys(value, (*table, name), keys)
        else:
            yield key


def test_every_mistake_is_reported_at_once_with_its_line() -> None:
    text = """[valve]
id = "v"
preset = "paper"
mass_kg = 1361.0
spring_rate_n_per_mm = 52.5
[control]
law = "papr"
sample_period_s = 0.0
[guard]
current_low_ma = 3.0
[wire]
dbc = "missing.dbc"
[buss]
channel = "can0"
"""
    problems = problems_of(text)
    assert [line.split(":")[1].strip() for line in problems] == [f"line {n}" for n in (4, 5, 7, 8, 10, 12, 13)]
    assert "valve.mass_kg = 1361.0: must be less than or equal to 200" in problems[0]
    assert "unknown key; did you mean 'spring_rate_n_per_m'?" in problems[1]
    assert "control.law = 'papr': is no law; did you mean 'paper'?" in problems[2]
    assert "must be greater than or equal to 0.00001" in problems[3]
    assert "must be greater than or equal to 3.8" in problems[4]
    assert "missing.dbc" in problems[5]
    assert "did you mean 'bus'?" in problems[6]


def test_the_rules_between_keys_are_asked_beside_wrong_values_and_in_every_table() -> None:
    text = """[valve]
id = "FV 101"
preset = "paper"
span_m = 101.6
static_friction_n = 100.0
coulomb_friction_n = 200.0
travel_min_m = 0.3
[bus]
interface = "socketcann"
[guard]
current_low_ma = 12.0
current_high_ma = 11.0
feedback_hold_periods = 6
feedback_failsafe_periods = 5
auto_arm = "yes"
[control]
sample_period_s = true
[setpoint]
travel_low = 0.9
travel_high = 0.1
points = [[0.0, 0.0], [1.0, 1.0]]
"""
    assert problems_of(text) == [
        f"valve.toml: {line}"
        for line in (
            "line 1: valve: coulomb_friction_n exceeds static_friction_n: sliding friction is never the larger",
            "line 1: valve: travel_max_m must be greater than travel_min_m",
            "line 2: valve.id = 'FV 101': must be 1 to 64 letters, digits, dots, dashes or underscores",
            "line 4: valve.span_m = 101.6: must be less than or equal to 1.3 m; did you mean 0.1016? Lengths are in m",
            "line 9: bus.interface = 'socketcann': is unknown; did you mean 'socketcan'?",
            "line 10: guard: current_low_ma must be below current_high_ma",
            "line 10: guard: feedback_failsafe_periods must exceed feedback_hold_periods",
            "line 15: guard.auto_arm = 'yes': must be true or false",
            "line 17: control.sample_period_s = true: must be a valid number",
            "line 18: setpoint: travel_low must be below travel_high",
            'line 18: setpoint: points belong to characteristic = "points", and to no other',
        )
    ]


def test_a_wrong_value_makes_no_rule_of_its_table_look_broken() -> None:
    guard = "[guard]\ncurrent_low_ma = 30.0\ncurrent_high_ma = 4.0\n"
    (line,) = problems_of(f'[valve]\nid = "v"\npreset = "paper"\n{guard}')
    assert "guard.current_low_ma = 30.0: must be less than" in line


@pytest.mark.parametrize(("key", "given", "meant"), [("backlash_m", 0.2, "0.0002"), ("travel_min_m", -5, "-0.005")])
def test_a_length_in_millimetres_is_guessed(key: str, given: float, meant: str) -> None:
    (line,) = problems_of(f'[valve]\nid = "v"\npreset = "paper"\n{key} = {given}\n')
    assert line.endswith(f" m; did you mean {meant}? Lengths are in m")


def test_a_length_that_is_none_in_millimetres_either_gets_no_guess() -> None:
    for text in ("span_m = 5000.0", "spring_rate_n_per_m = 1e9", "backlash_m = -0.2"):
        (line,) = problems_of(f'[valve]\nid = "v"\npreset = "paper"\n{text}\n')
        assert "did you mean" not in line


def test_a_file_and_a_socket_of_the_metrics_have_places_of_their_own() -> None:
    text = '[valve]\nid = "v"\npreset = "paper"\n[metrics]\nfile = "m"\nsocket = '
    assert problems_of(f'{text}"m"\n') == ["valve.toml: line 4: metrics: file and socket must be two places"]
    assert parse_config(f'{text}"n"\n', "valve.toml", Path()).metrics.is_on


def test_a_missing_valve_is_reported() -> None:
    assert problems_of("") == ["valve.toml: valve: is required and missing"]
    assert "valve.toml: line 1: valve.id: is required and missing" in problems_of("[valve]\n")


def test_what_is_no_toml_is_reported_with_its_line() -> None:
    (line,) = problems_of('[valve]\nid = "v\n')
    assert line.startswith("valve.toml: line 2: TOML:")


def test_a_law_that_resembles_none_gets_the_list() -> None:
    (line,) = problems_of('[valve]\nid = "v"\npreset = "paper"\n[control]\nlaw = "zzz"\n')
    assert line == f"valve.toml: line 5: control.law = 'zzz': is no law; known: {', '.join(LAWS)}"


def test_a_law_that_is_no_name_is_reported_once() -> None:
    (line,) = problems_of('[valve]\nid = "v"\npreset = "paper"\n[control]\nlaw = 3\n')
    assert line == "valve.toml: line 5: control.law = 3: must be a valid string"


@pytest.mark.parametrize("text", ['control = 3\nwire = 3\n[valve]\nid = "v"\npreset = "paper"\n'])
def test_a_value_in_the_place_of_a_table_is_reported_once(text: str) -> None:
    problems = problems_of(text)
    assert [line.split(":")[1].strip() for line in problems] == ["line 1", "line 2"]


def test_limits_that_contradict_each_other_are_reported() -> None:
    (line,) = problems_of(
        '[valve]\nid = "v"\npreset = "paper"\nstatic_friction_n = 100.0\ncoulomb_friction_n = 200.0\n'
    )
    assert "coulomb_friction_n exceeds static_friction_n" in line


def test_numbers_that_are_none_are_refused() -> None:
    problems = problems_of('[valve]\nid = "v"\npreset = "paper"\nmass_kg = nan\nspan_m = inf\nbench_set_n = "0"\n')
    assert [line.split(":")[1].strip() for line in problems] == ["line 4", "line 5", "line 6"]


def test_a_relative_dbc_lies_beside_the_configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "mine.dbc").write_text(DBC, encoding="utf-8")
    path = tmp_path / "there" / "valve.toml"
    path.write_text(OWN_FRAMES.format(dbc="mine.dbc", signal="StemPosition"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    configuration = load_config(path)
    assert configuration.wire.dbc == tmp_path / "there" / "mine.dbc"
    assert configuration.make_codec().by_kind[StemPosition].arbitration_id == 512


def test_a_relative_state_directory_lies_beside_the_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "there" / "valve.toml"
    path.parent.mkdir()
    path.write_text('[valve]\nid = "v"\npreset = "paper"\n[state]\ndirectory = "kept/here"\n', encoding="utf-8")
    for cwd in (tmp_path, path.parent):
        monkeypatch.chdir(cwd)
        assert load_config(path).state_directory == tmp_path / "there" / "kept" / "here"


def test_an_absolute_dbc_stays_where_it_is(tmp_path: Path) -> None:
    (tmp_path / "mine.dbc").write_text(DBC, encoding="utf-8")
    text = OWN_FRAMES.format(dbc=tmp_path / "mine.dbc", signal="StemPosition")
    assert parse_config(text, "valve.toml", Path("/elsewhere")).wire.dbc == tmp_path / "mine.dbc"


def test_a_signal_that_the_dbc_does_not_hold_is_reported_beside_other_mistakes(tmp_path: Path) -> None:
    (tmp_path / "mine.dbc").write_text(DBC, encoding="utf-8")
    text = OWN_FRAMES.format(dbc="mine.dbc", signal="StemPositon") + "[guard]\nmax_jump_m = -1.0\n"
    problems = problems_of(text, tmp_path)
    assert len(problems) == 2
    assert "line 8" in problems[0]
    assert "StemPositon" in problems[0]
    assert "line 10" in problems[1]


def test_a_configuration_that_cannot_be_read_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load_config(tmp_path / "none.toml")


def test_the_state_directory_is_the_given_one_or_the_service_managers_or_the_users(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    plain = parse_config('[valve]\nid = "FV-101"\npreset = "paper"\n', "valve.toml", Path())
    given = parse_config(
        '[valve]\nid = "FV-101"\npreset = "paper"\n[state]\ndirectory = "/srv/table"\n', "valve.toml", Path()
    )
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/positioner/a:/var/lib/positioner/b")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert given.state_directory == Path("/srv/table")
    assert plain.state_directory == Path("/var/lib/positioner/a")
    monkeypatch.delenv("STATE_DIRECTORY")
    assert plain.state_directory == tmp_path / "positioner" / "FV-101"
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert plain.state_directory == tmp_path / ".local" / "state" / "positioner" / "FV-101"
