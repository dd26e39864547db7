"""The reference of the configuration: every key has a description, and what it shows is what the reader takes."""

from __future__ import annotations

import tomllib
from importlib import resources

import pytest

from documents import plant
from documents.configuration import Table, page, tables

TABLES = tables()


@pytest.mark.parametrize("table", [*TABLES, *plant.tables()], ids=lambda table: table.names[0] or "top")
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
    assert len(shown) > 150
    assert shown - known == set()


@pytest.mark.parametrize(
    "row",
    [
        "| `mass_kg` | number | 0.01 to 200 | kg | `1.361` | m, moving mass: plug, stem and diaphragm plate. |",
        '| `action` | `"direct"`, `"reverse"` |  |  | `"direct"` | the direction of action; "reverse"',
        "| `proportional_gain_ma_per_m` | number | 0 to 100000 | mA/m | `465.8` | K_p, current per error. |",
        "| `stuck` | force on a stem that rests, times its static friction. | 1.5 | failure |  |  |",
    ],
)  # fmt: skip
def test_a_row_of_the_page_shows_kind_limits_unit_default_and_description(row: str) -> None:
    assert row in page()


@pytest.mark.parametrize(
    "row",
    [
        "| `mass_kg` | number | 0.01 to 200 | kg | `1.361` | m, moving mass. |",
        '| `noise_shape` | `"gaussian"`, `"uniform"` |  |  | `"gaussian"` | "gaussian", or "uniform" with the same ',
        "| `at_s` | number | 0 to 1e+09 | s |  | Plant time at which the change begins. |",
        "| `slew_pa_per_s` | number | 0 to 1e+09 | Pa/s | `0` | ",
        "## [[schedule]]",
    ],
)
def test_the_reference_of_plant_files_has_every_kind_of_table(row: str) -> None:
    assert row in plant.page()
