"""The page of a report: what stands first, that nothing is fetched, and that texts stay texts."""

from __future__ import annotations

import re

import pytest
from report_samples import HOSTILE, SIGNATURE, result, signature

from positioner.report.chart import Chart
from positioner.report.layers import Limit, Line
from positioner.report.page import Page, Section, Status, Verdict, html
from positioner.report.procedure_page import procedure_page, section_of
from positioner.report.procedure_section import missing_section
from positioner.report.table import Table


def test_the_verdict_stands_before_everything_else() -> None:
    page = Page("FV-101", "report", (Section("Signature"),), Verdict(Status.FAILURE, "The stem sticks.", "Repair it."))
    text = html(page)
    order = [
        text.index(part) for part in ("<h1>FV-101", "<h2>Failure</h2>", "The stem sticks.", "Repair it.", "<main>")
    ]
    assert order == sorted(order)


@pytest.mark.parametrize("status", Status)
def test_each_status_has_its_own_symbol_which_needs_no_colour(status: Status) -> None:
    def symbol(each: Status) -> str:
        text = html(Page("FV-101", "report", (), Verdict(each, "", "")))
        return text[text.index('<svg class="symbol"') : text.index("</svg>")].split("\n", 1)[1]

    others = [symbol(each) for each in Status if each is not status]
    assert symbol(status) not in others


def test_no_address_is_in_the_page_and_no_script() -> None:
    text = html(procedure_page(result("signature", SIGNATURE), None, (("configuration", "fv101.toml"),)))
    assert not re.search(r"(https?:)?//|<script|@import|url\(|\bon\w+=", text)
    assert re.findall(r'(?:src|href)="([^"]*)"', text) == ["data:,"]


def test_a_hostile_text_stays_a_text() -> None:
    chart = Chart(HOSTILE, HOSTILE, HOSTILE, (Line([0, 1], [0, 1], HOSTILE), Limit(0.5, HOSTILE, "failure")))
    section = Section(HOSTILE, HOSTILE, (chart,), (Table((HOSTILE,), ((HOSTILE,),), HOSTILE),), (HOSTILE,), HOSTILE)
    verdict = Verdict(Status.GOOD, HOSTILE, HOSTILE)
    text = html(Page(HOSTILE, HOSTILE, (section,), verdict, ((HOSTILE, HOSTILE),)))
    assert "<b onclick" not in text
    assert text.count("&lt;b onclick") >= 15


@pytest.mark.parametrize("key", ["sliding_friction_by_place", "breakaways", "rows", "loop"])
@pytest.mark.parametrize("wrong", [3, [3], [[]], [{}], {"a": 1}, "abc"])
def test_a_damaged_result_is_told_and_spoils_no_report(key: str, wrong: object) -> None:
    good, bad = result("signature", SIGNATURE, "a"), result("signature", SIGNATURE | {key: wrong}, "b")
    assert "run positioner signature --as-reference again" in section_of(bad, good).missing
    assert html(Page("FV-101", "report", (section_of(good, bad),)))


def test_what_is_not_measured_names_the_command_that_measures_it() -> None:
    section = missing_section("Signature", "positioner signature --config fv101.toml", "measures friction by place")
    text = html(Page("FV-101", "report", (section,)))
    assert "Not measured yet. Run positioner signature --config fv101.toml: it measures friction by place." in text


def test_a_result_is_compared_with_the_reference_of_its_kind_and_not_with_itself() -> None:
    first, later = result("signature", SIGNATURE, "a"), result("signature", signature(1.27), "b")
    assert section_of(later, first).tables[0].head == (
        "quantity",
        "unit",
        "value",
        "95 % interval",
        "reference",
        "change",
    )
    assert section_of(first, first).tables[0].head == ("quantity", "unit", "value", "95 % interval")
    assert "this is the reference" in section_of(first, first).since
    rows = {row[0]: row for row in section_of(later, first).tables[0].rows}
    cells = [cell.replace("\N{NARROW NO-BREAK SPACE}", "") for cell in rows["sliding friction"][2:]]
    assert cells == ["1807", "1800 to 1814", "1423", "+27.0%"]
    assert rows["spring force at 0"][-2:] == ("0", "–")
