"""Each procedure's own document, of an emulated valve, is shown whole: nothing of it is called damaged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from report_samples import result
from step_plant import LOW, make_test
from step_plant import play as play_steps
from stroke_runs import configured
from stroke_runs import play as play_stroke

from plant_emulator.presets import plant_settings
from positioner.commissioning.step.report import as_json as step_json
from positioner.commissioning.step.result import result_of
from positioner.commissioning.stroke.report import as_json as stroke_json
from positioner.report.page import Page, Status, html
from positioner.report.procedure_page import section_of, verdict_of

if TYPE_CHECKING:
    from collections.abc import Callable


def step_document() -> dict[str, Any]:
    test = make_test("paper", LOW, "hold", sizes=(0.1, 0.8), repeats=1, wait_s=0.5, ladder=0.05)
    return step_json(result_of(play_steps(test, "paper", LOW).memory, test), "FV-101", ())


def stroke_document() -> dict[str, Any]:
    configuration = configured()
    plant = plant_settings("paper", {"sensor": LOW, "valve": {"initial_position_m": 0.08}})
    played = play_stroke(configuration, plant)
    assert played.result is not None
    return stroke_json(played.result, configuration.valve, configuration.stroke_test)


@pytest.mark.parametrize(("kind", "document"), [("step-test", step_document), ("stroke-test", stroke_document)])
def test_it_is_shown_with_figures_and_over_itself(kind: str, document: Callable[[], dict[str, Any]]) -> None:
    measured = document()
    newest, first = result(kind, measured, "b"), result(kind, measured, "a")
    section = section_of(newest, first)
    assert not section.missing
    assert len(section.charts) == 2
    assert len(section.facts) + sum(len(table.rows) for table in section.tables) >= 4
    open_between = [table.head for table in section.tables if "lies between" in table.head]
    assert len(open_between) == (kind == "step-test")
    assert html(Page("FV-101", "report", (section,))).count('class="reference"') >= 2
    verdict = verdict_of(newest)
    assert (verdict.status if verdict else None) == (Status.GOOD if kind == "stroke-test" else None)
