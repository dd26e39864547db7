"""Pages of each state, for the eyes of a person and of the browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

from report_samples import SIGNATURE, result

from positioner.report.procedure_page import procedure_page

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.report.page import Page


def signature() -> Page:
    return procedure_page(result("signature", SIGNATURE, "b"), result("signature", SIGNATURE, "a"), ())


PAGES: dict[str, Callable[[], Page]] = {"signature": signature}
