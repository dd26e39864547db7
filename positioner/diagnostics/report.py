"""A finding as text for people, and as values for programs. Pure."""

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


def as_text(finding: Finding) -> str:
    """Return the finding, its verdict first."""
    lines = [f"{finding.source}: {headline(finding)}: {finding.reason}", ""]
    if finding.stick:
        lines.append(f"  S, stick band and dead band  {_interval(finding.stick)} of the command")
    if finding.jump:
        lines.append(f"  J, slip jump                 {_interval(finding.jump)} of the command")
    elif finding.stick:
        lines.append("  J, slip jump                 cannot be told from OP and PV")
    if finding.direct:
        lines += _direct_lines(finding.direct)
    if finding.indirect:
        lines += _indirect_lines(finding.indirect, finding)
    notes = [*finding.notes, *(finding.indirect.notes if finding.indirect else ())]
    if finding.verdict is Verdict.NO:
        notes.append("no stiction is not healthy: other faults are not looked for")
    lines += ["", *(f"  note: {note}" for note in notes)] if notes else []
    return "\n".join(lines) + "\n"


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
        "samples": finding.samples,
        "period_s": finding.period_s if finding.is_timed else None,
        "direct": _direct_values(finding.direct) if finding.direct else None,
        "indirect": _indirect_values(finding.indirect) if finding.indirect else None,
        "notes": [*finding.notes, *(finding.indirect.notes if finding.indirect else ())],
    }


def _interval(value: Estimate) -> str:
    return f"{value.value:.2f} % ({value.low:.2f} to {value.high:.2f})"


def _direct_lines(found: DirectDiagnosis) -> list[str]:
    up = sum(slip.direction > 0.0 for slip in found.slips)
    lines = [
        "",
        f"  direct, from the stem position: {found.verdict}: {found.reason}",
        f"    slips {len(found.slips)} ({up} up), noise of a reading {found.noise:.3f} %, band {found.band:.2f} %",
    ]
    if found.friction:
        friction = found.friction
        lines.append(
            f"    S {_interval(friction.stick)}, J {_interval(friction.jump)}, residual {friction.residual:.3f} %, "
            f"{friction.slope:.3f} % of command per % of travel"
        )
    return lines


def _indirect_lines(found: Diagnosis, finding: Finding) -> list[str]:
    unit = "s" if finding.is_timed else "samples"
    period = found.oscillation.period * (finding.period_s if finding.is_timed else 1.0)
    lines = [
        "",
        f"  indirect, from OP and PV: {found.verdict}: {found.reason}",
        f"    oscillation: period {period:.4g} {unit}, regularity {found.oscillation.regularity:.2f} (regular above 1)",
        f"    the methods use means of {found.factor} samples",
        f"    apparent S of the PV-OP ellipse {found.ellipse:.2f} %",
        "",
        f"    {'method':<6} {'index':>8} {'yes above':>10} {'no below':>9}  {'verdict':<9}  source",
    ]
    return lines + [f"    {_answer_line(each)}" for each in found.answers]


def answer_row(answer: Answer) -> tuple[str, ...]:
    """Return name, index, both limits, verdict and source of a method's answer."""
    index = "-" if math.isnan(answer.index) else f"{answer.index:.3f}"
    source = f"{answer.source}: {answer.note}" if answer.note else answer.source
    return answer.name, index, f"{answer.yes_above:.3f}", f"{answer.no_below:.3f}", str(answer.verdict), source


def _answer_line(answer: Answer) -> str:
    name, index, yes, no, verdict, source = answer_row(answer)
    return f"{name:<6} {index:>8} {yes:>10} {no:>9}  {verdict:<9}  {source}"


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
