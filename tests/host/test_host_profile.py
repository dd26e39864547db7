"""A profile of setpoints: its file checked before anything moves, its setpoints at their instants, its ends."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from virtual_bench import MS, TEXT, Bench

from positioner.cli.main import main
from positioner.errors import ConfigurationError, ExitCode, HostError, UsageError
from positioner.host.profile import Profile
from positioner.host.profile_file import read_profile
from positioner.host.verbs import Verb, Word, read_verbs
from positioner.inputs.setpoint_file import SetpointRow, setpoint_rows
from positioner.wire.messages import Mode, Setpoint

if TYPE_CHECKING:
    from pathlib import Path

SPAN_M = 0.127
GOOD = "time_s,setpoint_mm\n0,80\n1,85\n1.5,73\n"


def rows_of(text: str) -> list[tuple[float, float]]:
    return [(row.time_s, round(row.setpoint_m, 9)) for row in setpoint_rows("p.csv", text, SPAN_M)]


def verb_of(path: Path, it: Bench, *words: str) -> Verb:
    (verb,) = read_verbs(["profile", str(path), *words], it.configuration.valve, it.configuration.guard)
    profile = read_profile(verb, it.configuration.valve, it.configuration.guard)
    return replace(verb, profile=profile)


@pytest.fixture
def armed() -> Bench:
    it = Bench()
    it.say("arm")
    return it


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        "time_s;setpoint_mm\n0;80,0\n1;85,0\n1,5;73,0\n",
        "# by hand\n\nnote,setpoint_m,time_s\nx,0.080,0\ny,0.085,1\n,0.073,1.5\n",
        '"time_s"\t"setpoint_mm"\n0\t80\n1\t85\n1.5\t73\n',
        "time_s,setpoint_pct\n0,62.992125984\n1,66.929133858%\n1.5,57.480314961\n",
    ],
)
def test_a_file_may_have_any_delimiter_order_and_unit(text: str) -> None:
    assert rows_of(text) == [(0.0, 0.08), (1.0, 0.085), (1.5, 0.073)]


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("", ["file: is empty; write the header time_s,setpoint_mm (or setpoint_pct, setpoint_m)"]),
        ("0,80\n1,85\n", ["line 1: header: has no column time_s; write the header time_s,setpoint_mm"]),
        ("time,setpoint_mm\n0,80\n", ["line 1: header: has no column time_s; write"]),
        ("time_s,setpoint\n0,80\n", ["line 1: header: has no column with setpoints and their unit; write"]),
        ("time_s,setpoint_mm,setpoint_pct\n0,80,2\n", ["line 1: header: has setpoint_mm and setpoint_pct: one column"]),
        (GOOD + "2\n", ["line 5: row: has 1 cells, and the header has 2"]),
        (GOOD + "x,80\n", ["line 5: time_s: 'x' is no number"]),
        (GOOD + "1.5,80\n", ["line 5: time_s = 1.5: must be later than 1.5 of the row before; sort the rows"]),
        (GOOD + "nan,80\n", ["line 5: time_s: 'nan' is no number"]),
        (GOOD + "2,inf\n", ["line 5: setpoint_mm = inf: is no number"]),
        ("time_s,setpoint_pct\n0,60%\n5%,62%\n", ["line 3: time_s: '5%' is no number"]),
        (GOOD + "2,60%\n", ["line 5: setpoint_mm = 60%: percent stand in a column setpoint_pct"]),
        ("time_s,setpoint_mm\n0,80\n", ["file: holds fewer than two rows; give at least two instants"]),
        (GOOD + "2,\n\n3,y\n", ["line 5: setpoint_mm = : is no number", "line 7: setpoint_mm = y: is no number"]),
    ],
)
def test_every_mistake_of_a_file_gets_one_line_with_its_place(text: str, lines: list[str]) -> None:
    with pytest.raises(ConfigurationError) as caught:
        setpoint_rows("p.csv", text, SPAN_M)
    told = str(caught.value).splitlines()
    assert len(told) == len(lines)
    for one, other in zip(told, lines, strict=True):
        assert one.startswith(f"p.csv: {other}")


def test_of_many_mistakes_the_first_are_told_and_the_others_counted() -> None:
    with pytest.raises(ConfigurationError) as caught:
        setpoint_rows("p.csv", "time_s,setpoint_mm\n" + "x,1\n" * 100, SPAN_M)
    told = str(caught.value).splitlines()
    assert (len(told), told[-1]) == (21, "p.csv: file: and 80 more mistakes")


def test_a_command_line_tells_every_setpoint_out_of_reach_and_moves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, path = tmp_path / "valve.toml", tmp_path / "my steps.csv"
    config.write_text(TEXT + '[bus]\ninterface = "embedded"\nchannel = "nobody"\n', encoding="utf-8")
    path.write_text("time_s,setpoint_mm\n0,80\n1,300\n2,-1\n", encoding="utf-8")
    assert main(["host", "--config", str(config), "arm", "profile", str(path)]) == ExitCode.CONFIG
    assert capsys.readouterr().err.splitlines() == [
        f"positioner: {path}: line 3: setpoint_mm = 300: 300 mm is outside the travel of 0 to 139.7 mm",
        f"{path}: line 4: setpoint_mm = -1: -1 mm is outside the travel of 0 to 139.7 mm",
    ]
    assert main(["host", "--config", str(config), "profile", str(tmp_path / "none.csv")]) == ExitCode.USAGE
    assert "none.csv: cannot be read: No such file" in capsys.readouterr().err


WANTED = "give a whole number from 1 to 1000000, or `forever`"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("profile", "profile needs a file: `profile steps.csv`, with the columns time_s and setpoint_mm"),
        ("profile a.csv repeat", "profile a.csv repeat : give a whole number from 1 to 1000000, or `forever`"),
        ("profile a.csv repeat 0", "profile a.csv repeat 0: give a whole number from 1 to 1000000, or `forever`"),
        ("profile a.csv repeat 1.5", "profile a.csv repeat 1.5: give a whole number from 1 to 1000000, or `forever`"),
        (
            "profile a.csv repeat 1000001",
            f"profile a.csv repeat 1000001: {WANTED}",
        ),
        (
            f"profile a.csv repeat {'9' * 5000}",
            f"profile a.csv repeat {'9' * 600}…: {WANTED}",
        ),
        ("profile 'a.csv", "profile 'a.csv: a quotation mark stands alone"),
    ],
)
def test_a_wrong_line_of_a_profile_gets_one_line(text: str, line: str) -> None:
    it = Bench.configuration_of(TEXT)
    with pytest.raises(UsageError) as caught:
        read_verbs([text], it.valve, it.guard)
    assert str(caught.value) == line


def test_a_name_keeps_its_case_and_its_blanks() -> None:
    it = Bench.configuration_of(TEXT)
    for words in (["arm", "profile", "My Steps.csv", "repeat", "3"], ['ARM profile "My Steps.csv" REPEAT 3']):
        arm, profile = read_verbs(words, it.valve, it.guard)
        assert (arm.word, profile.word, profile.file, profile.repeats) == (Word.ARM, Word.PROFILE, "My Steps.csv", 3)
    assert read_verbs(["profile a.csv repeat forever"], it.valve, it.guard)[0].repeats == 0


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("0,80\n1e308,81\n", "line 3: time_s = 1e+308: must be within 1000000000 s, which is 31 years"),
        ("-1e308,80\n1e308,81\n", "line 2: time_s = -1e+308: must be within 1000000000 s, which is 31 years"),
        ("0,80\n1e-320,81\n", "file: lasts less than 1 ms: are the times in time_s seconds?"),
    ],
)
def test_a_profile_that_lasts_for_ever_or_for_no_time_is_refused(rows: str, told: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        setpoint_rows("p.csv", f"time_s,setpoint_mm\n{rows}", 0.127)
    assert str(caught.value).splitlines()[0].startswith(f"p.csv: {told}")


def test_the_longest_profile_that_is_taken_can_be_played_and_shown() -> None:
    rows = setpoint_rows("p.csv", "time_s,setpoint_mm\n-1e9,80\n1e9,81\n", 0.127)
    profile = Profile("p", rows, 1_000_000)
    assert profile.duration_s == 4e15
    assert profile.row_at(4e15 - 1.0).line == 3
    assert profile.progress(7200.0) == "p: 7200.0 of 4e+15 s, round 1 of 1000000"
    short = Profile("p", setpoint_rows("p.csv", "time_s,setpoint_mm\n0,80\n0.001,81\n", 0.127), 0)
    assert short.progress(1e9) == "p: 1000000000.0 s, round 500000000001"


def test_the_row_of_an_instant_holds_until_the_next_and_the_last_as_long_as_the_one_before() -> None:
    profile = Profile("p", (SetpointRow(2, 10.0, 0.1), SetpointRow(3, 11.0, 0.2), SetpointRow(4, 11.5, 0.3)), 2)
    assert (profile.round_s, profile.duration_s) == (2.0, 4.0)
    instants = (0.0, 0.99, 1.0, 1.49, 1.5, 1.99, 2.0, 3.2)
    assert [profile.row_at(elapsed_s).line for elapsed_s in instants] == [2, 2, 3, 3, 4, 4, 2, 3]
    assert profile.progress(2.5) == "p: 2.5 of 4 s, round 2 of 2"
    assert replace(profile, repeats=0).progress(7.0) == "p: 7.0 s, round 4"


def test_setpoints_are_sent_at_their_instants_and_the_stem_follows(armed: Bench, tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    path.write_text(GOOD, encoding="utf-8")
    it = armed
    it.sent.clear()
    begin_ns = it.now_ns
    it.session.begin(verb_of(path, it, "repeat", "2"), it.now_ns)
    it.run(0.9)
    assert it.true_m == pytest.approx(0.08, abs=0.0015)
    it.until_done(5.0)
    assert (it.now_ns - begin_ns) / 1e9 == pytest.approx(4.0, abs=0.01)
    sent = [round(message.setpoint_m * 1e3, 1) for message in it.sent if isinstance(message, Setpoint)]
    # at 10 ms: 1 s, 0.5 s, 0.5 s, twice; a change is sent at once
    parts = [(sent[0], 0)]
    for each in sent:
        value, number = parts[-1]
        parts = [*parts[:-1], (value, number + 1)] if each == value else [*parts, (each, 1)]
    assert [value for value, _ in parts] == [80.0, 85.0, 73.0, 80.0, 85.0, 73.0]
    assert [number for _, number in parts] == pytest.approx([100, 50, 50, 100, 50, 50], abs=2)
    assert it.reported("profile") == [
        "profile steps.csv: 3 setpoints in 2 s, 2 times",
        "profile steps.csv: done",
    ]
    it.run(1.0)
    assert it.true_m == pytest.approx(0.073, abs=0.0015)


def test_a_profile_needs_an_armed_positioner_in_automatic_mode(tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    path.write_text(GOOD, encoding="utf-8")
    it = Bench()
    with pytest.raises(HostError, match=r"^profile: the positioner is not armed: use `arm` first$"):
        it.session.begin(verb_of(path, it), it.now_ns)
    assert not it.session.is_sending
    it.say("arm manual 14mA")
    with pytest.raises(HostError, match=r"^profile: the valve is in manual mode: use `auto` first$"):
        it.session.begin(verb_of(path, it), it.now_ns)


def test_a_profile_ends_where_the_positioner_does_not_control_any_more(armed: Bench, tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    path.write_text("time_s,setpoint_mm\n0,80\n10,85\n", encoding="utf-8")
    it = armed
    it.session.begin(verb_of(path, it), it.now_ns)
    it.run(1.0)
    it.plant_is_on = False
    with pytest.raises(HostError, match=r"^profile steps.csv: ended after 1\.\d s, in line 2: FAILSAFE: no position"):
        it.run(2.0)
    assert not it.session.is_busy


def test_a_profile_that_is_stopped_leaves_its_setpoint(armed: Bench, tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    path.write_text(GOOD, encoding="utf-8")
    it = armed
    it.session.begin(verb_of(path, it, "repeat", "forever"), it.now_ns)
    it.run(1.2)
    assert it.session.progress(it.now_ns) == "steps.csv: 1.2 s, round 1"
    it.session.stop_profile(it.now_ns)
    it.run(2.0)
    assert it.true_m == pytest.approx(0.085, abs=0.0015)
    assert it.is_in(Mode.ACTIVE)
    assert it.session.progress(it.now_ns + 100 * MS) == ""
