"""What a signature shows that has changed beyond the limits of `[health]` since the reference. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from positioner.health.causes import TEXTS, AlarmCause
from positioner.health.reference import kept_preload_n
from positioner.values import dataclass
from positioner.wire.messages import Health

if TYPE_CHECKING:
    from positioner.commissioning.signature import Signature
    from positioner.health.settings import HealthTable


@dataclass(frozen=True, slots=True)
class Beyond:
    """A change beyond its limit, both as parts of the reference; `category` by NAMUR NE 107."""

    cause: AlarmCause
    change: float
    limit: float
    category: Health

    def __str__(self) -> str:
        """Return it for a person: the change, the limit and what to do."""
        text = TEXTS[self.cause]
        return f"{text.what}: {100.0 * self.change:+.1f} %, limit {100.0 * self.limit:g} %: {text.remedy}"

    def as_json(self) -> dict[str, Any]:
        """Return it for a program."""
        return {
            "cause": self.cause.key,
            "change": self.change,
            "limit": self.limit,
            "category": self.category.name.lower(),
            "text": str(self),
        }


def beyond_limits(
    found: Signature, reference: dict[str, Any], health: HealthTable, span_m: float
) -> tuple[Beyond, ...]:
    """Return the changes since a reference, the JSON of an earlier signature, that are beyond their limits.

    The larger change of sliding and static friction counts, where both tests have measured it. The spring's force is
    that at position 0, and its shift a part of what the spring takes over the span.

    Raises:
        KeyError, TypeError, ValueError: the reference is no signature.
    """
    before = {name: math.nan if value is None else float(value) for name, value in reference["quantities"].items()}
    preload_n = kept_preload_n(reference)
    static_n = found.static_n.value if found.static_n.seen else math.nan
    ratios = (found.sliding_n.value / before["sliding_n"], static_n / before["static_n"])
    frictions = [each - 1.0 for each in ratios if not math.isnan(each)]
    changes = (
        (AlarmCause.FRICTION_HIGH, max(frictions), 1.0),
        (AlarmCause.FRICTION_LOW, min(frictions), -1.0),
        (AlarmCause.SPRING_RATE, found.spring_n_per_m.value / before["spring_n_per_m"] - 1.0, 0.0),
        (
            AlarmCause.SPRING_FORCE,
            (found.preload_n.value - preload_n) / (before["spring_n_per_m"] * span_m),
            0.0,
        ),
    )
    told = [_judged(cause, change, sign, health) for cause, change, sign in changes]
    return tuple(each for each in told if each is not None)


def _judged(cause: AlarmCause, change: float, sign: float, health: HealthTable) -> Beyond | None:
    """Return a change that is beyond its limit, in the direction of `sign` or in both."""
    limits = health.limits_of(cause)
    size = sign * change if sign else abs(change)
    if size > limits.serious_limit > 0.0 and limits.serious_category is not Health.GOOD:
        return Beyond(cause, change, limits.serious_limit, limits.serious_category)
    if size > limits.limit and limits.category is not Health.GOOD:
        return Beyond(cause, change, limits.limit, limits.category)
    return None
