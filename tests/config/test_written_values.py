"""Values written into a configuration: their lines change, and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from positioner.config.reader import load_config, load_valves
from positioner.config.written_values import write_values
from positioner.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

TEXT = """\
# the valve behind pump 3
[valve]
id = "FV-101"     # identity
preset = "paper"
spring_rate_n_per_m = 60000.0   # from the datasheet

[control]
sample_period_s = 0.001 # fast
"""
TABLES = {
    "valve": {"spring_rate_n_per_m": 52538.123456, "static_friction_n": 1700.0},
    "valve.actuator": {"fill_time_constant_s": 0.05, "vent_time_constant_s": 0.04},
    "estimator": {"noise_of_reading": 0.0},
}


def test_each_value_stands_in_its_table_and_comments_stay(tmp_path: Path) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(TEXT, encoding="utf-8")
    backup = write_values(path, TABLES, "FV-101")
    assert backup.read_text(encoding="utf-8") == TEXT
    written = path.read_text(encoding="utf-8")
    assert "spring_rate_n_per_m = 52538.1   # from the datasheet" in written
    for line in TEXT.splitlines():
        assert line.startswith("spring") or line in written
    configuration = load_config(path)
    assert configuration.valve.static_friction_n == 1700.0
    assert configuration.valve.actuator.vent_time_constant_s == 0.04
    assert configuration.estimator.noise_of_reading == 0.0
    assert configuration.control.sample_period_s == 0.001


def test_a_second_backup_does_not_replace_the_first(tmp_path: Path) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(TEXT, encoding="utf-8")
    first, second = write_values(path, TABLES, "FV-101"), write_values(path, TABLES, "FV-101")
    assert first != second
    assert first.read_text(encoding="utf-8") == TEXT


def test_a_file_of_another_form_is_refused_and_stays(tmp_path: Path) -> None:
    path = tmp_path / "valve.toml"
    text = 'valve = { id = "FV-101", preset = "paper" }\n'
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match="beyond --write"):
        write_values(path, TABLES, "FV-101")
    assert path.read_text(encoding="utf-8") == text
    assert not list(tmp_path.glob("*.backup*"))


SEVERAL = """\
[estimator]
noise_of_reading = 0.02  # the same sensor everywhere

[[valve]]
id = "FV-101"
preset = "paper"
wire.id_offset = 128

[[valve]]
id = "FV-102"
preset = "paper"   # the bigger one
spring_rate_n_per_m = 60000.0
[valve.wire]
id_offset = 256

[[valve]]
id = "FV-103"
preset = "paper"
wire.id_offset = 384
"""


@pytest.mark.parametrize("name", ["FV-101", "FV-102", "FV-103"])
def test_of_several_valves_only_the_named_one_changes(tmp_path: Path, name: str) -> None:
    path = tmp_path / "valves.toml"
    path.write_text(SEVERAL, encoding="utf-8")
    before = {each.valve.id: each for each in load_valves(path)}
    write_values(path, TABLES, name)
    after = {each.valve.id: each for each in load_valves(path)}
    assert list(after) == list(before)
    for other, settings in before.items():
        if other != name:
            assert after[other] == settings
    assert after[name].valve.spring_rate_n_per_m == 52538.1
    assert after[name].valve.actuator.vent_time_constant_s == 0.04
    assert after[name].estimator.noise_of_reading == 0.0
    assert after[name].wire == before[name].wire
    written = path.read_text(encoding="utf-8")
    for line in SEVERAL.splitlines():
        assert line.startswith("spring") or line in written


def test_a_new_key_of_a_table_stands_before_the_tables_inside_it(tmp_path: Path) -> None:
    path = tmp_path / "valve.toml"
    inside = "[valve.actuator]\nfill_time_constant_s = 0.1\nvent_time_constant_s = 0.1\n\n[control]"
    path.write_text(TEXT.replace("[control]", inside), encoding="utf-8")
    write_values(path, TABLES, "FV-101")
    valve = load_config(path).valve
    assert (valve.static_friction_n, valve.actuator.fill_time_constant_s) == (1700.0, 0.05)
