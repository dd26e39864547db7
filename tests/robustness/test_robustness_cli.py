"""`positioner robustness`, as a user calls it: tables, pictures, the worst dwells, what is accepted, and mistakes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from positioner.bench.scenario import load_scenario
from positioner.campaign import study
from positioner.cli import robustness as command
from positioner.cli.main import main
from positioner.robustness import pictures, sets
from positioner.robustness.cases import BEYOND, Case, drawn
from positioner.robustness.judgement import Verdict
from positioner.robustness.play import Dwell, Run, scenario_of
from positioner.robustness.report import is_beyond, short_of_reach_pct, worst_blocks
from positioner.robustness.space import packaged_space
from positioner.robustness.study import Study, code_of


def run(*arguments: str) -> int:
    return main(["robustness", *arguments])


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """One valve of each class with two setpoints, played in this process."""
    space = replace(packaged_space(), dwells=2)
    monkeypatch.setattr("positioner.robustness.space.packaged_space", lambda: space)
    monkeypatch.setattr(command, "_SHORT_VALVES", 1)
    monkeypatch.setattr(command, "_SHORT_DWELLS", 2)
    monkeypatch.setattr(command, "_SHORT_BEYOND", 2)
    monkeypatch.setattr(study, "spread_out", lambda function, items, _: ((item, function(item)) for item in items))


@pytest.mark.usefixtures("small")
def test_a_short_study_shows_every_class_and_is_compared_with_what_was_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, accepted = tmp_path / "out", tmp_path / "accepted.json"
    short = ("--short", "--laws", "pi,two-move-retry", "--out", str(out))
    assert run(*short, "--accept", str(accepted)) == 0
    shown = capsys.readouterr().out
    for name in ("as configured", "within 20 %", "configured wrongly", "not configured", "all"):
        assert f"\n{name} " in shown
    assert "Setpoints beyond reach: 1; the status said so in time in" in shown
    for name in ("report.md", "report.json", "lost.png", "lost.svg", "factors.png"):
        assert (out / name).stat().st_size > 500
    for path in (out / "worst").glob("*.toml"):
        assert load_scenario(str(path)).law == "pi"
    assert shown.count("   - command ") == shown.count("   - law ") == len(list((out / "worst").glob("*.toml"))) > 0
    monkeypatch.setattr(pictures, "draw_factors", lambda *_: None)  # drawn once, which takes longest

    assert run(*short, "--accepted", str(accepted)) == 0  # from the journal: nothing is played
    assert "no class is worse" in capsys.readouterr().err
    kept = json.loads(accepted.read_text(encoding="utf-8"))
    valve = next(iter(kept["as configured"].values()))
    valve["error_pct"] = [0.001, 0.001]
    valve["lost"] = []
    accepted.write_text(json.dumps(kept), encoding="utf-8")
    assert run(*short, "--accepted", str(accepted)) == 1
    assert "worse: as configured: lost" in capsys.readouterr().err
    accepted.write_text("{}", encoding="utf-8")
    assert run(*short, "--accepted", str(accepted)) == 2
    assert "accept anew" in capsys.readouterr().err

    assert run(*short, "--json") == 0
    document = json.loads(capsys.readouterr().out, parse_constant=_refused)  # JSON has no Infinity
    assert document["laws"] == ["pi", "two-move-retry"]
    for figures in (*document["classes"], *(each["law"] for each in document["bins"])):
        low, high = figures["lost"]["limits"]
        assert 0.0 <= low <= figures["lost"]["count"] / figures["lost"]["of"] <= high <= 1.0


def _refused(constant: str) -> None:
    raise AssertionError(constant)


@pytest.mark.usefixtures("small")
def test_the_worst_dwell_after_a_restart_is_replayed_after_what_taught_its_table(tmp_path: Path) -> None:
    case = replace(next(iter(sets.SETS["restart"](packaged_space(), 1))), restart=True, period_s=0.01)
    run = Run(case, "pi")
    lost = Dwell(
        setpoint_mm=case.setpoints_mm[0], step_mm=9.0, error_pct=9.0, worst_pct=9.0, settle_s=None, overshoot_pct=0.0,
        moves=0, travel_mm=9.0, ideal_mm=9.0, hunts=False, good=True, told_s=None, end_mm=1.0,
    )  # fmt: skip
    verdict = Verdict(case=case, number=0, by_law={"pi": lost}, optimal_s=0.1, reachable=True)
    lines = worst_blocks(Study(("pi",), (verdict,), ()), tmp_path)
    first, second = (str(line) for line in lines if "positioner bench" in str(line))
    assert "01-before.toml" in first
    assert f"--state {tmp_path}/worst/01-before/state" in second
    before, after = (load_scenario(str(tmp_path / "worst" / name)) for name in ("01-before.toml", "01.toml"))
    assert (before.seed, after.seed) == (case.seed + 1, case.seed)
    assert replace(before, seed=after.seed) == after == replace(scenario_of(run), name="worst-1")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--valves", "0"), "--valves 0: at least 1 is needed"),
        (("--set", "lags", "--short"), "--short is about random valves: --set lags is shorter with --valves 1"),
        (("--laws", "nmcp"), "nmpc"),
        (("--config", "missing.toml"), "missing.toml"),
    ],
)
def test_a_mistake_is_one_line(
    arguments: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments, "--out", str(tmp_path / "out")) != 0
    error = capsys.readouterr().err
    assert says in error
    assert "Traceback" not in error


def test_the_help_names_every_set() -> None:
    assert sorted(command.SETS) == sorted(sets.SETS)


def test_a_change_of_nmpc_leaves_the_baselines_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    before = {law: code_of(law) for law in ("nmpc", "pi", "two-move-retry", "paper", "time-optimal")}
    read = Path.read_bytes
    changed = lambda self: read(self) + (b"#" if "nmpc" in self.parent.parts else b"")  # noqa: E731
    monkeypatch.setattr(Path, "read_bytes", changed)
    after = {law: code_of(law) for law in before}
    assert {law for law in before if before[law] != after[law]} == {"nmpc"}


def test_a_stem_at_the_end_of_its_reach_is_0_percent_short() -> None:
    def end_of(case: Case) -> float:
        valve = case.true["valve"]
        push_n = valve["diaphragm_area_m2"] * 5171.06775 * 20.0
        return float((push_n - valve["bench_set_n"] - valve["coulomb_friction_n"]) / valve["spring_rate_n_per_m"])

    case = next(each for each in drawn(packaged_space(), BEYOND, 8, 1) if end_of(each) < 0.1397)  # not at the stop
    end_m = end_of(case)
    for ends_mm, short in ((end_m * 1e3, 0.0), (end_m * 1e3 - 1.27, 1.0), (end_m * 1e3 + 5.0, 0.0)):
        dwell = Dwell(
            setpoint_mm=200.0, step_mm=50.0, error_pct=9.0, worst_pct=9.0, settle_s=None, overshoot_pct=0.0, moves=1,
            travel_mm=50.0, ideal_mm=60.0, hunts=False, good=False, told_s=1.0, end_mm=ends_mm,
        )  # fmt: skip
        verdict = Verdict(case=case, number=1, by_law={"pi": dwell}, optimal_s=0.1, reachable=False)
        assert short_of_reach_pct(verdict, "pi") == pytest.approx(short, abs=1e-6)
        for setpoint_mm, beyond in ((200.0, True), (end_m * 1e3 + 1.3, True), (end_m * 1e3 + 1.2, False)):
            asked = replace(verdict, by_law={"pi": replace(dwell, setpoint_mm=setpoint_mm)})
            assert is_beyond(asked, "pi") is beyond
