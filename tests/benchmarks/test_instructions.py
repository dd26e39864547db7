"""Counts of instructions are held to what was accepted, and a count that cannot be judged says so."""

from __future__ import annotations

from typing import Any

from benchmarks.judgement import judge

ACCEPTED: dict[str, Any] = {
    "held": {"at rest": 400_000, "in a move": 3_000_000, "settling": 500_000},
    "with": {"Python": "3.11.7", "numpy": "2.4.6"},
}


def counted(at_rest: int, **libraries: str) -> dict[str, Any]:
    return {"held": ACCEPTED["held"] | {"at rest": at_rest}, "with": ACCEPTED["with"] | libraries}


def test_a_change_of_five_percent_holds_and_a_larger_one_fails_in_both_directions() -> None:
    assert [judge("P", counted(n), ACCEPTED)[1] for n in (379_000, 381_000, 419_000, 421_000)] == [
        True,
        False,
        False,
        True,
    ]


def test_a_failure_is_one_line_that_names_the_mode_the_change_and_how_to_accept_it() -> None:
    lines, _ = judge("Python 3.11, interpreted", counted(440_000), ACCEPTED)
    assert lines[0] == (
        "instructions (Python 3.11, interpreted): at rest: 440,000 (+10.0% of 400,000): CHANGED by more than 5%; "
        "if that is right: make accept-instructions"
    )
    assert len(lines) == 2


def test_a_change_with_other_libraries_is_not_judged_and_names_them() -> None:
    lines, failed = judge("P", counted(440_000, numpy="2.5.0"), ACCEPTED)
    assert not failed
    assert lines[0].endswith("NOT JUDGED: counted with numpy 2.5.0 instead of 2.4.6")


def test_other_libraries_with_the_same_count_are_judged() -> None:
    lines, failed = judge("P", counted(400_000, numpy="2.5.0"), ACCEPTED)
    assert not failed
    assert lines[0].endswith("at rest: 400,000 (+0.0% of 400,000)")


def test_without_accepted_counts_nothing_is_judged() -> None:
    lines, failed = judge("Python 3.13, interpreted", counted(1), None)
    assert not failed
    assert "NOT JUDGED" in lines[0]
    assert "make accept-instructions" in lines[0]
