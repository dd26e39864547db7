"""Pages of each state, for the eyes of a person and of the browser."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import report_samples as samples

from positioner.report.procedure_page import procedure_page
from positioner.report.valve_page import ValveReport, valve_page

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.commissioning.results import KeptResult
    from positioner.health.alarms import Alarm
    from positioner.report.page import Page

FACTS = (
    ("restartable both ways", "57.9 to 94.5 mm"),
    ("stiction", "F_s 32.0 % of the span force"),
    ("slip jump", "5.42 mm"),
    ("actuator", "lag 50 ms, no dead time"),
    ("law", "nmpc, every 10 ms"),
    ("bus", "socketcan:can0"),
    ("state", "/var/lib/positioner/fv101"),
    ("positioner", "0.1.0 (interpreted)"),
    ("python", "3.11.7"),
    ("numpy", "2.4.6"),
    ("osqp", "1.1.3"),
)


def both(kind: str, first: dict[str, Any], later: dict[str, Any]) -> tuple[KeptResult, KeptResult]:
    return samples.result(kind, later, "b", samples.LATER), samples.result(kind, first, "a")


def whole(more: float, stroke: dict[str, Any], alarms: tuple[Alarm, ...] = (), running: str = "") -> Page:
    """Return the report of a valve of which everything is known, with `more` times the friction at the reference."""
    results = {
        "signature": both("signature", samples.signature(), samples.signature(more)),
        "step-test": both("step-test", samples.step_test(), samples.step_test(more)),
        "stroke-test": both("stroke-test", samples.stroke_test(), stroke),
        "identify": (samples.result("identify", samples.IDENTIFY),) * 2,
    }
    service = samples.service(more - 1.0, alarms)
    signatures = samples.signatures(more)
    options = "--config fv101.toml"
    return valve_page(
        ValveReport("FV-101", 0.127, samples.LATER, results, signatures, service, FACTS, options, running)
    )


def empty() -> Page:
    return valve_page(ValveReport("FV-101", 0.127, samples.LATER, {}, (), None, FACTS, "--config fv101.toml"))


def signature() -> Page:
    newest, first = both("signature", samples.signature(), samples.signature(1.27))
    return procedure_page(newest, first, FACTS)


MAINTENANCE = samples.friction_alarm(0.27)
BEYOND = samples.friction_alarm(0.44)
STUCK = samples.stroke_test("failed", "stuck", "no motion at 12.4 mA, 1.3 times the friction of the reference", 1.3)

PAGES: dict[str, Callable[[], Page]] = {
    "good": partial(whole, 1.02, samples.stroke_test()),
    "maintenance-required": partial(whole, 1.27, samples.stroke_test(), (MAINTENANCE,)),
    "out-of-specification": partial(whole, 1.44, samples.stroke_test(), (BEYOND, *samples.other_alarms())),
    "function-check": partial(whole, 1.02, samples.stroke_test(), (), "positioner stroke-test"),
    "failure": partial(whole, 1.27, STUCK, (MAINTENANCE,)),
    "empty": empty,
    "signature": signature,
}
