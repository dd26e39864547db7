"""Laws from outside: of a file, or of an installed distribution; what is wrong with one is one clear line."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.metrics import dwell_metrics
from positioner.bench.scenario import Scenario
from positioner.bus.address import embedded_address
from positioner.campaign.run import Run, play
from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.cycle.events import LawFellBack
from positioner.errors import ConfigurationError, ExitCode
from positioner.inputs.plug_in import Kind, loaded, problem_of
from positioner.studies import tuning
from positioner.studies.code_digest import code_digest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = f"{ROOT}/examples/my_law.py:MyLaw"
SCENARIO = Scenario(name="own", title="a law of one's own", law=EXAMPLE, setpoints_mm=(73.0, 87.0), dwell_s=1.0)
VALVE = '[valve]\nid = "FV-101"\npreset = "paper"\n[control]\nlaw = "{law}"\n'

SIMPLE = """\
class Simple:
    def __init__(self, parts, gain=3.0):
        self.balance, self.gain = parts.valve.balance_current_ma, gain
    def begin(self, measured_m):
        return 0.0
    def decide(self, memory, stem, observation, table):
        {body}
        return memory, self.balance(observation.setpoint_m)
"""


def written(folder: Path, body: str = "pass", text: str = SIMPLE) -> str:
    (folder / "own.py").write_text(text.replace("{body}", body), encoding="utf-8")
    return f"{folder}/own.py:Simple"


def test_the_example_controls_the_valve_in_at_most_20_lines() -> None:
    assert len((ROOT / "examples" / "my_law.py").read_text(encoding="utf-8").splitlines()) <= 20
    run = run_in_process(SCENARIO)
    first, second = dwell_metrics(run.recording.trace, SCENARIO.dwell_edges_s, 0.127)
    assert 0.1 < max(first.mean_abs_error_pct, second.mean_abs_error_pct) < 6.0  # it moves there, and sticks beside it
    assert not [event for event in run.events if isinstance(event, LawFellBack)]


def test_a_law_that_answers_with_a_current_gets_the_guards_limits_and_the_last_word_is_the_guards(
    tmp_path: Path,
) -> None:
    law = written(tmp_path, "return memory, 1e6")
    run = run_in_process(replace(SCENARIO, law=law, setpoints_mm=(80.0,), dwell_s=0.1))
    assert {cycle.decision.current_ma for cycle in run.cycles} == {1e6}
    assert max(cycle.current_ma for cycle in run.cycles) == 20.0
    assert {cycle.decision.bounds.current_high_ma for cycle in run.cycles} == {20.0}
    assert {cycle.stem.stuck for cycle in run.cycles} == {False}


def test_a_law_gets_its_parameters_from_the_configuration(tmp_path: Path) -> None:
    written(tmp_path)
    path = tmp_path / "valve.toml"
    path.write_text(VALVE.format(law="own.py:Simple") + "[control.parameters]\ngain = 4.5\n", encoding="utf-8")
    configuration = load_config(path)
    assert configuration.control.law == f"{tmp_path}/own.py:Simple"  # beside the configuration
    assert configuration.make_law(plays=True).own.gain == 4.5  # type: ignore[attr-defined]
    path.write_text(VALVE.format(law="own.py:Simple") + "[control.parameters]\nspeed = 4.5\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"own.py:Simple: law: cannot be made: TypeError: .*'speed'"):
        load_config(path).make_law(plays=True)
    path.write_text(VALVE.format(law="pi") + "[control.parameters]\ngain = 4.5\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"control.parameters: are for a law from outside"):
        load_config(path)


@pytest.mark.parametrize(
    ("text", "name", "expected"),
    [
        ("class Simple(:\n", "Simple", "own.py, line 1: invalid syntax"),
        ("Simple = 0\0\n", "Simple", "own.py: source code string cannot contain null bytes"),
        ("class Other: pass\n", "Simple", "own.py has no Simple; known: Other"),
        ("class Simpel: pass\n", "Simple", "own.py has no Simple; did you mean 'Simpel'?"),
        ("", "Simple", "own.py has no Simple; it defines nothing"),
    ],
)
def test_a_file_without_the_law_is_told_before_its_code_runs(
    text: str, name: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own.py").write_text(text, encoding="utf-8")
    law = f"{tmp_path}/own.py:{name}"
    for command in (["bench", "--law", law], ["league", "--laws", f"nmpc,{law}"]):
        assert main([*command, "--out", str(tmp_path / "out")]) == ExitCode.USAGE
        (line,) = capsys.readouterr().err.splitlines()
        assert expected in line
    assert not (tmp_path / "out").exists()


def test_the_name_of_a_file_alone_and_of_a_file_that_is_not_there_are_told() -> None:
    assert problem_of(Kind.LAW, "own.py", ()) == "names a file: say which law in it is meant: own.py:NAME"
    assert problem_of(Kind.LAW, "away.py:X", ()) == "away.py cannot be read: No such file or directory"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("import numpi\nSimple = 1\n", r"own.py: line 1: code: ModuleNotFoundError: No module named 'numpi'"),
        ("x = 1\nSimple = x / 0\n", r"own.py: line 2: code: ZeroDivisionError: division by zero"),
        ("Simple = 3\n", r"own.py:Simple: law: cannot be made: TypeError: 'int' object is not callable"),
        ("class Simple:\n  def __init__(self, parts): parts.no\n",
         r"own.py:Simple: line 2: law: cannot be made: AttributeError: .* no attribute 'no'"),
        ("class Simple:\n  def __init__(self, parts): pass\n", r"own.py:Simple: law: has no begin and no decide"),
        ("raise SystemExit(3)\nSimple = 1\n", r"own.py: line 1: code: SystemExit: 3"),
    ],
)  # fmt: skip
def test_code_that_cannot_make_a_law_is_one_line_with_the_line_in_the_file(
    text: str, expected: str, tmp_path: Path
) -> None:
    law = written(tmp_path, text=text)
    with pytest.raises(ConfigurationError, match=expected) as caught:
        configure(replace(SCENARIO, law=law)).make_law(plays=True)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("1 / 0", "OutsideLawError: ZeroDivisionError: division by zero (own.py, line 7)"),
        ("raise SystemExit('no')", "OutsideLawError: SystemExit: no (own.py, line 7)"),
        ("return memory", "OutsideLawError: TypeError: "),  # of an unpacking, in the words of each build
        ("return memory, None", "TypeError: decide answers with a NoneType; it must be (memory, current in mA) or"),
        ("return memory, float('nan')", "ValueError: a current of nan mA"),
    ],
)
def test_a_law_that_fails_in_its_step_decides_nothing_and_the_guard_goes_on(
    body: str, expected: str, tmp_path: Path
) -> None:
    run = run_in_process(replace(SCENARIO, law=written(tmp_path, body), setpoints_mm=(80.0,), dwell_s=0.1))
    texts = {event.why for event in run.events if isinstance(event, LawFellBack)}
    assert len(texts) == 1
    assert f"own.py:Simple failed: {expected}" in texts.pop()
    assert not run.cycles
    assert run.recording.commands == 100  # the guard commands in each cycle


def test_a_file_is_loaded_again_when_it_has_changed_and_its_neighbours_can_be_imported(tmp_path: Path) -> None:
    (tmp_path / "beside_it.py").write_text("VALUE = 5\n", encoding="utf-8")
    path = tmp_path / "own.py"
    path.write_text("import beside_it\nA = beside_it.VALUE\n", encoding="utf-8")
    assert loaded(Kind.LAW, f"{path}:A") == 5
    path.write_text("A = 6\n", encoding="utf-8")
    assert loaded(Kind.LAW, f"{path}:A") == 6


def test_the_digest_follows_the_file_and_what_it_imports_beside_it(tmp_path: Path) -> None:
    law = written(tmp_path, "import helper_of_own")
    (tmp_path / "helper_of_own.py").write_text("from deeper_of_own import x\n", encoding="utf-8")
    (tmp_path / "deeper_of_own.py").write_text("x = 1\n", encoding="utf-8")
    (tmp_path / "unused.py").write_text("x = 1\n", encoding="utf-8")
    seen = [code_digest(law)]
    for name, text in (("unused", "x = 2\n"), ("deeper_of_own", "x = 2\n"), ("helper_of_own", "\n"), ("own", "\n")):
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
        seen.append(code_digest(law))
    assert seen[0] == seen[1]
    assert len(set(seen)) == 4
    assert code_digest("nmpc") == code_digest("nmpc")


def test_an_installed_distribution_brings_a_law_by_an_entry_point(tmp_path: Path) -> None:
    package = tmp_path / "laws_of_theirs"
    package.mkdir()
    (package / "__init__.py").write_text("", encoding="utf-8")
    plant = 'VALVE = {"preset": "paper", "valve": {"spring_rate_n_per_m": 60000.0}}\n'
    (package / "law.py").write_text(SIMPLE.format(body="pass") + plant, encoding="utf-8")
    info = tmp_path / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(
        "[positioner.laws]\ntheirs = laws_of_theirs.law:Simple\nbroken = laws_of_theirs.away:Simple\n"
        "[positioner.plants]\nvalve-of-theirs = laws_of_theirs.law:VALVE\n",
        encoding="utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}

    def positioner(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "positioner", *words]
        return subprocess.run(
            command, env=environment, cwd=tmp_path, check=False, capture_output=True, text=True, timeout=120.0
        )

    shown = positioner("bench", "--help").stdout
    assert "theirs" in shown
    assert "valve-of-theirs" in shown
    league = [
        "league",
        "--plants",
        "valve-of-theirs",
        "--seeds",
        "1",
        "--setpoints",
        "80",
        "--dwell",
        "0.05",
        "--workers",
        "1",
    ]
    done = positioner(*league, "--laws", "theirs")
    assert done.returncode == 0, done.stderr
    assert "theirs" in done.stdout
    assert "valve-of-theirs" in done.stdout
    done = positioner(*league, "--laws", "broken")
    assert done.returncode == ExitCode.CONFIG
    assert "broken: laws_of_theirs.away:Simple of theirs: cannot be loaded: ModuleNotFoundError" in done.stderr
    done = positioner(*league, "--laws", "thiers")
    assert done.returncode == ExitCode.USAGE
    assert "law 'thiers' is unknown; did you mean 'theirs'?" in done.stderr


def test_in_a_league_a_law_that_raises_loses_its_bout_and_the_others_are_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    law = written(tmp_path, "memory / (0.0 if observation.setpoint_m > 0.079 else 1.0)")
    words = ["league", "--plants", "paper", "--seeds", "1", "--dwell", "0.05", "--out", str(tmp_path / "out")]
    words += ["--workers", "1"]
    assert main([*words, "--laws", f"pi,{law}", "--setpoints", "80"]) == ExitCode.FAILURE
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line.startswith("positioner: ")]
    told = "own.py:Simple failed: OutsideLawError: ZeroDivisionError: float division by zero (own.py, line 7)"
    assert lines == [f"positioner: {told}; 1 of its bouts, the first on paper, seed 1, are not in the figures"]
    assert "pi" in captured.out
    assert "own.py" not in captured.out
    # the edited law is played again, the other one is not
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "bouts").iterdir()}
    written(tmp_path, "memory / 1.0")
    assert main([*words, "--laws", f"pi,{law}", "--setpoints", "80"]) == ExitCode.OK
    assert "own.py:Simple" in capsys.readouterr().out
    after = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "bouts").iterdir()}
    assert sorted(path.name[:2] for path in after if after[path] != before.get(path)) != []
    assert [path.name[:2] for path in after if after[path] == before.get(path)] == ["pi"]
    assert main([*words, "--laws", law, "--setpoints", "80"]) == ExitCode.OK


def test_a_law_from_outside_is_tuned_within_the_limits_that_it_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tuning, "DWELL_S", 0.1)
    monkeypatch.setattr(tuning, "VISITS", 1)
    law = written(tmp_path, text=SIMPLE.replace("{body}", "pass") + "    tuned = {'gain': (1.0, 2.0)}\n")
    for plant in ([], ["--plant", "friction+20"]):
        assert main(["tune", law, "--budget", "2", "--workers", "1", *plant]) == ExitCode.OK
        text = capsys.readouterr().out
        assert " ".join([f"# positioner tune {law}", *plant, "--budget 2"]) in text
        (tmp_path / "tuned.toml").write_text(text, encoding="utf-8")
        configuration = load_config(tmp_path / "tuned.toml")
        assert 1.0 < configuration.control.parameters["gain"] < 2.0
        assert configuration.make_law(plays=True).name == "own.py:Simple"
        assert configuration.valve.static_friction_n == pytest.approx(1707.7 * (1.2 if plant else 1.0), rel=1e-3)


@pytest.mark.parametrize(
    ("tuned", "expected"),
    [
        ("", "has nothing to tune; write it in the class as tuned = "),
        ("    tuned = {'gain': 3}\n", "tuned['gain'] = 3: needs two limits above 0"),
        ("    tuned = {'gain': (2, 1)}\n", "tuned['gain'] = (2, 1): needs two limits above 0"),
    ],
)
def test_a_law_without_limits_cannot_be_tuned(
    tuned: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    law = written(tmp_path, text=SIMPLE.replace("{body}", "pass") + tuned)
    assert main(["tune", law, "--budget", "1", "--workers", "1"]) == ExitCode.USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
    assert main(["tune", "nmpc", "--budget", "1", "--workers", "1"]) == ExitCode.USAGE
    assert "law 'nmpc' has nothing to tune; known: pi" in capsys.readouterr().err


def test_in_a_campaign_a_law_that_raises_has_no_figures_and_its_error_is_told(tmp_path: Path) -> None:
    scenario = replace(SCENARIO, law=written(tmp_path, "1 / 0"), setpoints_mm=(80.0,), dwell_s=0.05)
    outcome = play(Run(0, (), scenario))
    assert outcome.figures is None
    assert "own.py:Simple failed: OutsideLawError: ZeroDivisionError" in (outcome.failure or "")
    good = play(Run(0, (), replace(scenario, law=EXAMPLE)))
    assert (good.figures is None, good.failure) == (False, None)


def test_an_error_of_a_worker_arrives_as_it_was_raised(tmp_path: Path) -> None:
    law = written(tmp_path, text="raise ValueError(3)\nSimple = 1\n")
    with pytest.raises(ConfigurationError) as caught:
        loaded(Kind.LAW, law)
    again = pickle.loads(pickle.dumps(caught.value))  # noqa: S301 - our own
    assert (str(again), again.problems) == (str(caught.value), caught.value.problems)


@pytest.mark.bus
def test_a_law_in_a_relative_file_controls_a_valve_on_a_bus_and_its_log_replays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path)
    (tmp_path / "short.toml").write_text(
        'name = "short"\ntitle = "short"\nlaw = "own.py:Simple"\nsetpoints_mm = [80.0]\ndwell_s = 0.1\n',
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)
    bus = str(embedded_address(os.getpid()))
    assert main(["bench", "--scenario", "./short.toml", "--bus", bus, "--out", "out"]) == ExitCode.OK
    told = f"WARNING law own.py:Simple ({tmp_path}/own.py) is from outside of this package"
    assert told in (tmp_path / "out" / "positioner.log").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path / "out")  # the configuration holds the whole path
    capsys.readouterr()
    assert main(["replay", "bus.log", "--config", "valve.toml"]) == ExitCode.OK
    assert "identical" in capsys.readouterr().out
    assert main(["replay", "bus.log", "--config", "valve.toml", "--law", "../own.py:Simple"]) == ExitCode.OK
