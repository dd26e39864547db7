"""Rules, and the book in which each is kept: never looked at, kept, or broken first by which frame. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.wire.messages import CanFrame


class Verdict(StrEnum):
    """What became of a rule."""

    PASS = "pass"  # noqa: S105 - a verdict
    FAIL = "fail"
    NOT_SEEN = "not seen"


@dataclass(frozen=True, slots=True)
class Rule:
    """What a node must do, and what to do where it does not."""

    name: str
    demands: str
    mend: str


@dataclass(frozen=True, slots=True)
class Offence:
    """What broke a rule: a frame, unless it is one that did not come, and in words what was found; `mend` may be ''."""

    found: str
    frame: CanFrame | None = None
    mend: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    """The verdict on a rule, how often it was broken, and by what first."""

    rule: Rule
    verdict: Verdict
    offences: int = 0
    first: Offence | None = None

    @property
    def mend(self) -> str:
        """What to do; empty where nothing is to be done."""
        return "" if self.first is None else self.first.mend or self.rule.mend


class Ledger:
    """The book of one examination; mutable."""

    def __init__(self, rules: Iterable[Rule]) -> None:
        """Begin with rules of which nothing was seen."""
        self._rules = {rule.name: rule for rule in rules}
        self._kept: set[str] = set()
        self._broken: dict[str, tuple[int, Offence]] = {}

    def keep(self, name: str) -> None:
        """Enter that the rule could have been broken and was not."""
        self._kept.add(self._rules[name].name)

    def offend(self, name: str, offence: Offence) -> None:
        """Enter that the rule was broken."""
        count, first = self._broken.get(self._rules[name].name, (0, offence))
        self._broken[name] = (count + 1, first)

    def judge(self, name: str, offence: Offence | None) -> None:
        """Enter either of the two."""
        if offence is None:
            self.keep(name)
        else:
            self.offend(name, offence)

    def findings(self) -> tuple[Finding, ...]:
        """Return the verdict on every rule, in their order."""
        return tuple(self._finding(rule) for rule in self._rules.values())

    def _finding(self, rule: Rule) -> Finding:
        if rule.name in self._broken:
            return Finding(rule, Verdict.FAIL, *self._broken[rule.name])
        return Finding(rule, Verdict.PASS if rule.name in self._kept else Verdict.NOT_SEEN)


def conforms(findings: Iterable[Finding]) -> bool:
    """Return whether no rule was broken."""
    return all(finding.verdict is not Verdict.FAIL for finding in findings)
