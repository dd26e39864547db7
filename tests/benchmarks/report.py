"""The tables of the benchmark, in Markdown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.studies.markdown import table

if TYPE_CHECKING:
    from collections.abc import Iterator

    Entry = dict[str, Any]

_QUANTILES = ("median", "p99", "p999", "largest")
_HEAD = ("median", "p99", "p99.9", "max")
PUBLISHED = {20: {"acados (HPIPM), from Python, as published": 132.0}}
"""Medians in µs of programs that pip cannot install, by horizon."""


def report(document: dict[str, Any]) -> str:
    """Return the tables of `document`, with the machine and the date above them."""
    return "\n".join(_lines(document)) + "\n"


def _lines(document: dict[str, Any]) -> Iterator[str]:
    about = document["machine"]
    versions = ", ".join(f"{name} {version.partition(' ')[0]}" for name, version in about["versions"].items())
    yield f"{about['date']}, {about['processor']}, commit {about['commit']}; {versions}. Times are in µs."
    yield ""
    yield (
        "One cycle, from frames to frames. The time of a cycle is the smallest of its bit-identical repeats; all "
        "repeats are in brackets."
    )
    yield ""
    yield from table(("cycle", "build", "cycles", *_HEAD), (_row(e, e["mode"], e["rate"]) for e in document["cycles"]))
    yield ""
    yield "One programme of the plan of a recorded move; every program solves the same problem:"
    yield ""
    yield from table(("H_p", "program", "build", "plans", *_HEAD, "× ours", "apart by, mA"), _plans(document["plans"]))
    yield ""
    yield "One cycle at 1 kHz by horizon, H_p = H_u:"
    yield ""
    head = ("H_p", "build", "cycles", *_HEAD)
    rows = (_row(e, e["horizon"]) for e in document["horizons"] if e["mode"] == "in a move")
    yield from table((f"{head[0]}, in a move", *head[1:]), rows)
    yield ""
    yield "From a position frame on its way to the bus to its command; all repeats, in two processes on two cores:"
    yield ""
    yield from table(("bus", "answered by", "build", "frames", *_HEAD), map(_bus, document["bus"]))
    yield ""
    rows = ([e["way"], e["build"], f"{e['times_real_time']:.1f}"] for e in document["simulation"])
    yield from table(("simulation of `paper-valve`", "build", "× real time"), rows)
    yield ""
    yield from table(("goal", "limit", "measured", ""), map(_goal, document["goals"]))


def _row(entry: Entry, *condition: str) -> list[str]:
    return [", ".join(condition), entry["build"], str(entry["smallest"]["count"]), *_both(entry)]


def _both(entry: Entry) -> list[str]:
    return [f"{entry['smallest'][quantile]:.0f} ({entry['raw'][quantile]:.0f})" for quantile in _QUANTILES]


def _plans(plans: list[Entry]) -> Iterator[list[str]]:
    for horizon in sorted({entry["horizon"] for entry in plans}):
        own = [entry for entry in plans if entry["horizon"] == horizon]
        ours = min(entry["smallest"]["median"] for entry in own if entry["program"] == "ours")
        for entry in own:
            unsolved = f" ({entry['unsolved']} not solved)" if entry["unsolved"] else ""
            count = f"{entry['smallest']['count']}{unsolved}"
            ratio = f"{entry['smallest']['median'] / ours:.1f}"
            build = entry["build"] or "–"
            yield [str(horizon), entry["program"], build, count, *_both(entry), ratio, f"{entry['apart_ma']:.4f}"]
        for program, median in PUBLISHED.get(horizon, {}).items():
            yield [str(horizon), program, "–", "–", f"{median:.0f}", "–", "–", "–", f"{median / ours:.1f}", "–"]


def _bus(entry: Entry) -> list[str]:
    who = f"daemon, {entry['mode']}" if entry["kind"] == "daemon" else f"echo, {entry['mode']}"
    quantiles = [f"{entry['raw'][quantile]:.0f}" for quantile in _QUANTILES]
    return [entry["bus"], who, entry["build"], str(entry["raw"]["count"]), *quantiles]


def _goal(entry: Entry) -> Iterator[str]:
    yield entry["what"]
    yield f"{'≥' if entry['least'] else '≤'} {entry['limit']:g}"
    yield f"{entry['measured']:.1f}"
    yield "holds" if entry["holds"] else "**missed**"
