"""The report of `positioner reproduce` as Markdown and as JSON: figures and assessments. Pure."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from positioner.report.table import Table
from positioner.report.text import markdown
from positioner.studies.interpretations import Units
from positioner.studies.reproduce import VISIBLE_M, WITH_TABLE
from positioner.studies.reproduce_pictures import NOISES, TITLES, UNITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.report.text import Block
    from positioner.studies.interpretations import Interpretation
    from positioner.studies.published_results import Assessment
    from positioner.studies.reproduce import Half, PlayedRun

_FIGURES = ("error, %", "range, %", "overshoot, %", "reversals", "limit cycles", "current range, mA", "speed, mm/s")


def to_markdown(played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]) -> str:
    """Return the text in Markdown."""
    return markdown(blocks(played_runs, assessments))


def blocks(played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]) -> list[Block]:
    """Return the interpretations, the published results beside ours, and the figures of every run."""
    interpretations = sorted({played.run.interpretation for played in played_runs})
    return [
        "# The paper's five simulations",
        "",
        *_heading(played_runs, interpretations),
        "",
        "## Published results, and what our runs show",
        "",
        _assessment_table(assessments, interpretations),
        "",
        "## The figures",
        "",
        *_figure_table(played_runs),
    ]


def to_json(played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]) -> str:
    """Return the same as JSON: one object for each run and one for each assessment."""
    page = {
        "runs": [
            {
                "scenario": f"paper-{played.run.simulation}",
                **_name(played.run.interpretation),
                "setpoints_mm": played.run.scenario.visited_mm,
                "dwell_s": played.run.scenario.dwell_s,
                "before": asdict(played.before),
                "after": asdict(played.after),
            }
            for played in played_runs
        ],
        "verdicts": [
            {
                "simulation": assessment.simulation,
                "claim": assessment.result,
                **_name(assessment.interpretation),
                "seen": assessment.seen,
                "holds": assessment.holds,
            }
            for assessment in assessments
        ],
    }
    return json.dumps(page, indent=2, ensure_ascii=False) + "\n"


def _name(interpretation: Interpretation) -> dict[str, Any]:
    return {"noise": str(interpretation.noise), "units": str(interpretation.units)}


def _heading(played_runs: Sequence[PlayedRun], interpretations: Sequence[Interpretation]) -> list[str]:
    scenario = played_runs[0].run.scenario
    setpoints = ", ".join(f"{setpoint:g}" for setpoint in scenario.visited_mm)
    half_s = scenario.duration_s / 2.0
    lines = [
        f"Setpoints {setpoints} mm, {scenario.dwell_s:g} s each, T_s = {scenario.sample_period_s * 1e3:g} ms.",
        "The paper shows figures and gives no numbers: setpoints and thresholds are ours.",
        f"Half time, from which simulations 3 to 5 use the table, is {half_s:g} s.",
        "",
    ]
    if played_runs[0].run.short:
        lines += [
            "**A short run**: its dwells show the moves; they are too short to decide results about the stem at rest.",
            "",
        ]
    lines += [f"- **{noise}**: {NOISES[noise]}" for noise in dict.fromkeys(each.noise for each in interpretations)]
    return lines + [f"- **{units}**: {UNITS[units]}" for units in Units]


def _assessment_table(found: Sequence[Assessment], interpretations: Sequence[Interpretation]) -> Table:
    cells = {(each.simulation, each.result, each.interpretation): _assessment(each) for each in found}
    results = dict.fromkeys((each.simulation, each.result) for each in found)
    rows = (
        (str(simulation), result, *(cells.get((simulation, result, each), "as SI") for each in interpretations))
        for simulation, result in results
    )
    return Table.of(("simulation", "published result", *map(str, interpretations)), rows)


def _assessment(assessment: Assessment) -> str:
    if assessment.holds is None:
        return "not decided"
    return f"{'yes' if assessment.holds else '**no**'}: {assessment.seen}"


def _figure_table(played_runs: Sequence[PlayedRun]) -> list[Block]:
    head = ("simulation", "interpretation", *(f"{name}, before → after" for name in _FIGURES))
    rows = []
    for played in played_runs:
        simulation, interpretation = played.run.simulation, played.run.interpretation
        name = str(interpretation) if simulation in WITH_TABLE else str(interpretation.noise)
        pairs = zip(_cells(played.before), _cells(played.after), strict=True)
        rows.append((f"{simulation}: {TITLES[simulation]}", name, *(f"{before} → {after}" for before, after in pairs)))
    return [
        "Before → after half time. Error and range (both in percent of span) and current range: over the second half",
        "of each dwell, mean of three dwells; speed: root mean square over the same time; reversals: those above",
        f"{VISIBLE_M * 1e3:.3f} mm, including those of the moves.",
        "",
        Table.of(head, rows, names=2),
    ]


def _cells(half: Half) -> tuple[str, ...]:
    return (
        f"{half.error_pct:.2f}",
        f"{half.range_pct:.2f}",
        f"{half.overshoot_pct:.2f}",
        f"{half.reversals}",
        f"{half.limit_cycles}",
        f"{half.current_range_ma:.2f}",
        f"{half.speed_m_per_s * 1e3:.1f}",
    )
