"""The picture of the benchmark: every cycle by mode beside its goals, and the plans of other programs beside ours."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING, Any

from matplotlib.ticker import LogLocator

from benchmarks.goals import LAGGED_P99_US, is_lagged
from positioner.pictures.colours import FAINT, INK, MEASURED, SERIES
from positioner.pictures.files import save
from positioner.pictures.panels import LABEL, NORMAL, SMALL, dress, new_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    Entry = dict[str, Any]

_COLOURS = dict(zip(("at rest", "in a move", "settling"), SERIES, strict=False))
_PERIODS_US = {"10 kHz": 100.0, "1 kHz": 1000.0}
_GOALS_US = {"at rest": (50.0, 100.0), "in a move": (150.0, 250.0)}
"""Median and p99 at rest, p99 and maximum in a move, on a valve without lag."""
_MOST_DOTS = 600


def draw(path: Path, document: Entry) -> None:
    """Write the picture of `document` to `path`."""
    plans = _ratios(document["plans"])
    rows = len(document["cycles"])
    figure = new_figure(1.6 + 0.42 * max(rows, len(plans) + 1))
    figure.set_layout_engine("constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_cycles(left, document["cycles"])
    _draw_plans(right, plans)
    about = document["machine"]
    figure.supxlabel(f"{about['processor']}, {about['date']}, commit {about['commit']}", fontsize=SMALL, color=INK)
    save(figure, path)


def _draw_cycles(axes: Axes, cycles: Sequence[Entry]) -> None:
    """Draw one row for each mode, rate and build, one dot for each cycle."""
    random = Random(1)  # noqa: S311 - where dots lie
    names = []
    for row, entry in enumerate(cycles):
        colour, figures = _COLOURS[entry["mode"]], entry["smallest"]
        names.append(f"{entry['mode']}, {entry['rate']}, {entry['build']}")
        dots = [duration / 1e3 for duration in entry["smallest_ns"]]
        some = random.sample(dots, min(len(dots), _MOST_DOTS))
        heights = [row + random.uniform(-0.28, 0.28) for _ in some]
        axes.scatter(some, heights, s=4, color=colour, alpha=0.25, linewidths=0)
        axes.plot([figures["median"]] * 2, [row - 0.38, row + 0.38], color=colour, linewidth=2.5)
        axes.plot([figures["p99"]] * 2, [row - 0.38, row + 0.38], color=colour, linewidth=1.2)
        axes.plot(figures["largest"], row, "x", color=colour, markersize=6)
        for goal in (LAGGED_P99_US,) if is_lagged(entry) else _GOALS_US.get(entry["mode"], ()):
            axes.plot(goal, row, "|", color=INK, markersize=16, markeredgewidth=1.4)
    for name, period_us in _PERIODS_US.items():
        axes.axvline(period_us, color=MEASURED, linestyle="--", linewidth=1)
        axes.text(period_us, -0.75, f"period at {name}", ha="center", va="bottom", fontsize=SMALL, color=INK)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.8)
    _logarithmic(axes, "time of a cycle from frames to frames, µs")
    axes.set_title(
        "Every cycle (dot): median (thick), p99 (thin), maximum (×); goals in black\n", fontsize=NORMAL, loc="left"
    )


def _draw_plans(axes: Axes, ratios: dict[str, float]) -> None:
    """Draw one row for each program."""
    for row, ratio in enumerate(ratios.values()):
        axes.plot([1.0, ratio], [row, row], color=FAINT, linewidth=1, zorder=0)
        axes.plot(ratio, row, "o", color=INK, markersize=8)
        axes.annotate(f"{ratio:.1f}", (ratio, row), (9, 8), textcoords="offset points", ha="center", fontsize=SMALL)
    axes.axvline(1.0, color=INK, linewidth=1)
    axes.set_yticks(range(len(ratios)), ratios)
    axes.set_ylim(len(ratios) - 0.4, -0.8)
    _logarithmic(axes, "median time, times ours")
    axes.set_title("The same programme by other programs\n", fontsize=NORMAL, loc="left")


def _ratios(plans: Sequence[Entry]) -> dict[str, float]:
    """Return the median of each other program over ours, the smallest first."""
    medians = [(entry["program"].replace(", ", "\n", 1), entry["smallest"]["median"]) for entry in plans]
    ours = min(median for program, median in medians if program == "ours")
    others = [(program, median / ours) for program, median in medians if program != "ours"]
    return dict(sorted(others, key=lambda other: other[1]))


def _logarithmic(axes: Axes, name: str) -> None:
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_minor_formatter(lambda _value, _: "")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel(name, fontsize=LABEL)
    dress(axes, grid="x")
