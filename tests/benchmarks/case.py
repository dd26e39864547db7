"""What is measured in repeats: a sequence of actions, each of which is timed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Play:
    """One repeat: the durations (n,) in ns, and the results of all actions as one text, for comparison."""

    durations_ns: list[int]
    result: str


class Case(Protocol):
    """A sequence of n actions that can be repeated from the same start."""

    @property
    def labels(self) -> tuple[str, ...]:
        """The group of each action (n,), such as the mode of a cycle."""

    def play(self) -> Play:
        """Return the durations and results of the whole sequence."""
