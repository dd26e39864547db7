"""Events about trust in the table, in pushes and in the effect of commands. Pure."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from positioner.cycle.counted_event import CountedEvent
from positioner.values import dataclass
from positioner.wire.messages import Cause, Counted

if TYPE_CHECKING:
    from positioner.valve.stiction import LearnedSample


@dataclass(frozen=True, slots=True)
class NotBelieved:
    """Samples that physics excludes, `count` of them, `sample` the first: just measured (`taught`), or from a table."""

    sample: LearnedSample
    low: float
    high: float
    count: int
    taught: bool

    def __str__(self) -> str:
        """One line for the log."""
        sample = self.sample
        what = f"{sample.quantity} = {sample.value:.6g} at {sample.position_m * 1e3:.2f} mm, {sample.direction}"
        possible = (
            f"this valve can have {self.low:.6g} to {self.high:.6g} there"
            if self.low <= self.high
            else "that is outside the travel"
        )
        if self.taught:
            return f"not learned: {what}: {possible}"
        others = f" (and {self.count - 1} more)" if self.count > 1 else ""
        return f"not used from the table: {what}: {possible}{others}; correct [valve], or reset the table"


@dataclass(frozen=True, slots=True)
class PushFailed(CountedEvent):
    """A push did not free the stem: `failed` in a row now; the law rests for `rest_s`, 0 where it tries again."""

    counted: Counted = field(default=Counted.PUSH_FAILED, init=False)
    failed: int
    rest_s: float

    def __str__(self) -> str:
        """One line for the log."""
        text = f"{self.failed} push(es) in a row did not free the stem"
        if not self.rest_s:
            return text
        return f"{text}: the next one comes in {self.rest_s:g} s; look for a jammed stem, or an actuator without air"


@dataclass(frozen=True, slots=True)
class ActingChanged:
    """Commands do not act on the valve any more, for `cause`, or act again (None)."""

    cause: Cause | None

    def __str__(self) -> str:
        """One line for the log."""
        match self.cause:
            case None:
                return "commands act on the valve again: the law starts again"
            case Cause.ACTUATOR_FAILED:
                return (
                    "the valve's node reports that its actuator obeys no command: nothing is learned; look at the valve"
                )
            case _:
                why = "its readings name no newer one as acting"
                return f"the valve's node takes no command of ours ({why}): nothing is learned; look at the node"
