from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from store_helpers import series, tables, taught

from positioner.errors import ConfigurationError
from positioner.store import document, messages

if TYPE_CHECKING:
    from positioner.store.content import StoredTable


@given(tables())
@settings(max_examples=60)
def test_a_table_survives_the_way_through_a_document(stored: StoredTable) -> None:
    assert document.loads(document.dumps(stored), "x") == stored


@given(tables())
@settings(max_examples=30)
def test_a_table_survives_the_way_through_a_message(stored: StoredTable) -> None:
    message = messages.Adopt(stored)
    assert messages.decode(messages.encode(message)) == message


def test_samples_survive_the_way_through_a_message_bit_for_bit() -> None:
    message = messages.Learn(3, tuple(series(50)))
    assert messages.decode(messages.encode(message)) == message


def _plain() -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(document.dumps(taught(series(30))))
    return plain


def _set(path: str, value: object) -> dict[str, Any]:
    plain = _plain()
    place: Any = plain
    *parents, last = path.split(".")
    for name in parents:
        place = place[int(name)] if name.isdigit() else place[name]
    place[last] = value
    return plain


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("format", "else", 'x: file: is not a stiction table: no "format": "positioner-stiction-table"'),
        ("schema", 3, "x: schema: must be 1 or 2, not 3"),
        ("valve", "", "x: valve: must be a printable text, not ''"),
        ("valve", "a\nb", "x: valve: must be a printable text, not 'a\\nb'"),
        ("cell_width_m", 0, "x: cell_width_m: must be greater than or equal to 0.000001, not 0"),
        ("cell_width_m", float("nan"), "x: cell_width_m: must be a finite number, not nan"),
        ("cell_width_m", True, "x: cell_width_m: must be a valid number, not True"),
        ("generation", -1, "x: generation: must be greater than or equal to 0, not -1"),
        ("sequence", 29, "x: sequence: must be at least 30, as the cells say, not 29"),
        ("sequence", 1e3, "x: sequence: must be a valid integer, not 1000.0"),
        ("surprise", 1, "x: surprise: unknown key"),
        ("cells", {}, "x: cells: must be a list"),
        ("cells.0.quantity", "speed", "x: cells[0].quantity: must be 'stick_speed_m_per_s', 'breakaway"),
        ("cells.0.direction", "up", "x: cells[0].direction: must be 'opening' or 'closing', not 'up'"),
        ("cells.0.index", 1.5, "x: cells[0].index: must be a valid integer, not 1.5"),
        ("cells.0.samples", [], "x: cells[0]: count must fit the 0 samples: the last 10 are kept"),
        ("cells.0.samples", [1.0] * 11, "x: cells[0]: count must fit the 11 samples: the last 10 are kept"),
        ("cells.0.samples", ["1"], "x: cells[0].samples[0]: must be a valid number, not '1'"),
        ("cells.0.samples", [1e999], "x: cells[0].samples[0]: must be a finite number, not inf"),
        ("cells.0.samples", [1.0, 2.0], "x: cells[0]: count must fit the 2 samples: the last 10 are kept"),
        ("cells.0.sequence", 0, "x: cells[0].sequence: must be greater than or equal to 1, not 0"),
        ("cells.0.recorded", "yesterday", "x: cells[0].recorded: must be a UTC time from 1970 to 9999 like"),
        ("cells.0.recorded", "1969-12-31T23:59:59Z", "x: cells[0].recorded: must be a UTC time from 1970"),
        ("cells.0.colour", 1, "x: cells[0].colour: unknown key"),
        ("cells.0", 7, "x: cells[0]: must be an object"),
        (
            "cells.0.samples",
            [1e308],
            "x: cells[0]: samples of breakaway_current_ma must be from -100 to 100, not 1e+308",
        ),
        ("sequence", 2**53, "x: sequence: must be less than or equal to 4503599627370496, not such a large number"),
        ("sequence", 10**4000, "x: sequence: must be less than or equal to 4503599627370496, not such a large"),
        ("cells.0.index", 10**7, "x: cells: lie farther away than 10 m"),
    ],
)
def test_each_mistake_in_a_document_is_one_clear_line(path: str, value: object, line: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        document.from_plain(_set("cells", [value]) if path == "cells.0" else _set(path, value), "x")
    assert str(caught.value).startswith(line)
    assert len(caught.value.problems) == 1


def test_all_mistakes_are_reported_at_once() -> None:
    plain = _set("valve", 7)
    plain["cells"][0]["count"] = 0
    plain["cells"][2]["index"] = None
    with pytest.raises(ConfigurationError) as caught:
        document.from_plain(plain, "x")
    assert [problem.where for problem in caught.value.problems] == ["valve", "cells[0].count", "cells[2].index"]


def test_a_negative_stick_speed_is_refused_and_a_negative_landing_bias_is_not() -> None:
    plain = _plain()
    for cell in plain["cells"]:
        if cell["quantity"] == "landing_bias_m":
            cell["samples"] = [-value for value in cell["samples"]]
    document.from_plain(plain, "x")
    speed = next(cell for cell in plain["cells"] if cell["quantity"] == "stick_speed_m_per_s")
    speed["samples"] = [-0.1]
    with pytest.raises(ConfigurationError, match=r"must be from 0 to 100, not -0\.1"):
        document.from_plain(plain, "x")


def test_a_cell_given_twice_is_refused() -> None:
    plain = _plain()
    plain["cells"].append(plain["cells"][0])
    plain["sequence"] = 100
    with pytest.raises(ConfigurationError, match="hold a second cell for"):
        document.from_plain(plain, "x")


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "nonsense"])
def test_what_is_not_json_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^x: file: is not JSON: [^\n]*$"):
        document.loads(text, "x")


def test_a_document_has_a_line_for_each_cell() -> None:
    stored = taught(series(30))
    text = document.dumps(stored)
    assert len(text.splitlines()) == 1 + len(stored.table)
    assert json.loads(text)["sequence"] == 30
