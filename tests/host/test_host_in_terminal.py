"""A session with a person: real keys into a real terminal, and what stands on its screen."""

from __future__ import annotations

import os
import re
import signal
from typing import TYPE_CHECKING

import pytest
from host_in_terminal import ROOT, InTerminal

from positioner.errors import ExitCode

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.bus
QUIT = "no more setpoints are sent: the positioner holds within 0.5 s and fails safe after 10 s"
FIGURES = re.compile(r"position (\S+) mm \(\S+ %\)   setpoint (\S+) mm \(\S+ %\)   current (\S+) mA")


def figures(screen: str) -> tuple[float, ...]:
    found = FIGURES.search(screen)
    return tuple(map(float, found.groups())) if found else (0.0, 0.0, 0.0)


def test_a_valve_is_armed_moved_by_arrows_and_by_hand_and_left(tmp_path: Path) -> None:
    with InTerminal(str(tmp_path)) as it:
        it.shows("READY: waits to be armed (NE 107: function check)", "`:arm` arms it", "q quit")
        it.press("\x1b[A")
        it.shows("no step: READY: waits to be armed (NE 107: function check); `:arm` arms it", "setpoint –")
        it.press(":arm\rset 80\r")
        it.until(lambda screen: figures(screen)[1] == 80.0 and abs(figures(screen)[0] - 80.0) < 1.5)
        it.press("\x1b[A")
        it.until(lambda screen: figures(screen)[1] == 81.27)
        it.press("\x1b[1;2A+\x1b[B")
        it.until(lambda screen: figures(screen)[1] == 80.25)
        it.press("\x1b[C\x1b[D\x1b[D")
        it.until(lambda screen: figures(screen)[1] == 67.55 and abs(figures(screen)[0] - 67.55) < 1.5)
        it.press("m")
        current_ma = figures(it.shows("MANUAL: the current is given by hand"))[2]
        it.press("\x1b[A")
        it.until(lambda screen: figures(screen)[2] == pytest.approx(current_ma + 0.16, abs=0.02))
        it.press("a")
        it.until(lambda screen: "ACTIVE: controls" in screen.splitlines()[-3])
        it.press("set 300\r")
        it.shows("> set 300", "set 300: 300 mm is outside the travel of 0 to 139.7 mm")
        it.press("q")
        assert it.ended() == ExitCode.OK
        assert it.is_restored()
        assert QUIT in it.text.replace("\n", "")
        assert "q quit" not in it.text  # the status has gone


def test_the_page_shows_the_screen_as_it_is(tmp_path: Path) -> None:
    """The block in docs/host.md, but for the bus, the valve and the figures."""
    page = (ROOT / "docs" / "host.md").read_text(encoding="utf-8")
    (block,) = [each for each in re.findall(r"```text\n(.*?)\n```", page, re.DOTALL) if "q quit" in each]
    with InTerminal(str(tmp_path)) as it:
        it.shows("q quit")
        it.press(":arm\rset 62%\r")
        it.until(lambda screen: abs(figures(screen)[0] - 78.74) < 1.5)
        it.press("\x1b[A\x1b[A")
        screen = it.until(lambda screen: figures(screen)[1] == 81.28 and figures(screen)[0] > 80.0)

    def masked(text: str) -> list[str]:
        return [re.sub(r"\d", "0", line) for line in text.splitlines()[1:]]

    assert masked(screen) == masked(block)


def test_a_profile_shows_how_far_it_is_and_a_key_stops_it(tmp_path: Path) -> None:
    (tmp_path / "steps.csv").write_text("time_s,setpoint_mm\n0,80\n0.5,85\n", encoding="utf-8")
    with InTerminal(str(tmp_path), cwd=tmp_path) as it:
        it.press(":arm\r")
        it.shows("ACTIVE: controls")
        it.press("prof\tst\trepeat 1000\r")
        it.shows("profile steps.csv: 2 setpoints in 1 s, 1000 times", "of 1000 s, round 2 of 1000")
        it.press("status\r")
        it.shows("counters", "profile steps.csv: ")
        it.press("\x1b[A")
        it.shows("stopped, the setpoint stays")
        it.until(lambda screen: "of 1000 s, round" not in screen.splitlines()[-2])
        it.press("\x04")
        assert it.ended() == ExitCode.OK
        assert it.is_restored()


def test_a_profile_of_a_command_line_shows_its_progress_and_ends_the_host(tmp_path: Path) -> None:
    (tmp_path / "steps.csv").write_text("time_s,setpoint_mm\n0,80\n2,85\n", encoding="utf-8")
    with InTerminal(str(tmp_path), "arm", "profile", "steps.csv", "disarm", cwd=tmp_path) as it:
        it.shows("steps.csv: 1 of 4 s |")
        it.shows("steps.csv: 3 of 4 s |")
        assert it.ended() == ExitCode.OK
        lines = it.text.splitlines()
        assert lines[-1] == "disarmed: the positioner commands nothing"
        assert "profile steps.csv: done" in lines
        assert not any("|" in line for line in lines)  # the bar has gone
    with InTerminal(str(tmp_path), "arm", "profile", "steps.csv", cwd=tmp_path) as it:
        assert it.ended() == ExitCode.OK
        assert QUIT in it.text.replace("\n", "")


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, ExitCode.OK), (None, ExitCode.OK), (signal.SIGQUIT, ExitCode.OK)]
)
def test_however_it_is_ended_the_terminal_is_as_before(
    number: signal.Signals | None, status: int, tmp_path: Path
) -> None:
    with InTerminal(str(tmp_path)) as it:
        it.press(":arm\r")
        it.shows("ACTIVE: controls")
        assert not it.is_restored()
        it.press("\x1a\x13")  # Ctrl-Z and Ctrl-S do nothing: without setpoints the valve would be left alone
        if number is None:
            it.press("\x03")
        else:
            os.kill(it.process.pid, number)
        assert it.ended() == status
        assert it.is_restored()
        assert it.received.endswith(b"makes it command nothing\r\n")


def test_a_crash_gives_the_terminal_back_and_one_line(tmp_path: Path) -> None:
    with InTerminal(str(tmp_path), environment={"CRASH_AT": "4"}) as it:
        it.shows("q quit")
        assert not it.is_restored()
        assert it.ended() == ExitCode.SOFTWARE
        assert it.is_restored()
        assert "internal error: ZeroDivisionError: a crash" in it.text.replace("\n", "")


def test_a_small_terminal_and_one_that_changes_its_size_show_the_figures(tmp_path: Path) -> None:
    with InTerminal(str(tmp_path), size=(34, 7)) as it:
        it.press(":arm\rset 80\r")
        it.shows("position 80.", "setpoint 80.00 mm (62.99 %)", "current ")
        it.resize((100, 20))
        screen = it.until(lambda text: figures(text)[1] == 80.0)
        assert screen.count("position ") == 1
        it.resize((50, 12))
        screen = it.until(lambda text: text.count("position 80.") == 1 and "\nsetpoint 80.00 mm (62.99 %)\n" in text)
        it.press("q")
        assert it.ended() == ExitCode.OK


def test_a_terminal_that_cannot_move_its_cursor_is_asked_line_by_line(tmp_path: Path) -> None:
    with InTerminal(str(tmp_path), environment={"TERM": "dumb"}) as it:
        it.shows("quit           end", "\n>")
        assert it.is_restored()
        it.press("arm\nset 80\n")
        it.shows("ACTIVE: controls", "setpoint 80.00 mm")
        it.press("quit\n")
        assert it.ended() == ExitCode.OK
        assert b"\x1b" not in it.received
