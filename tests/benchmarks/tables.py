"""The tables of the benchmark, one function each; every row is a list of cells."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from positioner.report.table import Table
from positioner.report.text import markdown_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    Entry = dict[str, Any]

QUANTILES = ("median", "p99", "p999", "largest")
HEAD = ("median", "p99", "p99.9", "max")


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    return markdown_table(Table.of(head, rows))


def cycles(document: Entry) -> list[str]:
    """Return the cycles by mode and period."""
    rows = (
        [f"{entry['mode']}, {entry['rate']}", entry["build"], str(entry["smallest"]["count"]), *_both(entry)]
        for entry in document["cycles"]
    )
    return table(("cycle", "build", "cycles", *HEAD), rows)


def plans(document: Entry) -> list[str]:
    """Return the solutions of one programme, ours and those of other programs."""
    return table(("program", "programmes", *HEAD, "× ours", "apart by, µA"), _plans(document["plans"]))


def bus(document: Entry) -> list[str]:
    """Return the ways over a bus; all repeats, since a bus has no smallest duration that would mean much."""
    rows = (
        [
            f"{entry['bus']}, {entry['kind']}",
            entry["build"],
            entry["mode"],
            str(entry["raw"]["count"]),
            *(f"{entry['raw'][quantile]:.0f}" for quantile in QUANTILES),
        ]
        for entry in document["bus"]
    )
    return table(("bus, answered by", "build", "mode", "frames", *HEAD), rows)


def valves(document: Entry) -> list[str]:
    """Return the processor time of the daemon by the number of its valves."""
    rows = (
        [
            str(entry["valves"]),
            entry["build"],
            f"{entry['mean_us']:.0f}",
            f"{entry['valves_per_core']:.0f}",
            *(f"{entry['period'][quantile]:.0f}" for quantile in QUANTILES),
        ]
        for entry in document["valves"]
    )
    head = ("valves", "build", "µs per valve and period, mean", "valves per core at 1 kHz")
    return table((*head, *(f"all valves: {name}" for name in HEAD)), rows)


def simulation(document: Entry) -> list[str]:
    """Return the speed of simulations."""
    rows = ([entry["way"], entry["build"], f"{entry['times_real_time']:.1f}"] for entry in document["simulation"])
    return table(("simulation of `paper-valve`", "build", "× real time"), rows)


def instructions(reference: Mapping[str, Entry]) -> list[str]:
    """Return the accepted counts of instructions."""
    rows = (
        [build, mode, f"{counted:,}"] for build, entry in reference.items() for mode, counted in entry["held"].items()
    )
    return table(("build", "mode", "instructions of a cycle"), rows)


def goals(document: Entry) -> list[str]:
    """Return the goals, and whether they hold."""
    rows = (
        [
            entry["what"],
            f"{'≥' if entry['least'] else '≤'} {entry['limit']:g}",
            f"{entry['measured']:.1f}",
            "holds" if entry["holds"] else "**missed**",
        ]
        for entry in document["goals"]
    )
    return table(("goal", "limit", "measured", ""), rows)


def _both(entry: Entry) -> list[str]:
    return [f"{entry['smallest'][quantile]:.0f} ({entry['raw'][quantile]:.0f})" for quantile in QUANTILES]


def _plans(entries: list[Entry]) -> Iterator[list[str]]:
    ours = min((entry["smallest"]["median"] for entry in entries if entry["program"] == "ours"), default=math.nan)
    for entry in entries:
        unsolved = f" ({entry['unsolved']} not solved)" if entry["unsolved"] else ""
        yield [
            f"ours, {entry['build']}" if entry["build"] else entry["program"],
            f"{entry['smallest']['count']}{unsolved}",
            *_both(entry),
            f"{entry['smallest']['median'] / ours:.1f}",
            f"{entry['apart_ma'] * 1e3:.1f}",
        ]
