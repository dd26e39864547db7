"""An examination in lines for people, and as JSON for programs. Pure."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from positioner.conformance.rules import Finding, Verdict, conforms

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.wire.messages import CanFrame

_MARKS = {Verdict.PASS: "pass", Verdict.FAIL: "FAIL", Verdict.NOT_SEEN: "not seen"}
_NS = 1e9


def lines(findings: Sequence[Finding], start_ns: int) -> Iterator[str]:
    """Yield one line a rule, below a broken one its first frame and what to do, and how many there are of each."""
    width = max(len(finding.rule.name) for finding in findings)
    for finding in findings:
        yield f"{_MARKS[finding.verdict]:8}  {finding.rule.name:{width}}  {finding.rule.demands}"
        if finding.first is not None:
            often = f" ({finding.offences} times)" if finding.offences > 1 else ""
            yield f"{'':8}  first: {_place(finding.first.frame, start_ns)}{finding.first.found}{often}"
            yield f"{'':8}  mend:  {finding.mend}"
    verdicts = [finding.verdict for finding in findings]
    yield ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in Verdict)


def as_json(node: str, findings: Sequence[Finding], start_ns: int) -> str:
    """Return the same as one JSON object."""
    report = {
        "node": node,
        "conforms": conforms(findings),
        "rules": [
            {
                "name": finding.rule.name,
                "demands": finding.rule.demands,
                "verdict": finding.verdict,
                "offences": finding.offences,
                "found": finding.first.found if finding.first else None,
                "frame": _frame(finding.first.frame, start_ns) if finding.first and finding.first.frame else None,
                "mend": finding.mend or None,
            }
            for finding in findings
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
