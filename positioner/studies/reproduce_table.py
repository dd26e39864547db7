"""The figures and the verdicts of `positioner reproduce`, as Markdown and as JSON. Pure."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from positioner.studies.readings import UnitReading
from positioner.studies.reproduce import VISIBLE_M, WITH_TABLE
from positioner.studies.reproduce_page import NOISES, TITLES, UNITS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from positioner.studies.claims import Verdict
    from positioner.studies.readings import Reading
    from positioner.studies.reproduce import Half, Outcome

_FIGURES = ("error, %", "range, %", "overshoot, %", "reversals", "limit cycles", "current range, mA", "speed, mm/s")


def to_markdown(outcomes: Sequence[Outcome], verdicts: Sequence[Verdict]) -> str:
    """Return the page: the readings, what the paper claims beside what is seen, and the figures of every run."""
    readings = sorted({outcome.run.reading for outcome in outcomes})
    return "\n".join(
        [
            "# The paper's five simulations",
            "",
            *_heading(outcomes, readings),
            "",
            "## What the paper claims, and what is seen",
            "",
            *_verdict_table(verdicts, readings),
            "",
            "## The figures",
            "",
            *_figure_table(outcomes),
            "",
        ]
    )


def to_json(outcomes: Sequence[Outcome], verdicts: Sequence[Verdict]) -> str:
    """Return the same as JSON: one object a run and one a verdict."""
    page = {
        "runs": [
            {
                "scenario": f"paper-{outcome.run.simulation}",
                **_name(outcome.run.reading),
                "setpoints_mm": outcome.run.scenario.visited_mm,
                "dwell_s": outcome.run.scenario.dwell_s,
                "before": asdict(outcome.before),
                "after": asdict(outcome.after),
            }
            for outcome in outcomes
        ],
        "verdicts": [
            {
                "simulation": verdict.simulation,
                "claim": verdict.claim,
                **_name(verdict.reading),
                "seen": verdict.seen,
                "holds": verdict.holds,
            }
            for verdict in verdicts
        ],
    }
    return json.dumps(page, indent=2, ensure_ascii=False) + "\n"


def _name(reading: Reading) -> dict[str, Any]:
    return {"noise": str(reading.noise), "units": str(reading.units)}


def _heading(outcomes: Sequence[Outcome], readings: Sequence[Reading]) -> list[str]:
    scenario = outcomes[0].run.scenario
    setpoints = ", ".join(f"{setpoint:g}" for setpoint in scenario.visited_mm)
    half_s = scenario.duration_s / 2.0
    lines = [
        f"Setpoints {setpoints} mm, {scenario.dwell_s:g} s each, T_s = {scenario.sample_period_s * 1e3:g} ms.",
        "The paper shows figures and gives no numbers: setpoints and thresholds are ours.",
        f"Half time, from which simulations 3 to 5 use the table, is {half_s:g} s.",
        "",
    ]
    if outcomes[0].run.short:
        lines += [
            "**A short run**: its dwells show the moves; what happens at rest they cannot tell, and it is not judged.",
            "",
        ]
    lines += [f"- **{noise}**: {NOISES[noise]}" for noise in dict.fromkeys(reading.noise for reading in readings)]
    return lines + [f"- **{units}**: {UNITS[units]}" for units in UnitReading]


def _verdict_table(found: Sequence[Verdict], readings: Sequence[Reading]) -> list[str]:
    cells = {(verdict.simulation, verdict.claim, verdict.reading): verdict for verdict in found}
    claims = dict.fromkeys((verdict.simulation, verdict.claim) for verdict in found)
    lines = [
        _row(("simulation", "claim", *map(str, readings))),
        _row("---" for _ in range(2 + len(readings))),
    ]
    lines += [
        _row((f"{simulation}", claim, *(_verdict(cells.get((simulation, claim, reading))) for reading in readings)))
        for simulation, claim in claims
    ]
    return lines


def _verdict(verdict: Verdict | None) -> str:
    """Return a cell: without a table one reading stands for both units."""
    if verdict is None:
        return "as SI"
    if verdict.holds is None:
        return "not judged"
    return f"{'yes' if verdict.holds else '**no**'}: {verdict.seen}"


def _figure_table(outcomes: Sequence[Outcome]) -> list[str]:
    head = ("simulation", "reading", *(f"{name}, before → after" for name in _FIGURES))
    lines = [
        "Before → after half time. Error, range and current range: over the second half of each dwell, mean of three",
        "dwells, in percent of span; speed: root mean square over the same; reversals: above",
        f"{VISIBLE_M * 1e3:.3f} mm, moves included.",
        "",
        _row(head),
        _row("---" for _ in head),
    ]
    for outcome in outcomes:
        simulation, reading = outcome.run.simulation, outcome.run.reading
        name = str(reading) if simulation in WITH_TABLE else str(reading.noise)
        pairs = zip(_cells(outcome.before), _cells(outcome.after), strict=True)
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
