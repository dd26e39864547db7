"""The lines of the terminal view: one valve in nine lines of 80 characters, or in one line of a list. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.text import Text

from positioner.errors import in_one_line
from positioner.host.words import counters_in_words
from positioner.monitor.curves import CURRENT, FRAME, POSITION, SETPOINT
from positioner.monitor.view import MESSAGES
from positioner.pictures import colours

if TYPE_CHECKING:
    from positioner.monitor.kept_table import TableView
    from positioner.monitor.source import Progress, Snapshot
    from positioner.monitor.view import View

_GREY = colours.STATUS["unknown"]
PENS = {POSITION: colours.POSITION, SETPOINT: colours.SETPOINT, CURRENT: colours.COMMAND, FRAME: _GREY}
PLAIN = {POSITION: "*", SETPOINT: "-", CURRENT: "+"}
_DARK_INK = frozenset({"out-of-specification", "function-check"})
_WARNING = f"{colours.INK} on {colours.STATUS['out-of-specification']}"
_LEFT = 46
_MM = 1e3
_NONE = "-"
_MOST_DIGIT = 9
_WIDE, _BETWEEN = 60, 3


def valve_lines(snapshot: Snapshot, width: int) -> list[Text]:
    """Return the numbers of a valve, each line at most `width` characters."""
    view = snapshot.view
    rates = [f"{MESSAGES[kind]:<10}{per_s:>9.1f} /s" for kind, per_s in view.rates]
    seen = view.seen
    left = (
        ("position", _length(view.position_m, view.span_m, _doubt(view))),
        ("setpoint", _length(view.setpoint_m, view.span_m)),
        ("error", _length(view.error_m, view.span_m)),
        ("current", _current(view)),
    )
    lines = [_title(view, width)]
    lines += [_row(name, value, rate) for (name, value), rate in zip(left, rates, strict=True)]
    lines.append(_row("positioner", _positioner(view), f"lost {seen.lost}, late {seen.late}"))
    damage = f"damaged {seen.damaged}, disordered {seen.disordered}"
    lines.append(_row("pressure", _pressure(view.pressure_pa), damage))
    lines.append(_row("alarms", view.alarms, ""))
    lines.append(_row("counts", counters_in_words(view.counters) if view.counters else _NONE, ""))
    for line in lines:
        line.truncate(width, overflow="ellipsis")
    return lines


def count_pages(view: View, width: int, height: int) -> list[list[Text]]:
    """Return all counters of the positioner, in columns, on as many pages of `width` × `height` as they take."""
    if not view.counters:
        return [[Text("counts: the positioner is silent")]]
    names, digits = (max(len(str(each[part])) for each in view.counters) for part in (0, 1))
    cells = [f"{name:<{names}}  {count:>{digits}}" for name, count in view.counters]
    columns, rows = max((width + _BETWEEN) // (names + 2 + digits + _BETWEEN), 1), max(height - 1, 1)
    pages = [cells[at : at + columns * rows] for at in range(0, len(cells), columns * rows)]
    found = []
    for number, page in enumerate(pages, start=1):
        lines = [Text(f"counts, page {number} of {len(pages)}; c goes on", _GREY)]
        lines += [Text((_BETWEEN * " ").join(page[row::rows])) for row in range(min(rows, len(page)))]
        for line in lines:
            line.truncate(width, overflow="ellipsis")
        found.append(lines)
    return found


def list_line(view: View, width: int) -> Text:
    """Return a valve in one line."""
    line = Text.assemble((f"{view.valve_id:<12.12} ", "bold"), _badge(view), " ")
    position, setpoint = (_NONE if m is None else f"{m * _MM:.2f}" for m in (view.position_m, view.setpoint_m))
    current = _NONE if view.current_ma is None else f"{view.current_ma:.3f}"
    line.append(f"{position:>7} mm  set {setpoint:>7} mm {current:>7} mA  {view.mode or 'silent'}")
    line.truncate(width, overflow="ellipsis")
    return line


def source_line(line: str, progress: Progress | None, *, in_trouble: bool, frozen: bool, width: int) -> Text:
    """Return what is with the bus or the log."""
    text = Text()
    if frozen:
        text.append(" PAUSED ", _WARNING)
        text.append(" ")
    if progress is not None:
        state = f"{progress.speed:g}x" if progress.playing else "stopped"
        text.append(f"{progress.time_s:.2f} of {progress.end_s:.2f} s, {state}  ", "bold")
    text.append(in_one_line(line), colours.FALLBACK if in_trouble else _GREY)
    text.truncate(width, overflow="ellipsis")
    return text


def legend(window_s: float, ascii_only: bool) -> Text:
    """Return which line of the trend is which."""
    pens = (POSITION, SETPOINT, CURRENT)
    parts = [part for pen in pens for part in ((PLAIN[pen] if ascii_only else "━", PENS[pen]), f" {pen}  ")]
    return Text.assemble(*parts, (f"last {window_s:g} s", PENS[FRAME]))


def table_lines(table: TableView | None, width: int, span_m: float) -> list[Text]:
    """Return the stiction table: for each quantity and direction the samples of each cell along the travel."""
    if table is None:
        return [Text("stiction table: its state directory cannot be read from here; see `positioner table dump`")]
    head = f"stiction table: {table.samples} samples in {table.cells} cells of {table.cell_width_m * _MM:g} mm"
    lines = [Text(head)]
    indexes = [index for row in table.rows for index in row.counts]
    if not indexes:
        return lines
    low, high = min(0, *indexes), max(round(span_m / table.cell_width_m), *indexes)
    for row in table.rows:
        cells = "".join(_digit(row.counts.get(index, 0)) for index in range(low, high + 1))
        lines.append(Text.assemble((f"{row.name:<22}", _GREY), cells))
    scale = f"{low * table.cell_width_m * _MM:g} to {high * table.cell_width_m * _MM:g} mm"
    lines.append(Text(f"{'':<22}{scale}; a digit counts samples, + is ten and more", _GREY))
    for line in lines:
        line.truncate(width, overflow="ellipsis")
    return lines


def _digit(count: int) -> str:
    if not count:
        return "."
    return str(count) if count <= _MOST_DIGIT else "+"


def _title(view: View, width: int) -> Text:
    badge = _badge(view, "NE 107: " if width >= _WIDE else "")
    title = Text.assemble((view.valve_id, "bold"), "  ", view.state.partition(" (NE 107")[0])
    room = width - len(badge)
    title.truncate(room - 1, overflow="ellipsis", pad=True)
    title.pad_right(room - len(title))
    return title.append_text(badge)


def _badge(view: View, name: str = "NE 107: ") -> Text:
    health = "unknown" if view.health is None else view.health.lower().replace("_", "-")
    ink = colours.INK if health in _DARK_INK else "white"
    return Text(f" {name}{health.replace('-', ' ')} ", f"{ink} on {colours.STATUS[health]}")


def _row(name: str, value: str, right: str) -> Text:
    """Return a line of a name, its value and what stands in the right column."""
    line = Text.assemble((f"{name:<11}", _GREY), value)
    if right:
        line.truncate(_LEFT - 1, overflow="ellipsis")
        line.pad_right(_LEFT - len(line))
        line.append(right)
    return line


def _length(value_m: float | None, span_m: float, doubt: str = "") -> str:
    return _NONE if value_m is None else f"{value_m * _MM:7.3f} mm {100.0 * value_m / span_m:7.2f} %{doubt}"


def _doubt(view: View) -> str:
    return "" if view.quality in {None, "VALID"} else f" {str(view.quality).lower().replace('_', ' ')}"


def _current(view: View) -> str:
    if view.current_ma is None:
        return _NONE
    motion = f"  {view.motion.lower()}" if view.motion not in {None, "NONE"} else ""
    return f"{view.current_ma:7.3f} mA{motion}"


def _pressure(pressure_pa: float | None) -> str:
    return _NONE if pressure_pa is None else f"{pressure_pa * 1e-3:7.2f} kPa"


def _positioner(view: View) -> str:
    if view.armed is None:
        return _NONE
    saved = "table saved" if view.table_saved else "table NOT saved"
    return f"{'armed' if view.armed else 'not armed'}, {saved}"
