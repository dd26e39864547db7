"""The results of a conformance test in lines for people, and as JSON for programs. Pure."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from positioner.conformance.rules import RuleResult, Verdict, conforms

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.wire.messages import CanFrame

_MARKS = {Verdict.PASS: "pass", Verdict.FAIL: "FAIL", Verdict.NOT_SEEN: "not seen"}
_NS = 1e9


def lines(results: Sequence[RuleResult], start_ns: int) -> Iterator[str]:
    """Yield one line for each rule, its first violation and the fix below a broken one, and the sums at the end."""
    width = max(len(result.rule.name) for result in results)
    for result in results:
        yield f"{_MARKS[result.verdict]:8}  {result.rule.name:{width}}  {result.rule.demands}"
        if result.first is not None:
            times = f" ({result.violations} times)" if result.violations > 1 else ""
            yield f"{'':8}  first: {_place(result.first.frame, start_ns)}{result.first.found}{times}"
            yield f"{'':8}  fix:   {result.fix}"
    verdicts = [result.verdict for result in results]
    yield ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in Verdict)


def as_json(node: str, results: Sequence[RuleResult], start_ns: int) -> str:
    """Return the results as one JSON object."""
    report = {
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
    return json.dumps(report, indent=2, ensure_ascii=False)


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
