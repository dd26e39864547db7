"""The results of a conformance test in a table for people, and as values for programs. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.conformance.rules import RuleResult, Verdict, conforms
from positioner.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.report.text import Block
    from positioner.wire.messages import CanFrame

_MARKS = {Verdict.PASS: "pass", Verdict.FAIL: "FAIL", Verdict.NOT_SEEN: "not seen"}
_NS = 1e9


def blocks(node: str, results: Sequence[RuleResult], start_ns: int) -> Iterator[Block]:
    """Yield the verdict, each rule, and for a broken one the first frame that breaks it, and the fix."""
    verdicts = [result.verdict for result in results]
    counts = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in Verdict)
    kept = "breaks no rule" if conforms(results) else "breaks the rules"
    yield f"the {node} {kept}: {counts}"
    yield ""
    rows = [(_MARKS[result.verdict], result.rule.name, result.rule.demands) for result in results]
    yield Table.of(("verdict", "rule", "what it demands"), rows, names=2)
    for result in results:
        if result.first is not None:
            times = f" ({result.violations} times)" if result.violations > 1 else ""
            yield ""
            yield f"- {result.rule.name}, first: {_place(result.first.frame, start_ns)}{result.first.found}{times}"
            yield f"- {result.rule.name}, fix: {result.fix}"


def as_values(node: str, results: Sequence[RuleResult], start_ns: int) -> dict[str, Any]:
    """Return the results as the values of one JSON document."""
    return {
        "node": node,
        "conforms": conforms(results),
        "rules": [
            {
                "name": result.rule.name,
                "demands": result.rule.demands,
                "verdict": result.verdict,
                "offences": result.violations,
                "found": result.first.found if result.first else None,
                "frame": _frame(result.first.frame, start_ns) if result.first and result.first.frame else None,
                "mend": result.fix or None,
            }
            for result in results
        ],
    }


def _place(frame: CanFrame | None, start_ns: int) -> str:
    if frame is None:
        return ""
    at_s = (frame.received_ns - start_ns) / _NS
    return f"{at_s:.6f} s  {frame.arbitration_id:03X}  {frame.data.hex(' ').upper()}  "


def _frame(frame: CanFrame, start_ns: int) -> dict[str, object]:
    return {
        "time_s": round((frame.received_ns - start_ns) / _NS, 6),
        "id": f"{frame.arbitration_id:03X}",
        "data": frame.data.hex(),
    }
