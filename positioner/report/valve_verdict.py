"""The verdict on a valve: the worst of what tests and alarms say, by NE 107. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.health.causes import AlarmCause
from positioner.health.reference import CONFIGURED
from positioner.health.watch import changes_of
from positioner.report import words
from positioner.report.page import Status, Verdict
from positioner.report.procedure_page import verdict_of
from positioner.report.trend_sections import verdict_of_alarm

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.commissioning.results import KeptResult
    from positioner.report.trend_sections import Service

_WORST_FIRST = (
    Status.FAILURE,
    Status.FUNCTION_CHECK,
    Status.OUT_OF_SPECIFICATION,
    Status.MAINTENANCE_REQUIRED,
    Status.GOOD,
)


def verdict_of_valve(
    results: Mapping[str, tuple[KeptResult, KeptResult]],
    service: Service | None,
    running: str,
    options: str,
) -> Verdict:
    """Return one verdict: of the alarms, of the tests that judge, and of a test that runs now."""
    alarms = [each for each in service.trends.alarms if each.is_active] if service else []
    found = [verdict_of_alarm(each) for each in alarms]
    if not any(each.cause is AlarmCause.STROKE_TEST for each in alarms):
        found += filter(None, (verdict_of(newest) for newest, _ in results.values()))
    if running:
        sentence = f"{running} moves the valve now; what follows is of before."
        found.append(Verdict(Status.FUNCTION_CHECK, sentence, "Wait until it has ended, and make the report again."))
    if service:
        found += _of_service(service)
    if not found:
        return _no_judgement(results, options)
    worst = min(found, key=lambda each: _WORST_FIRST.index(each.status))
    if worst.status is Status.GOOD:
        return Verdict(Status.GOOD, " ".join(each.sentence for each in reversed(found)), worst.action)
    others = sum(each.status is not Status.GOOD for each in found) - 1
    if others > 0:
        more = f"{worst.sentence} {others} more {'alarm' if others == 1 else 'alarms'} below."
        return Verdict(worst.status, more, worst.action)
    return worst


def _of_service(service: Service) -> list[Verdict]:
    """Return what a service without an active alarm says of the valve, where it was compared with a measured one."""
    if any(each.is_active for each in service.trends.alarms):
        return []
    if service.watch.reference.source == CONFIGURED or not service.trends.friction.moves:
        return []
    friction = words.signed(100.0 * changes_of(service.watch, service.trends).friction.value, 0)
    sentence = f"No alarm is active; friction in service is {friction} % against the reference."
    return [Verdict(Status.GOOD, sentence, "Nothing.")]


def _no_judgement(results: Mapping[str, tuple[KeptResult, KeptResult]], options: str) -> Verdict:
    if results:
        sentence = "The valve was measured, and nothing has judged it yet."
        return Verdict(Status.UNKNOWN, sentence, f"Run positioner stroke-test {options}, or put it in service.")
    action = f"Run positioner identify {options} --write, then positioner signature {options}."
    return Verdict(Status.UNKNOWN, "Nothing was measured on this valve yet.", action)
