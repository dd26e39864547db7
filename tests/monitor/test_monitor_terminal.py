"""The view in a terminal: what is shown, what the keys do, and that nothing is ever sent."""

from __future__ import annotations

import asyncio
import re
import sys
from typing import TYPE_CHECKING, Any

import pytest
from monitor_helpers import TWO, RecordingBus, configured, frames_of, live_source, shown
from replay_helpers import scenario, write_bench_log

from positioner.cli.main import main
from positioner.config.reader import load_valves
from positioner.monitor.recorded import RecordedSource
from positioner.monitor.terminal import MonitorApp
from positioner.wire.messages import Counted, PositionerCount

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable
    from pathlib import Path

    from positioner.monitor.source import Source

    Steps = Callable[[MonitorApp, Any], Awaitable[None]]

pytestmark = pytest.mark.bus

KEYS = (
    "space",
    "space",
    "w",
    "t",
    "t",
    "c",
    "c",
    "question_mark",
    "escape",
    "left",
    "right",
    "home",
    "end",
    "plus",
    "minus",
    "l",
)


async def until(app: MonitorApp, pilot: Any, *words: str) -> str:
    """Return what is shown once all words are in it."""
    for _ in range(3000):
        await pilot.pause(0.02)
        text = shown(app)
        if all(word in text for word in words):
            return text
    raise AssertionError(f"{words} not in\n{shown(app)}")


def watch(source: Source, steps: Steps, size: tuple[int, int] = (80, 24), **options: Any) -> None:
    """Show a source, and do the steps."""

    async def run() -> None:
        app = MonitorApp(source, **options)
        async with app.run_test(size=size) as pilot:
            await steps(app, pilot)

    source.start()
    try:
        asyncio.run(run())
    finally:
        source.close()


def test_80_by_24_characters_show_all_of_a_valve_in_a_log(tmp_path: Path) -> None:
    log, config = write_bench_log(tmp_path, scenario(seconds=0.6))
    source = RecordedSource(load_valves(config), log)
    source.play_at(100.0)

    async def steps(app: MonitorApp, pilot: Any) -> None:
        text = await until(app, pilot, "0.60 of 0.60 s, stopped", "1000.0 /s", "? Help")
        lines = text.split("\n")
        assert len(lines) == 24
        assert {len(line) for line in lines} == {80}
        assert lines[0].startswith("bench  ACTIVE: controls the valve")
        assert lines[0].rstrip().endswith("NE 107: good")
        names = [line.split()[0] for line in lines[1:9]]
        assert names == [*("position", "setpoint", "error", "current"), *("positioner", "pressure", "alarms", "counts")]
        assert "80.000 mm" in lines[2]
        assert "armed, table saved" in lines[5]
        assert "lost 0, late 0" in lines[5]
        assert "learned" in lines[8]
        assert sum(any("⠀" < character <= "⣿" for character in line) for line in lines[10:22]) >= 8
        assert "q Quit" in lines[23]
        assert "? Help" in lines[23]

    watch(source, steps)


def test_a_log_stops_goes_on_and_is_searched(tmp_path: Path) -> None:
    log, config = write_bench_log(tmp_path, scenario(seconds=0.6))
    source = RecordedSource(load_valves(config), log)
    source.toggle()

    async def steps(app: MonitorApp, pilot: Any) -> None:
        await until(app, pilot, "0.00 of 0.60 s, stopped")
        await pilot.press("end")
        await until(app, pilot, "0.60 of 0.60 s, stopped", "80.000 mm")
        await pilot.press("left")
        await until(app, pilot, "0.00 of 0.60 s")
        await pilot.press("plus", "plus", "minus", "space")
        await until(app, pilot, "0.60 of 0.60 s, stopped")
        assert source.progress.speed == 2.0

    watch(source, steps)


@pytest.mark.parametrize("size", [(80, 24), (40, 12), (20, 6), (132, 40)])
def test_no_key_in_any_window_sends_anything_to_the_bus(tmp_path: Path, size: tuple[int, int]) -> None:
    bus = RecordingBus()
    configurations = configured(tmp_path)
    bus.bring(frames_of(configurations[0].make_codec(), 3.0))

    async def steps(app: MonitorApp, pilot: Any) -> None:
        await until(app, pilot, "FV-101", "good")
        for key in KEYS:
            await pilot.press(key)
            await pilot.pause()
        await pilot.press("q")

    watch(live_source(configurations, bus), steps, size)
    assert bus.brought.empty()
    assert bus.sent == []


def test_a_bus_that_goes_is_told_and_its_return_shown(tmp_path: Path) -> None:
    bus = RecordingBus()
    configurations = configured(tmp_path)
    frames = list(frames_of(configurations[0].make_codec(), 2.0))

    async def steps(app: MonitorApp, pilot: Any) -> None:
        await until(app, pilot, "listening on virtual:can0", "nothing comes")
        bus.bring(frames[:300])
        await until(app, pilot, "12.000 mA", "FV-101  ACTIVE")
        bus.is_cut.set()
        await until(app, pilot, "is down: Network is down", "12.000 mA")
        bus.pass_time(0.6)
        await until(app, pilot, "nothing comes")
        bus.is_cut.clear()
        bus.pass_time(0.6)
        await until(app, pilot, "listening on virtual:can0")
        bus.bring(frames[300:])
        await until(app, pilot, "12.000 mA")

    watch(live_source(configurations, bus), steps)
    assert bus.sent == []


def test_a_live_view_stops_when_asked_and_the_valve_is_listened_to(tmp_path: Path) -> None:
    bus = RecordingBus()
    configurations = configured(tmp_path)
    frames = list(frames_of(configurations[0].make_codec(), 2.0))
    source = live_source(configurations, bus)

    async def steps(app: MonitorApp, pilot: Any) -> None:
        await until(app, pilot, "nothing comes")
        await pilot.press("space")
        bus.bring(frames)
        await until(app, pilot, "PAUSED")
        while not bus.brought.empty():
            await pilot.pause(0.02)
        assert "nothing comes" in await until(app, pilot, "PAUSED")
        assert source.snapshot("FV-101").bins
        await pilot.press("space")
        await until(app, pilot, "listening")
        assert "PAUSED" not in shown(app)

    watch(source, steps)


def test_of_several_valves_one_is_chosen_from_a_list(tmp_path: Path) -> None:
    bus = RecordingBus()
    configurations = configured(tmp_path, TWO)
    second = list(frames_of(configurations[1].make_codec(), 1.0))
    bus.bring(second)

    async def steps(app: MonitorApp, pilot: Any) -> None:
        text = await until(app, pilot, "FV-101", "12.000 mA")
        first_line, second_line = (
            next(line for line in text.split("\n") if name in line) for name in app._source.valves
        )
        assert "NE 107: unknown" in first_line
        assert "silent" in first_line
        assert "ACTIVE" in second_line
        await pilot.press("down", "enter")
        bus.bring(second)
        await until(app, pilot, "FV-102  ", "error")
        await pilot.press("l")
        await until(app, pilot, "FV-101", "FV-102")

    watch(live_source(configurations, bus), steps)


@pytest.mark.parametrize("size", [(80, 24), (44, 16), (160, 50)])
def test_all_counts_can_be_read_page_by_page(tmp_path: Path, size: tuple[int, int]) -> None:
    bus = RecordingBus()
    configurations = configured(tmp_path)
    codec = configurations[0].make_codec()
    bus.bring(frames_of(codec, 1.0))
    bus.bring(codec.encode(PositionerCount(each, 4_000_000 + each), each % 16) for each in Counted)
    wanted = {each.text: f"{4_000_000 + each}" for each in Counted} | {"learned": "42", "fallbacks": "3"}

    async def steps(app: MonitorApp, pilot: Any) -> None:
        await until(app, pilot, "ACTIVE", "position")
        read = ""
        for number in range(1, 20):
            await pilot.press("c")
            await pilot.pause()
            if "counts, page" not in shown(app):
                break
            read += await until(app, pilot, f"counts, page {number} of")
        for name, count in wanted.items():
            assert re.search(rf"{name} +{count}\b", read), name
        assert (number > 2) == (size != (160, 50))
        await until(app, pilot, "mA", "0 s")

    watch(live_source(configurations, bus), steps, size)


def test_the_trend_fills_a_large_terminal(tmp_path: Path) -> None:
    bus = RecordingBus()
    configurations = configured(tmp_path)
    bus.bring(frames_of(configurations[0].make_codec(), 1.0))

    async def steps(app: MonitorApp, pilot: Any) -> None:
        lines = (await until(app, pilot, "ACTIVE", " mA", "0 s")).split("\n")
        assert len(lines) == 50
        assert lines[47].rstrip().endswith("0 s")
        assert len(lines[47].rstrip()) == 160
        assert sum(line.startswith(" mA", 5) or " mm" in line[:9] for line in lines[10:47]) == 2

    watch(live_source(configurations, bus), steps, (160, 50))


def test_the_help_names_every_key_and_goes(tmp_path: Path) -> None:
    async def steps(app: MonitorApp, pilot: Any) -> None:
        await pilot.press("question_mark")
        text = await until(app, pilot, "It listens only")
        for key in ("q ", "space ", "w ", "t ", "c ", "l ", "left ", "right ", "home ", "end ", "+ - ", "?"):
            assert f"│{key}" in text or f" {key}" in text
        await pilot.press("escape")
        await until(app, pilot, "nothing comes")
        assert "It listens only" not in shown(app)

    watch(live_source(configured(tmp_path), RecordingBus()), steps)


def test_a_terminal_without_unicode_gets_plain_characters(tmp_path: Path) -> None:
    bus = RecordingBus()
    configurations = configured(tmp_path)
    bus.bring(frames_of(configurations[0].make_codec(), 3.0))

    async def steps(app: MonitorApp, pilot: Any) -> None:
        text = await until(app, pilot, "FV-101  ACTIVE", "* position", "61.0 mm", "-10 s")
        assert text.isascii()

    watch(live_source(configurations, bus), steps, ascii_only=True)


def test_the_end_of_a_log_is_drawn_as_a_picture_that_asks_no_network(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, config = write_bench_log(tmp_path, scenario(seconds=0.3))
    words = ["monitor", str(log), "--config", str(config), "--picture"]
    assert main([*words, str(tmp_path / "end.svg")]) == 0
    text = (tmp_path / "end.svg").read_text("utf-8")
    assert "0.30&#160;of&#160;0.30&#160;s,&#160;stopped" in text
    assert "80.000&#160;mm" in text
    assert "url(http" not in text
    assert "@font-face" not in text
    assert main([*words, str(tmp_path / "none" / "end.svg")]) == 74
    assert main(["monitor", "--config", str(config), "--picture", "end.svg"]) == 2
    assert capsys.readouterr().err.count("\n") == 2


class Terminal:
    """A standard stream of a terminal."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        return len(text)

    def flush(self) -> None:
        pass


def test_mistakes_are_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    configured(tmp_path, TWO)
    config = ["--config", str(tmp_path / "valve.toml")]
    empty = tmp_path / "empty.log"
    empty.write_text("(0.0) vcan0 7FF#00 R\n", encoding="utf-8")

    def told(*words: str) -> tuple[int, str]:
        code = main(["monitor", *words])
        line = capsys.readouterr().err
        assert line.count("\n") == 1
        return code, line

    assert told(*config, "--valve", "FV-1O1")[0] == 2
    code, line = told(*config)
    assert (code, "there is none here" in line) == (2, True)
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr(sys, "stdout", Terminal())
    code, line = told(*config, str(empty))
    assert (code, "no frame of FV-101, FV-102" in line) == (74, True)
    assert told(*config, str(empty), "--speed", "0")[0] == 2
    assert told(*config, str(tmp_path / "none.log"))[0] == 74
    monkeypatch.setitem(sys.modules, "positioner.monitor.terminal", None)
    code, line = told(*config)
    assert (code, "pip install 'sticking-valve-positioner[monitor]'" in line) == (2, True)
