"""The rules of a node, and the result for each: passed, failed (with the first violation), or not seen. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.wire.messages import CanFrame


class Verdict(StrEnum):
    """The result for a rule; NOT_SEEN where the node had no occasion to break it."""

    PASS = "pass"  # noqa: S105 - a verdict
    FAIL = "fail"
    NOT_SEEN = "not seen"


@dataclass(frozen=True, slots=True)
class Rule:
    """A demand on a node, and the way to correct a node that does not fulfil it."""

    name: str
    demands: str
    fix: str


@dataclass(frozen=True, slots=True)
class Violation:
    """The finding, its frame (None where it did not come), and a better fix than the rule's, where known."""

    found: str
    frame: CanFrame | None = None
    fix: str = ""


@dataclass(frozen=True, slots=True)
class RuleResult:
    """The verdict on a rule, the number of violations, and the first one."""

    rule: Rule
    verdict: Verdict = Verdict.NOT_SEEN
    violations: int = 0
    first: Violation | None = None

    @property
    def fix(self) -> str:
        """The way to correct the node; empty where the rule was kept."""
        return "" if self.first is None else self.first.fix or self.rule.fix


class Results:
    """The results of one test, rule by rule; mutable."""

    def __init__(self, rules: Iterable[Rule]) -> None:
        self._by_name = {rule.name: RuleResult(rule) for rule in rules}

    def passed(self, name: str) -> None:
        """Note that the node could have broken the rule and did not."""
        result = self._by_name[name]
        if result.verdict is Verdict.NOT_SEEN:
            self._by_name[name] = replace(result, verdict=Verdict.PASS)

    def failed(self, name: str, violation: Violation) -> None:
        """Note that the node broke the rule."""
        result = self._by_name[name]
        count, first = result.violations + 1, result.first or violation
        self._by_name[name] = replace(result, verdict=Verdict.FAIL, violations=count, first=first)

    def note(self, name: str, violation: Violation | None) -> None:
        """Note a violation, or without one that the rule was kept."""
        if violation is None:
            self.passed(name)
        else:
            self.failed(name, violation)

    def all(self) -> tuple[RuleResult, ...]:
        """Return the result for every rule, in the order of the rules."""
        return tuple(self._by_name.values())


def conforms(results: Iterable[RuleResult]) -> bool:
    """Return whether no rule was broken."""
    return all(result.verdict is not Verdict.FAIL for result in results)
