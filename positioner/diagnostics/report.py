"""A finding in words and rows for people, and as values for programs. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from positioner.diagnostics.verdict import Verdict

if TYPE_CHECKING:
    from positioner.diagnostics.direct.diagnosis import DirectDiagnosis
    from positioner.diagnostics.finding import Finding
    from positioner.diagnostics.indirect.diagnosis import Diagnosis
    from positioner.diagnostics.indirect.method import Answer
    from positioner.diagnostics.verdict import Estimate

_SENTENCES = {
    Verdict.YES: "the valve sticks",
    Verdict.NO: "no stiction found",
    Verdict.UNDECIDED: "undecided",
}


METHOD_HEAD = ("method", "index", "yes above", "no below", "verdict", "source")


def verdict_line(finding: Finding) -> str:
    """Return the verdict and its reason in one line."""
    return f"{finding.source}: {headline(finding)}: {finding.reason}"


def size_rows(finding: Finding) -> list[tuple[str, str, str]]:
    """Return S and J in percent of the command with their intervals; a dash where J cannot be told."""
    sizes = (("S, stick band and dead band", finding.stick), ("J, slip jump", finding.jump))
    if not finding.stick and not finding.jump:
        return []
    return [
        (name, f"{size.value:.2f}", f"{size.low:.2f} to {size.high:.2f}") if size else (name, "–", "–")
        for name, size in sizes
    ]


def notes(finding: Finding) -> list[str]:
    """Return what a person should know besides."""
    found = [*finding.notes, *(finding.indirect.notes if finding.indirect else ())]
    if finding.stick and not finding.jump:
        found.insert(0, "J cannot be told from OP and PV")
    if finding.verdict is Verdict.NO:
        found.append("no stiction is not healthy: other faults are not looked for")
    return found


def headline(finding: Finding) -> str:
    """Return the verdict in few words."""
    if finding.verdict is Verdict.YES and finding.is_direct and finding.direct and not finding.direct.has_jump:
        return "the valve has a dead band"
    return _SENTENCES[finding.verdict]


def as_values(finding: Finding) -> dict[str, Any]:
    """Return the finding as values of JSON; NaN is None."""
    return {
        "source": finding.source,
        "verdict": str(finding.verdict),
        "reason": finding.reason,
        "method": "direct" if finding.is_direct else "indirect",
        "stick_percent": _values(finding.stick),
        "jump_percent": _values(finding.jump),
        "op_moved_percent": _number(finding.moved_percent),
        "samples": finding.samples,
        "period_s": finding.period_s if finding.is_timed else None,
        "direct": _direct_values(finding.direct) if finding.direct else None,
        "indirect": _indirect_values(finding.indirect) if finding.indirect else None,
        "notes": [*finding.notes, *(finding.indirect.notes if finding.indirect else ())],
    }


def _interval(value: Estimate) -> str:
    return f"{value.value:.2f} % ({value.low:.2f} to {value.high:.2f})"


def direct_lines(found: DirectDiagnosis) -> list[str]:
    """Return what the position of the stem shows, and from what."""
    up = sum(slip.direction > 0.0 for slip in found.slips)
    lines = [
        f"direct, from the stem position: {found.verdict}: {found.reason}",
        f"slips {len(found.slips)} ({up} up), noise of a reading {found.noise:.3f} %, band {found.band:.2f} %",
    ]
    if found.friction:
        friction = found.friction
        lines.append(
            f"S {_interval(friction.stick)}, J {_interval(friction.jump)}, residual {friction.residual:.3f} %, "
            f"{friction.slope:.3f} % of command per % of travel"
        )
    return lines


def indirect_lines(found: Diagnosis, finding: Finding) -> list[str]:
    """Return what OP and PV show, besides the answers of the methods."""
    unit = "s" if finding.is_timed else "samples"
    period = found.oscillation.period * (finding.period_s if finding.is_timed else 1.0)
    return [
        f"indirect, from OP and PV: {found.verdict}: {found.reason}",
        f"oscillation: period {period:.4g} {unit}, regularity {found.oscillation.regularity:.2f} (regular above 1)",
        f"the methods use means of {found.factor} samples",
        f"apparent S of the PV-OP ellipse {found.ellipse:.2f} %",
    ]


def answer_row(answer: Answer) -> tuple[str, ...]:
    """Return the cells of a method's answer: name, index, both limits, verdict and source."""
    index = "–" if math.isnan(answer.index) else f"{answer.index:.3f}"
    source = f"{answer.source}: {answer.note}" if answer.note else answer.source
    return answer.name, index, f"{answer.yes_above:.3f}", f"{answer.no_below:.3f}", str(answer.verdict), source


def _values(value: Estimate | None) -> dict[str, float | None] | None:
    if value is None:
        return None
    return {"value": _number(value.value), "low": _number(value.low), "high": _number(value.high)}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _direct_values(found: DirectDiagnosis) -> dict[str, Any]:
    friction = found.friction
    return {
        "verdict": str(found.verdict),
        "reason": found.reason,
        "slips": len(found.slips),
        "slips_up": sum(slip.direction > 0.0 for slip in found.slips),
        "noise_percent": found.noise,
        "band_percent": found.band,
        "lag_samples": found.lag,
        "has_jump": found.has_jump,
        "stick_percent": _values(friction.stick) if friction else None,
        "jump_percent": _values(friction.jump) if friction else None,
        "slope": friction.slope if friction else None,
        "residual_percent": friction.residual if friction else None,
    }


def _indirect_values(found: Diagnosis) -> dict[str, Any]:
    return {
        "verdict": str(found.verdict),
        "reason": found.reason,
        "stick_percent": _values(found.stick),
        "ellipse_percent": _number(found.ellipse),
        "oscillation_period_samples": found.oscillation.period,
        "regularity": _number(found.oscillation.regularity),
        "samples_averaged": found.factor,
        "methods": [
            {
                "name": each.name,
                "source": each.source,
                "index": _number(each.index),
                "yes_above": _number(each.yes_above),
                "no_below": _number(each.no_below),
                "verdict": str(each.verdict),
                "note": each.note,
            }
            for each in found.answers
        ],
    }
