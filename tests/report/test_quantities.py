"""Measured quantities as a table: digits, intervals, what was not measured, the change since a reference."""

from __future__ import annotations

from typing import Any

from positioner.report.quantities import quantity_table

THIN = "\N{NARROW NO-BREAK SPACE}"


def row(name: str, unit: str, value: float, low: float | None, high: float | None, *, seen: bool = True) -> Any:
    return {"name": name, "unit": unit, "value": value, "low": low, "high": high, "seen": seen}


SPRING = row("spring rate", "N/m", 52538.4, 52520.0, 52551.6)
FRICTION = row("friction", "N", 1422.6, 1422.6, 1422.6)


def test_a_value_has_the_digits_of_the_largest_of_its_unit_and_its_interval_the_same() -> None:
    table = quantity_table([SPRING, FRICTION, row("force", "N", -0.25, -3.2, 2.7)])
    assert table.head == ("quantity", "unit", "value", "95 % interval")
    assert table.rows == (
        ("spring rate", "N/m", f"52{THIN}538", f"52{THIN}520 to 52{THIN}552"),
        ("friction", "N", f"1{THIN}423", ""),
        ("force", "N", "0", "−3 to 3"),
    )


def test_a_value_of_nothing_has_the_digits_of_its_interval() -> None:
    assert quantity_table([row("lag", "ms", 0.0, 0.0, 0.9801)]).rows == (("lag", "ms", "0", "0 to 0.980"),)
    assert quantity_table([row("band", "%", float("nan"), 0.0, 0.1)]).rows == (("band", "%", "–", "0 to 0.100"),)
    assert quantity_table([row("band", "%", 0.0, None, None)]).rows == (("band", "%", "0"),)


def test_what_was_not_measured_has_no_value() -> None:
    table = quantity_table([SPRING, row("Stribeck velocity", "mm/s", 0.254, 0.0, None, seen=False)])
    assert table.rows[1][2:] == ("–", "not measured")


def test_a_change_is_in_percent_of_the_reference_in_the_same_unit() -> None:
    before = [row("friction", "N", 1185.5, 0.0, 0.0), row("spring rate", "N/mm", 52.5, 0.0, 0.0)]
    table = quantity_table([SPRING, FRICTION], before)
    assert table.head == ("quantity", "unit", "value", "95 % interval", "reference", "change")
    assert table.rows[0][4:] == ("–", "–")
    assert table.rows[1][3:] == ("", f"1{THIN}186", f"+20.0{THIN}%")
