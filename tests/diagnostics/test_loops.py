"""Whole loops with an emulated valve: the short form of `make diagnostics-test`, and the pitfalls."""

from __future__ import annotations

import numpy as np
import pytest
from emulated_loops import Kind, Loop, Played, play
from numpy.typing import NDArray

from positioner.diagnostics.direct.diagnosis import Record, diagnose_stem
from positioner.diagnostics.finding import finding_of
from positioner.diagnostics.indirect.diagnosis import combined, diagnose_loop
from positioner.diagnostics.indirect.loop import Loop as Recorded
from positioner.diagnostics.indirect.loop import range_of, steady
from positioner.diagnostics.indirect.method import Answer
from positioner.diagnostics.indirect.pitfalls import Pitfalls
from positioner.diagnostics.loop_table import LoopTable
from positioner.diagnostics.verdict import Verdict

Array = NDArray[np.float64]


def recorded(played: Played) -> Recorded:
    return Recorded(played.op, played.pv, played.sp, 1.0)


@pytest.mark.parametrize(("stick", "jump", "seed"), [(1.5, 0.5, 11), (9.0, 3.0, 12), (16.0, 10.0, 13)])
def test_a_sticking_valve_is_found(stick: float, jump: float, seed: int) -> None:
    played = play(Loop(Kind.STICKING, stick, jump, seed))
    direct = diagnose_stem(Record(played.op, played.stem, 1.0))
    assert direct.verdict is Verdict.YES
    assert direct.friction is not None
    assert direct.friction.stick.value == pytest.approx(stick, rel=0.05)
    assert direct.friction.jump.value == pytest.approx(jump, abs=0.5)
    if stick >= 8.0:
        indirect = diagnose_loop(recorded(played))
        assert indirect.verdict is Verdict.YES
        assert indirect.stick is not None
        assert indirect.stick.value == pytest.approx(stick, rel=0.25)


def quietly(played: Played, moved: float) -> Recorded:
    """Return the record with OP and PV so much smaller that OP moves by `moved` percent."""
    factor = moved / range_of(played.op)
    op, pv, sp = (50.0 + factor * (each - 50.0) for each in (played.op, played.pv, played.sp))
    return Recorded(op, pv, sp, 1.0)


@pytest.mark.parametrize(
    ("moved", "verdict"), [(0.33, Verdict.UNDECIDED), (1.39, Verdict.UNDECIDED), (1.41, Verdict.NO)]
)
def test_a_no_needs_an_op_that_moves_farther_than_the_stick_band_of_a_valve_that_sticks(
    moved: float, verdict: Verdict
) -> None:
    healthy = play(Loop(Kind.STEPS, 0.1, 0.0, 21))
    found = diagnose_loop(quietly(healthy, moved))
    assert found.verdict is verdict
    needs = f"OP moved by {moved:.2f} % only, and within 1.4 % a stem that sticks may rest: a record is needed in which"
    assert found.reason.startswith(needs) is (verdict is Verdict.UNDECIDED)


def test_a_valve_that_sticks_is_found_though_op_moves_little() -> None:
    assert diagnose_loop(quietly(play(Loop(Kind.STICKING, 9.0, 3.0, 12)), 1.0)).verdict is Verdict.YES


def test_behind_a_stem_that_rests_there_is_no_no() -> None:
    """PV is a disturbance with noise, and OP a PI controller's answer, which nothing in PV answers."""
    draw = np.random.default_rng(0)
    gain, reset_s, keep = draw.uniform(0.3, 3.0), draw.uniform(10.0, 60.0), np.exp(-1.0 / draw.uniform(10.0, 100.0))
    size, noise = draw.uniform(0.05, 0.5) * np.sqrt(1.0 - keep * keep), draw.uniform(0.02, 0.3)
    load, total = 0.0, 0.0
    op, pv = [], []
    for _ in range(3000):
        load = keep * load + size * draw.standard_normal()
        pv.append(50.0 + load + noise * draw.standard_normal())
        total += gain * (50.0 - pv[-1]) / reset_s
        op.append(50.0 + gain * (50.0 - pv[-1]) + total)
    assert range_of(np.array(op)) > 3.0
    found = diagnose_loop(Recorded(np.array(op), np.array(pv), np.zeros(0), 1.0))
    assert found.verdict is Verdict.UNDECIDED
    assert found.reason.startswith("PV does not show that it answers OP")
    table = LoopTable(np.array(op), np.array(pv), None, np.full(3000, 50.0), 1.0, is_timed=True, names={}, notes=())
    assert finding_of("loop", table, 0.0, 100.0).verdict is Verdict.UNDECIDED


@pytest.mark.parametrize("kind", [Kind.HEALTHY, Kind.TIGHT, Kind.SINE, Kind.STEPS])
def test_a_valve_that_does_not_stick_is_not_accused(kind: Kind) -> None:
    played = play(Loop(kind, 0.1, 0.0, 21))
    assert diagnose_stem(Record(played.op, played.stem, 1.0)).verdict is Verdict.NO
    assert diagnose_loop(recorded(played)).verdict is not Verdict.YES


def test_the_transients_after_setpoint_steps_are_left_out_and_nothing_else() -> None:
    sp = np.repeat([50.0, 55.0, 52.0], 300)
    time = np.arange(300)
    draw = np.random.default_rng(1)
    pv = np.concatenate([np.full(300, 50.0), 55.0 - 5.0 * np.exp(-time / 10.0), 52.0 + 3.0 * np.exp(-time / 10.0)])
    keep = steady(Recorded(pv, pv + 0.02 * draw.standard_normal(900), sp, 1.0))
    assert keep[:300].all()
    for step in (300, 600):
        assert not keep[step : step + 40].any()
        assert keep[step + 120 : step + 300].all()


@pytest.mark.parametrize(
    ("op", "pv", "reason"),
    [(0.0, 1.0, "OP stands still"), (1.0, 0.0, "OP moves, and PV stands still"), (0.0, 0.0, "OP stands still")],
)
def test_a_signal_that_stands_still_says_nothing(op: float, pv: float, reason: str) -> None:
    wave = np.sin(2.0 * np.pi * np.arange(1000) / 50.0)
    found = diagnose_loop(Recorded(50.0 + op * wave, 40.0 + pv * wave, np.zeros(0), 1.0))
    assert found.verdict is Verdict.UNDECIDED
    assert reason in found.reason


def test_a_sinusoid_in_both_signals_is_no_proof() -> None:
    answers = tuple(
        Answer(name, "", index, 0.6, 0.4)
        for name, index in (("HAMM", 0.9), ("ADD", 0.9), ("YAM", 0.9), ("CORR", 0.9), ("CURVE", 0.1), ("RELAY", 0.1))
    )
    pitfalls = Pitfalls(is_stuck=False, doubt="", unexcited="", notes=())
    verdict, reason = combined(answers, pitfalls)
    assert verdict is Verdict.UNDECIDED
    assert reason.endswith("OP and PV are both sinusoids, as under an external oscillation")
    triangles = (*answers[:-2], Answer("CURVE", "", 0.5, 0.6, 0.4), answers[-1])
    assert combined(triangles, pitfalls)[0] is Verdict.YES


@pytest.mark.parametrize(
    ("yes", "verdict"),
    [
        ((), Verdict.NO),
        (("CURVE", "RELAY", "AREA", "BIC"), Verdict.NO),
        (("ADD",), Verdict.UNDECIDED),
        (("YAM", "CORR"), Verdict.UNDECIDED),
        (("HAMM", "YAM"), Verdict.YES),
        (("HAMM", "ADD"), Verdict.YES),
    ],
)
def test_two_of_four_decide_and_one_of_them_is_a_model(yes: tuple[str, ...], verdict: Verdict) -> None:
    names = ("HAMM", "ADD", "YAM", "CORR", "CURVE", "RELAY", "AREA", "BIC")
    otherwise = dict.fromkeys(names, 0.1) | {"CURVE": 0.5}
    answers = tuple(Answer(name, "", 0.9 if name in yes else otherwise[name], 0.6, 0.4) for name in names)
    assert combined(answers, Pitfalls(is_stuck=False, doubt="", unexcited="", notes=()))[0] is verdict


def test_a_stuck_valve_is_told_where_a_setpoint_shows_that_the_error_stays() -> None:
    draw = np.random.default_rng(2)
    op: Array = 40.0 + 0.01 * np.arange(3000, dtype=np.float64)
    pv = 45.0 + 0.1 * draw.standard_normal(3000)
    stuck = diagnose_loop(Recorded(op, pv, np.full(3000, 50.0), 1.0))
    assert (stuck.verdict, "stuck" in stuck.reason) == (Verdict.YES, True)
    # the same ramp answers a load that drifts, where PV stays at its setpoint
    assert diagnose_loop(Recorded(op, pv, np.full(3000, 45.0), 1.0)).verdict is not Verdict.YES


def test_a_linear_process_under_an_output_that_drifts_shows_no_valve() -> None:
    """No trend is taken from PV for the models: OP keeps its own, and the difference would look like a slow stem."""
    draw = np.random.default_rng(1)
    op = 50.0 + 5.0 * np.sin(np.arange(20000) / 8.0) + np.cumsum(0.05 * draw.standard_normal(20000))
    pv = [0.0]
    for each in op[:-1].tolist():
        pv.append(0.8 * pv[-1] + 0.2 * each + 0.05 * draw.standard_normal())
    found = diagnose_loop(Recorded(op, np.array(pv), np.zeros(0), 1.0))
    models = {each.name: each for each in found.answers if each.name in {"HAMM", "ADD"}}
    assert models["ADD"].index < 40.0
    assert Verdict.YES not in {each.verdict for each in models.values()}


def test_an_output_that_stands_still_shows_nothing() -> None:
    pv = np.random.default_rng(3).standard_normal(1000)
    found = diagnose_loop(Recorded(np.full(1000, 50.0), pv, np.zeros(0), 1.0))
    assert found.verdict is Verdict.UNDECIDED


def test_a_process_value_of_coarse_steps_makes_a_yes_doubtful() -> None:
    played = play(Loop(Kind.STICKING, 16.0, 10.0, 13))
    size = float(np.std(played.pv))
    coarse = Recorded(played.op, np.round(played.pv / size) * size, played.sp, 1.0)
    found = diagnose_loop(coarse)
    assert found.verdict is Verdict.UNDECIDED
    assert "too coarse" in found.reason


def test_an_output_between_two_limits_makes_a_yes_doubtful() -> None:
    played = play(Loop(Kind.STICKING, 16.0, 10.0, 13))
    low, high = np.quantile(played.op, [0.1, 0.9])
    found = diagnose_loop(Recorded(np.clip(played.op, low, high), played.pv, played.sp, 1.0))
    assert found.verdict is Verdict.UNDECIDED
    assert "between two limits" in found.reason


def test_a_compressed_history_makes_a_yes_doubtful() -> None:
    played = play(Loop(Kind.STICKING, 16.0, 10.0, 13))
    kept = np.arange(0, played.pv.size, 5)
    straight = np.interp(np.arange(played.pv.size), kept, played.pv[kept])
    found = diagnose_loop(Recorded(played.op, straight, played.sp, 1.0))
    assert found.verdict is Verdict.UNDECIDED
    assert "compressed history" in found.reason
