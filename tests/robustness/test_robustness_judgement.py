"""Lost dwells, their bounds, the best baseline, and what is accepted: against numbers worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from positioner.robustness.accepted import as_accepted, compared
from positioner.robustness.cases import BEYOND, Case
from positioner.robustness.judgement import Rate, bins, distribution, undecided, verdicts, worst
from positioner.robustness.play import OPTIMAL, Dwell, Played

if TYPE_CHECKING:
    from positioner.robustness.judgement import Verdict

FINE = Dwell(
    setpoint_mm=80.0, step_mm=10.0, error_pct=0.1, worst_pct=0.2, settle_s=0.2, overshoot_pct=0.0, moves=1,
    travel_mm=10.0, ideal_mm=10.0, hunts=False, good=True, told_s=None, end_mm=80.1,
)  # fmt: skip


def case(name: str, group: str = "as configured", **factors: float) -> Case:
    return Case(group=group, name=name, seed=1, period_s=0.001, setpoints_mm=(80.0,), true={}, told={}, factors=factors)


def ending(*errors_pct: float, hunts: bool = False) -> Played:
    return Played(tuple(replace(FINE, error_pct=each, hunts=hunts) for each in errors_pct))


def judged(**by_law: Played) -> list[Verdict]:
    return verdicts([case("1")], {"as configured/1": dict(by_law)}, {})


def test_a_dwell_is_lost_where_it_ends_off_or_hunts_though_some_law_reached_it() -> None:
    found = judged(ours=ending(1.01, 0.99, 5.0, 0.4), pi=ending(0.5, 0.1, 0.51, 9.0))
    assert [each.is_lost("ours") for each in found] == [True, False, False, False]
    assert [each.is_lost("pi") for each in found] == [False, False, False, True]
    hunting = judged(ours=ending(0.2, hunts=True), pi=ending(0.2))
    assert hunting[0].is_lost("ours")
    assert not judged(ours=ending(0.2, hunts=True), pi=ending(3.0))[0].reachable


def test_the_law_with_the_true_parameters_is_asked_only_where_nobody_reached_a_lost_dwell() -> None:
    one = case("1")
    assert not undecided(one, {"ours": ending(0.6, 0.1), "pi": ending(0.7, 8.0)})  # not lost, or reached
    assert undecided(one, {"ours": ending(2.0), "pi": ending(0.7)})
    assert not undecided(case("1", BEYOND), {"ours": ending(2.0), "pi": ending(0.7)})
    played = {"as configured/1": {"ours": ending(2.0), "pi": ending(0.7)}}
    assert not verdicts([one], played, {})[0].is_lost("ours")
    assert verdicts([one], played, {"as configured/1": ending(0.5)})[0].is_lost("ours")


def test_a_case_that_a_law_could_not_play_is_left_out() -> None:
    played = {"as configured/1": {"ours": ending(0.1), "pi": Played((), failure="ValueError: no")}}
    assert verdicts([case("1")], played, {}) == []
    assert len(verdicts([case("1")], {"as configured/1": {"ours": ending(0.1), OPTIMAL: Played((), (0.1,))}}, {})) == 1


def test_the_limits_of_a_rate_are_those_of_clopper_and_pearson() -> None:
    # nothing in n: 1 - 0.025^(1/n); all of n: 0.025^(1/n)
    assert Rate(count=0, of=200).limits == pytest.approx((0.0, 1.0 - 0.025 ** (1 / 200)))
    assert Rate(count=200, of=200).limits == pytest.approx((0.025 ** (1 / 200), 1.0))
    low, high = Rate(count=3, of=40).limits
    assert (low, high) == pytest.approx((0.0157, 0.2039), abs=2e-4)


def test_the_figures_of_a_law_are_those_of_its_dwells() -> None:
    played = {
        f"as configured/{number}": {
            "ours": Played(
                tuple(replace(FINE, error_pct=0.1 * number, settle_s=None if number == 4 else 0.2) for _ in range(2))
            ),
            OPTIMAL: Played((), (0.1, 0.1)),
        }
        for number in range(5)
    }
    found = distribution("ours", verdicts([case(str(number)) for number in range(5)], played, {}))
    assert found.dwells == 10
    assert found.mean_pct == pytest.approx(0.2)
    assert found.quantiles_pct[0] == pytest.approx(0.2)
    assert found.worst_pct == pytest.approx(0.4)
    assert found.settle_ratio == pytest.approx(2.0)
    assert math.isinf(found.settle_ratio_95)
    assert (found.moves, found.travel_ratio) == (1.0, 1.0)
    assert found.difference_pct is None


def test_a_law_is_worse_where_the_interval_paired_by_valve_lies_above_zero() -> None:
    cases = [case(str(number)) for number in range(4)]

    def study(gaps_pct: tuple[float, ...]) -> list[Verdict]:
        played = {
            each.label: {"ours": ending(0.3 + gap, 0.3 + gap), "pi": ending(0.3, 0.3), "far": ending(3.0, 3.0)}
            for each, gap in zip(cases, gaps_pct, strict=True)
        }
        return verdicts(cases, played, {})

    found = distribution("ours", study((0.1, 0.12, 0.08, 0.1)), ("pi", "far"))
    assert found.baseline == "pi"
    assert found.difference_pct is not None
    # Student's t with 3 degrees of freedom is 3.182; the standard deviation of the means is 0.01633
    half = 3.182 * 0.01633 / 2.0
    assert found.difference_pct == pytest.approx((0.1, 0.1 - half, 0.1 + half), abs=1e-4)
    assert found.is_worse
    assert not distribution("ours", study((0.1, -0.2, 0.1, 0.1)), ("pi", "far")).is_worse
    assert not distribution("ours", study((-0.1, -0.12, -0.08, -0.1)), ("pi", "far")).is_worse


def test_bins_of_a_factor_have_200_dwells_or_more_and_divide_no_valve() -> None:
    cases = [case(str(number), lag_s=0.001 * number) for number in range(100)]
    played = {each.label: {"ours": ending(*[0.1] * 9), "pi": ending(*[0.2] * 9)} for each in cases}
    step, *rest = bins("ours", ("pi",), verdicts(cases, played, {}))
    numbers, found = rest[:-4], rest[-4:]
    assert (step.factor, step.law.dwells) == ("step_of_span", 900)  # all steps are equal: one bin
    assert step.low == step.high == pytest.approx(10.0 / 127.0)
    assert {each.factor for each in numbers} == {"number_of_setpoint"}
    assert [(each.low, each.high) for each in numbers] == [(1, 3), (4, 5), (6, 7), (8, 9)]
    assert [each.law.dwells for each in numbers] == [300, 200, 200, 200]
    assert [each.factor for each in found] == ["lag_s"] * 4
    assert [each.law.dwells for each in found] == [225] * 4
    assert found[0].low == 0.0
    assert found[-1].high == pytest.approx(0.099)
    assert all(before.high < after.low for before, after in pairwise(found))
    assert {each.best.law for each in found if each.best} == {"pi"}

    uneven = {each.label: {"ours": ending(*[0.1] * 10), "pi": ending(*[0.2] * 10)} for each in cases[:85]}
    parts = [each for each in bins("ours", ("pi",), verdicts(cases[:85], uneven, {})) if each.factor == "lag_s"]
    assert [each.law.dwells for each in parts] == [220, 210, 210, 210]
    assert all(before.high < after.low for before, after in pairwise(parts))


def test_the_step_is_a_factor_of_each_dwell() -> None:
    dwells = tuple(replace(FINE, step_mm=-1.27 * number, error_pct=0.01 * number) for number in range(1, 5))
    cases = [case(str(number)) for number in range(100)]
    played = {each.label: {"ours": Played(dwells)} for each in cases}
    low, high = (each for each in bins("ours", (), verdicts(cases, played, {})) if each.factor == "step_of_span")
    assert [low.low, low.high, high.low, high.high] == pytest.approx([0.01, 0.02, 0.03, 0.04])
    assert [low.law.worst_pct, high.law.worst_pct] == pytest.approx([0.02, 0.04])


def test_the_worst_dwells_are_of_different_valves_and_lost() -> None:
    cases = [case(str(number)) for number in range(3)]
    played = {
        "as configured/0": {"ours": ending(4.0, 9.0), "pi": ending(0.1, 0.1)},
        "as configured/1": {"ours": ending(5.0, 0.1), "pi": ending(0.1, 0.1)},
        "as configured/2": {"ours": ending(50.0, 0.1), "pi": ending(40.0, 0.1)},  # nobody reaches it
    }
    found = worst("ours", verdicts(cases, played, {}), 20)
    assert [(each.case.name, each.number) for each in found] == [("0", 1), ("1", 0)]


def test_what_is_accepted_holds_until_a_class_loses_more_or_its_median_grows() -> None:
    before = judged(ours=ending(0.1, 0.2, 0.3, 2.0), pi=ending(0.1, 0.1, 0.1, 0.1))
    accepted = as_accepted("ours", before)
    assert compared("ours", before, accepted) == []

    more = compared("ours", judged(ours=ending(0.1, 0.2, 1.3, 2.0), pi=ending(0.1, 0.1, 0.1, 0.1)), accepted)
    assert more[0].worse
    assert "lost 1 → 2 of 4" in more[0].text
    assert [each.text.strip() for each in more[1:]] == ["as configured/1, dwell 3: lost now, 0.3 → 1.3 %"]

    fewer = compared("ours", judged(ours=ending(0.1, 0.2, 0.3, 0.4), pi=ending(0.1, 0.1, 0.1, 0.1)), accepted)
    assert not any(each.worse for each in fewer)
    assert "no longer lost" in fewer[1].text

    slower = compared("ours", judged(ours=ending(0.1, 0.2, 0.32, 2.0), pi=ending(0.1, 0.1, 0.1, 0.1)), accepted)
    assert slower[0].worse
    assert not compared("ours", judged(ours=ending(0.1, 0.2, 0.31, 2.0), pi=ending(0.1, 0.1, 0.1, 0.1)), accepted)[
        0
    ].worse
    with pytest.raises(ValueError, match="other classes or valves"):
        compared("ours", verdicts([case("2")], {"as configured/2": {"ours": ending(0.1)}}, {}), accepted)


def test_a_law_that_plays_alone_is_worse_where_one_more_dwell_ends_off() -> None:
    accepted = as_accepted("ours", judged(ours=ending(0.1, 0.2, 0.3, 0.4)))
    found = compared("ours", judged(ours=ending(0.1, 0.2, 0.3, 9.0)), accepted)
    assert found[0].worse
    assert "lost 0 → 0 of 4" in found[0].text  # nobody shows that it can be reached
    assert "0 → 1 more than 1 % off" in found[0].text
