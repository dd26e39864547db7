"""What the short form gave when it was last accepted, and what has changed since: dwell by dwell, seed by seed. Pure.

In one version the same seeds give the same dwells to the bit. A change of the law changes some; it is accepted with the
change, as the counted instructions of a cycle are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from positioner.robustness.judgement import LOST_PCT, Rate

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from positioner.robustness.judgement import Verdict

LOST_MORE = 0
"""A class may have no more lost dwells than were accepted, and no more that end off: the seeds are fixed, so every
other one has a cause. Where the law plays alone, none can be lost in the class `as configured`: it judges itself."""
MEDIAN_MORE = 1.05
"""Its median error may grow by 5 %: libraries and processors round differently, and no user sees that much."""


@dataclass(frozen=True, slots=True)
class Change:
    """One line about a class or a dwell; worse: the check fails by it."""

    text: str
    worse: bool


def as_accepted(law: str, judged: Sequence[Verdict]) -> dict[str, Any]:
    """Return the errors of every dwell in percent of span by class and case, and which of them are lost."""
    found: dict[str, dict[str, Any]] = {}
    for each in judged:
        case, dwell = each.case, each.by_law[law]
        kept = found.setdefault(case.group, {}).setdefault(case.name, {"error_pct": [], "lost": []})
        kept["error_pct"].append(round(dwell.error_pct, 4))
        if each.is_lost(law):
            kept["lost"].append(each.number)
    return found


def compared(law: str, judged: Sequence[Verdict], accepted: Mapping[str, Any]) -> list[Change]:
    """Return what has changed since `accepted`; empty where nothing has.

    Raises:
        ValueError: it is of other cases.
    """
    now = as_accepted(law, judged)
    if {name: list(cases) for name, cases in now.items()} != {name: list(cases) for name, cases in accepted.items()}:
        raise ValueError("other classes or valves than were accepted")
    if now == accepted:
        return []
    changes: list[Change] = []
    for group, cases in now.items():
        before = accepted[group]
        lost, was = _lost(cases), _lost(before)
        off, was_off = _off(cases), _off(before)
        medians = [_median(one) for one in (before, cases)]
        of = sum(len(one["error_pct"]) for one in cases.values())
        worse = lost > was + LOST_MORE or off > was_off + LOST_MORE or medians[1] > medians[0] * MEDIAN_MORE
        low, high = (100.0 * each for each in Rate(count=lost, of=of).limits)
        text = f"{group}: lost {was} → {lost} of {of} ({low:.1f} to {high:.1f} %), {was_off} → {off} more than 1 % off"
        changes.append(Change(f"{text}, median {medians[0]:.4f} → {medians[1]:.4f} %", worse))
        for name, one in cases.items():
            for number in sorted({*one["lost"]} ^ {*before[name]["lost"]}):
                is_lost = number in one["lost"]
                word = "lost now" if is_lost else "no longer lost"
                old, new = before[name]["error_pct"][number], one["error_pct"][number]
                changes.append(
                    Change(f"  {group}/{name}, dwell {number + 1}: {word}, {old:g} → {new:g} %", worse=False)
                )
    return changes


def _lost(cases: Mapping[str, Any]) -> int:
    return sum(len(each["lost"]) for each in cases.values())


def _off(cases: Mapping[str, Any]) -> int:
    return sum(error > LOST_PCT for each in cases.values() for error in each["error_pct"])


def _median(cases: Mapping[str, Any]) -> float:
    errors = sorted(error for each in cases.values() for error in each["error_pct"])
    return float(errors[len(errors) // 2])
