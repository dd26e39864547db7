"""The reference of every settings file: each key has a description, and what it shows is what the reader takes."""

from __future__ import annotations

import tomllib
from importlib import resources

import pytest

from documents import campaign, configuration, plant, scenario
from documents.keys import REQUIRED, Table
from positioner.bench.scenario import parse_scenario
from positioner.campaign.schema import CampaignFile
from positioner.errors import ConfigurationError
from positioner.inputs.toml_reader import build

TABLES = configuration.tables()
PAGES = {"configuration": configuration, "plant": plant, "scenario": scenario, "campaign": campaign}
EVERY = [(name, table) for name, page in PAGES.items() for table in page.tables()]


@pytest.mark.parametrize(
    "table", [table for _, table in EVERY], ids=[f"{name} {table.names[0]}" for name, table in EVERY]
)
def test_every_table_and_every_key_is_described_in_the_docstring_of_its_class(table: Table) -> None:
    assert all(table.texts) or table.names == ("",)
    assert [key.name for key in table.keys if len(key.text.split()) < 2 or not key.text.endswith(".")] == []


def test_the_reference_has_every_key_of_the_example() -> None:
    text = (resources.files("positioner") / "example.toml").read_text(encoding="utf-8")
    known = {f"{name}.{key.name}" for table in TABLES for name in table.names for key in table.keys}

    def keys(tree: dict[str, object], name: str) -> set[str]:
        inner = {f"{name}{key}.": value for key, value in tree.items() if isinstance(value, dict)}
        own = {f"{name}{key}" for key, value in tree.items() if not isinstance(value, dict)}
        return own.union(*(keys(value, path) for path, value in inner.items()))

    shown = keys(tomllib.loads(text), "")
    assert len(shown) > 130
    assert shown - known == set()


@pytest.mark.parametrize(
    ("page", "row"),
    [
        (
            "configuration",
            "| `mass_kg` | number | 0.01 to 200 | kg | `1.361` | m, moving mass: plug, stem and diaphragm",
        ),
        (
            "configuration",
            '| `action` | `"direct"`, `"reverse"` |  |  | `"direct"` | the direction of action; "reverse"',
        ),
        ("configuration", "| `proportional_gain_ma_per_m` | number | 0 to 100000 | mA/m | `465.8` | K_p, current per"),
        ("configuration", "| `stuck` | force on a stem that rests, times its static friction. | 1.5 | failure |  |  |"),
        ("configuration", "| `points` | list of lists of numbers |  |  | `[]` | (signal, travel) of a characteristic"),
        (
            "configuration",
            "| `identifiers` | table of integers | 0 to 2047 |  |  | other identifiers for single frames",
        ),
        ("configuration", "| `signals` | table of texts |  |  | required | the signal for each field of our message"),
        ("plant", "| `mass_kg` | number | 0.01 to 200 | kg | `1.361` | m, moving mass. |"),
        (
            "plant",
            '| `noise_shape` | `"gaussian"`, `"uniform"` |  |  | `"gaussian"` | "gaussian", or "uniform" with the',
        ),
        ("plant", "| `at_s` | number | 0 to 1e+09 | s | required | Plant time at which the change begins. |"),
        ("plant", "| `slew_pa_per_s` | number | 0 to 1e+09 | Pa/s | `0` | "),
        ("plant", "## [[schedule]]"),
        ("scenario", "| `seed` | integer | 0 to 4294967295 |  | `1` | Of every random number"),
        (
            "scenario",
            "| `setpoints_mm` | list of numbers | at least 1 of them, each 0 to 661 | mm | required | Setpoints of",
        ),
        ("scenario", "| `dwell_s` | number | above 0 to 3600 | s | required | How long each setpoint is held; a whole"),
        (
            "scenario",
            "| `table_from_s` | number | at least 0 | s |  | When the law begins to use the stiction table; left",
        ),
        ("scenario", "| `wire` | table |  |  |  | Frames of the user's own"),
        ("campaign", "| `title` | text | 1 to 80 characters |  | required | its heading. |"),
        ("campaign", '| `kind` | `"grid"`, `"latin-hypercube"`, `"sobol"` |  |  | required | every combination'),
        ("campaign", "| `levels` | integer | 2 to 1000 |  |  | how many values of the range a grid takes, both ends"),
        ("campaign", "## [parameters.NAME]"),
    ],
)
def test_a_row_of_a_page_shows_kind_limits_unit_default_and_description(page: str, row: str) -> None:
    assert row in PAGES[page].page()


def required(tables: list[Table], name: str) -> set[str]:
    (table,) = [each for each in tables if each.names == (name,)]
    return {key.name for key in table.keys if key.default == REQUIRED}


def test_what_the_reference_calls_required_is_what_the_readers_miss_in_an_empty_file() -> None:
    with pytest.raises(ConfigurationError) as error:
        parse_scenario("", "empty.toml")
    assert {problem.where for problem in error.value.problems} == required(scenario.tables(), "")
    with pytest.raises(ConfigurationError) as error:
        build({"design": {}}, CampaignFile, "empty.toml")
    missing = {problem.where for problem in error.value.problems}
    inside = {f"design.{name}" for name in required(campaign.tables(), "design")}
    assert missing == required(campaign.tables(), "") | inside | {"parameters"}
