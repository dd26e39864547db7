"""How friction and spring have changed since the reference, with their limits, as a table. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.health.causes import AlarmCause
from positioner.report import words
from positioner.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.health.causes import Limits
    from positioner.health.friction_trend import Changes, Share

_PERCENT = 100.0
_FRICTION = (AlarmCause.FRICTION_LOW, AlarmCause.FRICTION_HIGH)


def trend_table(found: Changes, limits: Mapping[AlarmCause, Limits]) -> Table:
    """Return a row for each change, in percent of the reference where the name says no other whole."""
    shares = (
        ("sliding friction", found.friction, _FRICTION),
        ("static friction", found.static, _FRICTION),
        ("spring rate", found.spring, (AlarmCause.SPRING_RATE,)),
        ("spring force, of the bench range", found.offset, (AlarmCause.SPRING_FORCE,)),
        ("slip jump, of the span", found.jump, (AlarmCause.SLIP_JUMP,)),
    )
    rows = [_row(name, share, limits, causes) for name, share, causes in shares if share is not None]
    return Table.of(("change in service", "value", "95 % interval", "maintenance at", "out of spec. at"), rows)


def _row(
    name: str, share: Share, limits: Mapping[AlarmCause, Limits], causes: tuple[AlarmCause, ...]
) -> tuple[str, ...]:
    low, high = (f"{_PERCENT * end:+.1f}".replace("-", "\N{MINUS SIGN}") for end in (share.low, share.high))
    value = f"{_PERCENT * share.value:+.1f} %".replace("-", "\N{MINUS SIGN}")
    ends = [min(getattr(limits[cause], key) for cause in causes) for key in ("limit", "serious_limit")]
    sign = "+" if causes == (AlarmCause.SLIP_JUMP,) else "±"
    return (name, value, f"{low} to {high}", *(f"{sign}{_PERCENT * end:g} %" if end else words.NONE for end in ends))
