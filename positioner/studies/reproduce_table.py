"""The figures and the assessments of `positioner reproduce`, as Markdown and as JSON. Pure."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from positioner.studies.interpretations import Units
from positioner.studies.reproduce import VISIBLE_M, WITH_TABLE
from positioner.studies.reproduce_page import NOISES, TITLES, UNITS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from positioner.studies.interpretations import Interpretation
    from positioner.studies.published_results import Assessment
    from positioner.studies.reproduce import Half, PlayedRun

_FIGURES = ("error, %", "range, %", "overshoot, %", "reversals", "limit cycles", "current range, mA", "speed, mm/s")


def to_markdown(played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]) -> str:
    """Return the page: the interpretations, what the paper claims beside what is seen, and the figures of every run."""
    interpretations = sorted({played.run.interpretation for played in played_runs})
    return "\n".join(
        [
            "# The paper's five simulations",
            "",
            *_heading(played_runs, interpretations),
            "",
            "## What the paper claims, and what is seen",
            "",
            *_assessment_table(assessments, interpretations),
            "",
            "## The figures",
            "",
            *_figure_table(played_runs),
            "",
        ]
    )


def to_json(played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]) -> str:
    """Return the same as JSON: one object a run and one an assessment."""
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
            "**A short run**: its dwells show the moves; what happens at rest they cannot tell, and it is not judged.",
            "",
        ]
    lines += [
        f"- **{noise}**: {NOISES[noise]}"
        for noise in dict.fromkeys(interpretation.noise for interpretation in interpretations)
    ]
    return lines + [f"- **{units}**: {UNITS[units]}" for units in Units]


def _assessment_table(found: Sequence[Assessment], interpretations: Sequence[Interpretation]) -> list[str]:
    cells = {(assessment.simulation, assessment.result, assessment.interpretation): assessment for assessment in found}
    claims = dict.fromkeys((assessment.simulation, assessment.result) for assessment in found)
    lines = [
        _row(("simulation", "claim", *map(str, interpretations))),
        _row("---" for _ in range(2 + len(interpretations))),
    ]
    lines += [
        _row(
            (
                f"{simulation}",
                claim,
                *(_assessment(cells.get((simulation, claim, interpretation))) for interpretation in interpretations),
            )
        )
        for simulation, claim in claims
    ]
    return lines


def _assessment(assessment: Assessment | None) -> str:
    """Return a cell: without a table one interpretation stands for both units."""
    if assessment is None:
        return "as SI"
    if assessment.holds is None:
        return "not judged"
    return f"{'yes' if assessment.holds else '**no**'}: {assessment.seen}"


def _figure_table(played_runs: Sequence[PlayedRun]) -> list[str]:
    head = ("simulation", "interpretation", *(f"{name}, before → after" for name in _FIGURES))
    lines = [
        "Before → after half time. Error, range and current range: over the second half of each dwell, mean of three",
        "dwells, in percent of span; speed: root mean square over the same; reversals: above",
        f"{VISIBLE_M * 1e3:.3f} mm, moves included.",
        "",
        _row(head),
        _row("---" for _ in head),
    ]
    for played in played_runs:
        simulation, interpretation = played.run.simulation, played.run.interpretation
        name = str(interpretation) if simulation in WITH_TABLE else str(interpretation.noise)
        pairs = zip(_cells(played.before), _cells(played.after), strict=True)
        figures = (f"{before} → {after}" for before, after in pairs)
        lines.append(_row((f"{simulation}: {TITLES[simulation]}", name, *figures)))
    return lines


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


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"
