"""The tables of the benchmark, one function each; every row is a list of cells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report.table import Table
from positioner.report.text import markdown_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    Entry = dict[str, Any]

QUANTILES = ("median", "p99", "p999", "largest")
HEAD = ("median", "p99", "p99.9", "max")
PUBLISHED = {20: {"acados (HPIPM), from Python, as published": 132.0}}
"""Medians in µs of programs that pip cannot install, by horizon."""


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


def horizons(document: Entry) -> list[str]:
    """Return the cycles in a move by horizon."""
    rows = (
        [entry["horizon"], entry["build"], str(entry["smallest"]["count"]), *_both(entry)]
        for entry in document["horizons"]
        if entry["mode"] == "in a move"
    )
    return table(("H_p = H_u", "build", "cycles in a move", *HEAD), rows)


def plans(document: Entry) -> list[str]:
    """Return the plans of one programme, ours and those of other programs."""
    return table(("H_p = H_u", "program", "plans", *HEAD, "× ours", "apart by, µA"), _plans(document["plans"]))


def plans_in_short(document: Entry) -> list[str]:
    """Return the medians and p99 of the plans, one row for each program."""
    short: dict[str, list[str]] = {}
    shown = sorted({entry["horizon"] for entry in document["plans"]})
    for horizon in shown:
        for _, program, _, median, p99, *_, ratio, _ in _plans(
            [e for e in document["plans"] if e["horizon"] == horizon]
        ):
            before = ["–"] * 3 * shown.index(horizon)
            short.setdefault(program, before).extend([median.partition(" ")[0], p99.partition(" ")[0], ratio])
    head = [f"H_p {horizon}: {name}" for horizon in shown for name in ("median", "p99", "× ours")]
    return table(("program", *head), ([program, *cells] for program, cells in short.items()))


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
    for horizon in sorted({entry["horizon"] for entry in entries}):
        own = [entry for entry in entries if entry["horizon"] == horizon]
        ours = min(entry["smallest"]["median"] for entry in own if entry["program"] == "ours")
        for entry in own:
            unsolved = f" ({entry['unsolved']} not solved)" if entry["unsolved"] else ""
            yield [
                str(horizon),
                f"ours, {entry['build']}" if entry["build"] else entry["program"],
                f"{entry['smallest']['count']}{unsolved}",
                *_both(entry),
                f"{entry['smallest']['median'] / ours:.1f}",
                f"{entry['apart_ma'] * 1e3:.1f}",
            ]
        for program, median in PUBLISHED.get(horizon, {}).items():
            yield [str(horizon), program, "–", f"{median:.0f}", "–", "–", "–", f"{median / ours:.1f}", "–"]
