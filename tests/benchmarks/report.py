"""The tables of the benchmark, in Markdown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.studies.markdown import table

if TYPE_CHECKING:
    from collections.abc import Iterator

_QUANTILES = ("median", "p99", "p999", "largest")
_HEAD = ("median", "p99", "p99.9", "max")


def report(document: dict[str, Any]) -> str:
    """Return the tables of `document`, with the machine and the date above them."""
    return "\n".join(_lines(document)) + "\n"


def _lines(document: dict[str, Any]) -> Iterator[str]:
    about = document["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    yield f"{about['date']}, {about['processor']}, commit {about['commit']}; {versions}. Times in µs."
    yield ""
    yield (
        "One cycle, from frames to frames. The time of a cycle is the smallest of its bit-identical repeats; "
        "all repeats are in brackets."
    )
    yield ""
    yield from table(("cycle", "build", "cycles", *_HEAD), map(_cycle, document["cycles"]))
    yield ""
    yield "One programme of the plan of a recorded move, the same problem in every program:"
    yield ""
    head = ("H_p", "program", "build", "plans", *_HEAD, "× ours", "first inputs differ by, mA")
    ours = {entry["horizon"]: entry for entry in document["plans"] if entry["program"] == "ours"}
    yield from table(head, (_plan(entry, ours[entry["horizon"]]) for entry in document["plans"]))
    yield ""
    yield from table(("goal", "limit", "measured", ""), map(_goal, document["goals"]))


def _cycle(entry: dict[str, Any]) -> Iterator[str]:
    yield f"{entry['mode']}, {entry['rate']}"
    yield entry["build"]
    yield str(entry["smallest"]["count"])
    for quantile in _QUANTILES:
        yield f"{entry['smallest'][quantile]:.0f} ({entry['raw'][quantile]:.0f})"


def _plan(entry: dict[str, Any], ours: dict[str, Any]) -> Iterator[str]:
    yield str(entry["horizon"])
    yield entry["program"]
    yield entry["build"] if entry["program"] == "ours" else "–"
    unsolved = f" ({entry['unsolved']} not solved)" if entry["unsolved"] else ""
    yield f"{entry['smallest']['count']}{unsolved}"
    for quantile in _QUANTILES:
        yield f"{entry['smallest'][quantile]:.0f} ({entry['raw'][quantile]:.0f})"
    yield f"{entry['smallest']['median'] / ours['smallest']['median']:.1f}"
    yield f"{entry['apart_ma']:.4f}"


def _goal(entry: dict[str, Any]) -> Iterator[str]:
    yield entry["what"]
    yield f"{'≥' if entry['least'] else '≤'} {entry['limit']:g}"
    yield f"{entry['measured']:.1f}"
    yield "holds" if entry["holds"] else "**missed**"
