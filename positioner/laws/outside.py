"""A law from outside of this package, as the cycle sees it. Pure.

The code behind it is somebody else's. So its answers are examined here, where a wrong one becomes an error with the
line of that code; the cycle then has no decision, and the guard goes on. What a simple law leaves out is added:

    estimate   a law without it gets the reading as it is, never stuck, and teaches the stiction table nothing
    decide     may answer with a current in mA alone, in place of a `Decision`
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.inputs.plug_in import is_interrupt, line_in, text_of_error
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Estimate
from positioner.laws.rivals.model_free import report
from positioner.values import dataclass
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from positioner.laws.law import Observation
    from positioner.valve.stiction import StictionTable


@dataclass(frozen=True, slots=True)
class OutsideLaw:
    """The law: `own` has `begin` and `decide`, and perhaps `estimate`; `file` is where it stands, empty if unknown.

    current_low_ma, current_high_ma: the limits of the guard, which are the bounds of a decision that gives none.
    """

    name: str
    own: Any
    file: str
    current_low_ma: float
    current_high_ma: float

    def in_words(self) -> str:
        """Return what a person must know who runs it."""
        where = f" ({self.file})" if self.file else ""
        return f"law {self.name}{where} is from outside of this package; the guard limits its commands"

    def begin(self, measured_m: float) -> Any:
        """Return the memory of a law that starts at this reading in m."""
        try:
            return self.own.begin(measured_m)
        except BaseException as error:
            raise self._told(error) from error

    def estimate(self, memory: Any, observation: Observation) -> tuple[Any, Estimate]:
        """Return the memory and the estimate of the law; without one of its own the reading as it is."""
        if not hasattr(self.own, "estimate"):
            return memory, report(observation.measured_m, 0.0)
        try:
            memory, estimate = self.own.estimate(memory, observation)
        except BaseException as error:
            raise self._told(error) from error
        if not isinstance(estimate, Estimate) or not isinstance(estimate.stem, StemState):
            raise TypeError(f"estimate answers with {_kind(estimate)}; it must be (memory, Estimate)")
        return memory, estimate

    def decide(
        self, memory: Any, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[Any, Decision]:
        """Return the memory and the decision of the law, or one that holds the current it answered with."""
        try:
            memory, answer = self.own.decide(memory, stem, observation, table)
        except BaseException as error:
            raise self._told(error) from error
        if isinstance(answer, Decision):
            if not isinstance(answer.bounds, Bounds):
                raise TypeError(f"decide answers with a Decision whose bounds are {_kind(answer.bounds)}")
            return memory, answer
        try:
            current_ma = float(answer)
        except (TypeError, ValueError):
            wanted = "(memory, current in mA) or (memory, Decision)"
            raise TypeError(f"decide answers with {_kind(answer)}; it must be {wanted}") from None
        except BaseException as error:
            raise self._told(error) from error
        return memory, Decision(current_ma, Bounds(-math.inf, math.inf, self.current_low_ma, self.current_high_ma))

    def _told(self, error: BaseException) -> BaseException:
        """Return the error that the cycle is to report: with the line of the law's file in which it arose.

        It is an error of this law alone, whatever its code has raised: SystemExit, KeyboardInterrupt, CancelledError.
        """
        if is_interrupt(error):
            return error
        line = line_in(error, Path(self.file))
        where = f" ({Path(self.file).name}, line {line})" if line else ""
        return OutsideLawError(f"{text_of_error(error)}{where}")


class OutsideLawError(Exception):
    """The code of a law from outside raised an error."""


def _kind(value: object) -> str:
    return f"a {type(value).__name__}"
