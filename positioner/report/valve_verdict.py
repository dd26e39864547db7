"""The verdict on a valve: the worst of what tests and alarms say, by NE 107. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.report.page import Status, Verdict
from positioner.report.procedure_page import verdict_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.commissioning.results import KeptResult

_WORST_FIRST = (
    Status.FAILURE,
    Status.FUNCTION_CHECK,
    Status.OUT_OF_SPECIFICATION,
    Status.MAINTENANCE_REQUIRED,
    Status.GOOD,
)


def verdict_of_valve(
    results: Mapping[str, tuple[KeptResult, KeptResult]],
    alarms: tuple[Verdict, ...],
    running: str,
    options: str,
) -> Verdict:
    """Return one verdict: of the alarms, of the tests that judge, and of a test that runs now."""
    found = [*alarms, *filter(None, (verdict_of(newest) for newest, _ in results.values()))]
    if running:
        sentence = f"{running} moves the valve now; what follows is of before."
        found.append(Verdict(Status.FUNCTION_CHECK, sentence, "Wait until it has ended, and make the report again."))
    if not found:
        return _unknown(results, options)
    worst = min(found, key=lambda each: _WORST_FIRST.index(each.status))
    others = sum(each.status is not Status.GOOD for each in found) - 1
    if others > 0:
        more = f"{worst.sentence} {others} more {'alarm' if others == 1 else 'alarms'} below."
        return Verdict(worst.status, more, worst.action)
    return worst


def _unknown(results: Mapping[str, tuple[KeptResult, KeptResult]], options: str) -> Verdict:
    if results:
        sentence = "The valve was measured, and nothing has judged it yet: there are no counters and no stroke test."
        return Verdict(Status.UNKNOWN, sentence, f"Run positioner stroke-test {options}, or put it in service.")
    action = f"Run positioner identify {options} --write, then positioner signature {options}."
    return Verdict(Status.UNKNOWN, "Nothing was measured on this valve yet.", action)
