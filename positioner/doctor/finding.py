"""A finding: its level, its subject, what was found, and the command that fixes it. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class Level(IntEnum):
    """How serious a finding is; the larger the worse."""

    OK = 0
    WARN = 1
    FAIL = 2


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding; `fix` is a command that can be pasted into a shell, empty where nothing is to be done."""

    level: Level
    subject: str
    text: str
    fix: str = ""


def summary(findings: Iterable[Finding]) -> str:
    """Return how many of the findings have each level, the worst first."""
    levels = [finding.level for finding in findings]
    return ", ".join(f"{levels.count(level)} {level.name}" for level in reversed(Level))


def worst(findings: Iterable[Finding]) -> Level:
    """Return the most serious level of the findings."""
    return max((finding.level for finding in findings), default=Level.OK)
