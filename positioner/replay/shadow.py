"""A second law in the shadow of a recorded bus: the dwells of the log, and where it would have done otherwise. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report.table import Table
from positioner.shadow.differences import APART_MA, Differences
from positioner.shadow.law import ShadowFailedError, ShadowLaw

if TYPE_CHECKING:
    from positioner.cycle.events import Event
    from positioner.cycle.input import CycleInput
    from positioner.cycle.state import CycleState, Setup
    from positioner.laws.law import Law

_HEAD = (
    *("dwell", "at, s", "lasts, s", "setpoint, mm", "cycles", "mean, mA", "largest, mA", f"above {APART_MA:g} mA, %"),
    *("moves", "of the shadow", "first of its own, s"),
)
_NS = 1e-9


class ReplayedShadow:
    """The dwells of a log. failed: how the law has failed, empty where it has not; it is asked no more then."""

    def __init__(self, setup: Setup, law: Law[object]) -> None:
        """Begin; `setup` is that of the acting law."""
        self._acting, self._law = setup.law.name, ShadowLaw(setup, law)
        self._zero_ns: int | None = None
        self._ended: list[Differences] = []
        self.failed = ""

    def cycle(self, cycle_input: CycleInput, before: CycleState, after: CycleState, events: tuple[Event, ...]) -> None:
        """Compare one cycle; the first one is at 0 s."""
        if self._zero_ns is None:
            self._zero_ns = cycle_input.now_ns
        if self.failed:
            return
        try:
            if (dwell := self._law.cycle(cycle_input, before, after, events)) is not None:
                self._ended.append(dwell)
        except ShadowFailedError as error:
            self.failed = f"at {(cycle_input.now_ns - self._zero_ns) * _NS:.3f} s: {error}"

    def blocks(self) -> list[str | Table]:
        """Return the report: a row for each dwell, and one for all."""
        dwells, total = self._dwells(), self._law.total
        who = f"shadow {self._law.name} beside {self._acting}"
        failed = [f"{who} was dropped {self.failed}"] if self.failed else []
        if total is None:
            return [*failed, f"{who}: nothing to compare, for no law controlled the valve"]
        rows = [(str(number), *self._cells(dwell)) for number, dwell in enumerate(dwells, 1)]
        table = Table.of(_HEAD, [*rows, ("all", *self._cells(total))])
        return [*failed, table, "", f"{who}: {total.in_words()}"]

    def as_json(self) -> dict[str, Any]:
        """Return the report for a program."""
        zero_ns, total = self._zero_ns or 0, self._law.total
        return {
            "law": self._acting,
            "shadow": self._law.name,
            "failed": self.failed or None,
            "dwells": [dwell.as_dict(zero_ns) for dwell in self._dwells()],
            "total": None if total is None else total.as_dict(zero_ns),
        }

    def _dwells(self) -> list[Differences]:
        return [*self._ended, *([] if self._law.dwell is None else [self._law.dwell])]

    def _cells(self, found: Differences) -> tuple[str, ...]:
        told = found.as_dict(self._zero_ns or 0)
        first_s = told["own_move_s"]
        return (
            f"{told['begin_s']:.3f}",
            f"{told['end_s'] - told['begin_s']:.3f}",
            f"{1e3 * found.setpoint_m:.3f}" if found is not self._law.total else "",
            str(found.cycles),
            f"{found.mean_ma:.3f}",
            f"{found.largest_ma:+.3f}",
            f"{100.0 * found.apart_share:.1f}",
            str(found.moves),
            str(found.shadow_moves),
            "" if first_s is None else f"{first_s:.3f}",
        )
