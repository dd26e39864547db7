"""What a diagnosis answers. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

LEAST_STICK_PERCENT = 0.7
"""Of the command's span: a smaller S does no harm, and is no finding."""
LEAST_RANGE_PERCENT = 2.0 * LEAST_STICK_PERCENT
"""Of the command's span: a stem may rest while the command stays within its stick band, which is S + J wide, and J is
at most S. So a command that moves less shows nothing of a valve with that S."""


def unexcited(moved_percent: float) -> str:
    """Return why a record says nothing in which the command moved so little, and what it must hold."""
    return (
        f"OP moved by {moved_percent:.2f} % only, and within {LEAST_RANGE_PERCENT:g} % a stem that sticks may rest: a "
        f"record is needed in which OP moves by more than {LEAST_RANGE_PERCENT:g} % and back, as after setpoint steps"
    )


class Verdict(StrEnum):
    """Whether the valve sticks."""

    YES = "yes"
    NO = "no"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and half the width of its 95 % interval."""

    value: float
    half_width: float

    @property
    def low(self) -> float:
        """The lower end."""
        return self.value - self.half_width

    @property
    def high(self) -> float:
        """The upper end."""
        return self.value + self.half_width

    def scaled(self, factor: float) -> Estimate:
        """Return it in another unit."""
        return Estimate(self.value * factor, self.half_width * abs(factor))
