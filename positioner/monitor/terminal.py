"""The live view in a terminal. Shell."""

from __future__ import annotations

import asyncio
import math
import os
import re
import sys
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen
from textual.widgets import Footer, OptionList, Static

from positioner.monitor import screen
from positioner.monitor.canvas import NO_PLAIN
from positioner.monitor.curves import LEAST_HEIGHT, LEAST_WIDTH, plots
from positioner.monitor.source import NICENESS
from positioner.monitor.trend import KEPT_S
from positioner.pictures import colours

if TYPE_CHECKING:
    from positioner.monitor.source import Source

REFRESH_S = 0.1
WINDOWS_S = (2.0, 10.0, KEPT_S)
_SEEK_S = 5.0
_HELP = """\
It listens only: nothing is ever sent to the bus.

q       quit
space   stop and go on: a log stops; on a bus only what is shown
w       trend over 2, 10 or 60 s
t       stiction table in place of the trend
c       all counts in its place, page by page
l       list of the valves; Enter shows one
left    5 s back in a log          right   5 s on
home    to its beginning           end     to its end
+ -     plays a log faster, slower
?       this help; Escape leaves it

position: mean of the last 0.1 s. lost, late, damaged,
disordered: as seen here. counts: the positioner's own;
learned, refused and fallbacks counted on from the first
status, which has them modulo 256."""


class HelpScreen(ModalScreen[None]):
    """The keys."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,question_mark,q,space,enter", "dismiss", "Back")]
    CSS = "HelpScreen { align: center middle; } #help { width: 62; height: auto; border: round $primary; }"

    def compose(self) -> ComposeResult:
        """Yield the text."""
        yield Static(_HELP, id="help", markup=False)


class MonitorApp(App[None]):
    """One valve at a time, or the list of them."""

    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = None
    TITLE = "positioner monitor"
    CSS = f"""
    Screen {{ background: white; color: {colours.INK}; }}
    #numbers {{ height: 9; }}
    #legend, #line {{ height: 1; }}
    #trend {{ height: 1fr; }}
    OptionList {{ height: 1fr; border: none; background: white; }}
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "quit", "Quit"),
        Binding("space", "pause", "Pause"),
        Binding("w", "window", "Window"),
        Binding("t", "table", "Table"),
        Binding("c", "counts", "Counts"),
        Binding("l", "list", "List"),
        Binding("question_mark", "help", "Help", key_display="?"),
        Binding("left", "seek(-1)", "-5 s", show=False),
        Binding("right", "seek(1)", "+5 s", show=False),
        Binding("home", "to(0)", show=False),
        Binding("end", "to(1)", show=False),
        Binding("plus,equals_sign", "speed(2)", show=False),
        Binding("minus", "speed(0.5)", show=False),
    ]

    def __init__(self, source: Source, valve: str | None = None, *, ascii_only: bool = False) -> None:
        """Show `valve`, or the list where there are several and none is named."""
        super().__init__()
        self.theme = "textual-light"  # the colours of the pictures are for a white ground
        self._source = source
        self._valve = valve or (source.valves[0] if len(source.valves) == 1 else None)
        self._ascii_only = ascii_only
        self._window = 1
        self._shows_table = self._frozen = False
        self._count_page = 0

    def compose(self) -> ComposeResult:
        """Yield the parts of the screen, from above."""
        yield OptionList(*(Text(valve) for valve in self._source.valves), id="list")
        yield Static(id="numbers")
        yield Static(id="legend")
        yield Static(id="trend")
        yield Static(id="line")
        yield Footer(show_command_palette=False)

    def on_mount(self) -> None:
        """Show the first picture, and go on."""
        self._arrange()
        self.set_interval(REFRESH_S, self.update_now)

    def update_now(self) -> None:
        """Show the present state."""
        source = self._source
        if source.failure is not None:
            self.exit()
        if source.failure is not None or not self.query("#line"):  # the last tick may come after the end
            return
        width = self.size.width
        line = screen.source_line(
            source.line, source.progress, in_trouble=source.in_trouble, frozen=self._frozen, width=width
        )
        self.query_one("#line", Static).update(line)
        if self._frozen:
            return
        if self._valve is None:
            options = self.query_one(OptionList)
            for number, valve in enumerate(source.valves):
                text = screen.list_line(source.snapshot(valve).view, width - 2)
                options.replace_option_prompt_at_index(number, text)
        else:
            self._show(self._valve)

    def _show(self, valve: str) -> None:
        snapshot = self._source.snapshot(valve)
        self.query_one("#numbers", Static).update(_joined(screen.valve_lines(snapshot, self.size.width)))
        window_s = WINDOWS_S[self._window]
        self.query_one("#legend", Static).update(screen.legend(window_s, self._ascii_only))
        trend = self.query_one("#trend", Static)
        width, height = trend.size
        pages = screen.count_pages(snapshot.view, width, height) if self._count_page else []
        self._count_page = self._count_page if self._count_page <= len(pages) else 0
        if self._shows_table:
            trend.update(_joined(screen.table_lines(snapshot.table, width, snapshot.view.span_m)))
        elif self._count_page:
            trend.update(_joined(pages[self._count_page - 1]))
        elif width > LEAST_WIDTH and height >= LEAST_HEIGHT:
            plain = screen.PLAIN if self._ascii_only else NO_PLAIN
            rows = plots(snapshot.bins, window_s, snapshot.now_ns, width, height, snapshot.view.late_s, plain)
            trend.update(_joined([Text.assemble(*((text, screen.PENS.get(pen, "")) for text, pen in r)) for r in rows]))

    def _arrange(self) -> None:
        """Show the list or one valve."""
        is_list = self._valve is None
        self.query_one(OptionList).display = is_list
        for part in ("#numbers", "#legend", "#trend"):
            self.query_one(part).display = not is_list
        self.set_focus(self.query_one(OptionList) if is_list else None)
        self.call_after_refresh(self.update_now)

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Show the valve that was chosen."""
        self._valve = self._source.valves[event.option_index]
        self._arrange()

    def action_pause(self) -> None:
        """Stop, or go on."""
        if self._source.progress is None:
            self._frozen = not self._frozen
        else:
            self._source.toggle()
        self.update_now()

    def action_window(self) -> None:
        """Show a longer or a shorter trend."""
        self._window = (self._window + 1) % len(WINDOWS_S)
        self.update_now()

    def action_table(self) -> None:
        """Show the stiction table in place of the trend, or the trend again."""
        self._shows_table, self._count_page = not self._shows_table, 0
        self.update_now()

    def action_counts(self) -> None:
        """Show all counts in place of the trend, their next page, or the trend again."""
        self._shows_table, self._count_page = False, self._count_page + 1
        self.update_now()

    def action_list(self) -> None:
        """Show the list of the valves."""
        if len(self._source.valves) > 1:
            self._valve = None
            self._arrange()

    def action_help(self) -> None:
        """Show the keys."""
        self.push_screen(HelpScreen())

    def action_seek(self, direction: int) -> None:
        """Go back or on in a log."""
        if (progress := self._source.progress) is not None:
            self._source.seek(progress.time_s + direction * _SEEK_S)

    def action_to(self, part: int) -> None:
        """Go to the beginning of a log, or to its end."""
        if (progress := self._source.progress) is not None:
            self._source.seek(part * progress.end_s)

    def action_speed(self, factor: float) -> None:
        """Play a log faster or slower."""
        if (progress := self._source.progress) is not None:
            self._source.play_at(progress.speed * factor)


def _joined(lines: list[Text]) -> Text:
    return Text("\n", no_wrap=True).join(lines)


def picture(source: Source, valve: str | None) -> str:
    """Return the view of the end of a log, 80 × 24 characters, as SVG that asks no network for its font."""

    async def drawn() -> str:
        app = MonitorApp(source, valve)
        async with app.run_test() as pilot:
            source.seek(math.inf)
            while (progress := source.progress) is not None and progress.time_s < progress.end_s:
                await pilot.pause(REFRESH_S)
            await pilot.pause(2.0 * REFRESH_S)
            return app.export_screenshot(title="positioner monitor")

    return re.sub(r"@font-face \{.*?\}\s*", "", asyncio.run(drawn()), flags=re.DOTALL)


def run(source: Source, valve: str | None) -> None:
    """Show `source` until somebody quits.

    Raises:
        Exception: the one that has ended the source's thread.
    """
    os.nice(NICENESS)
    encoding = (sys.stdout.encoding or "ascii").lower().replace("-", "")
    MonitorApp(source, valve, ascii_only=not encoding.startswith("utf")).run()
    if source.failure is not None:
        raise source.failure
