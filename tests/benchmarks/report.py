"""The report of the benchmark in Markdown, and the part of it that docs/speed.md shows."""

from __future__ import annotations

import json
import re
import shutil
from typing import TYPE_CHECKING, Any

from benchmarks import tables
from benchmarks.builds import ROOT
from benchmarks.instructions import REFERENCE

if TYPE_CHECKING:
    from pathlib import Path

    Entry = dict[str, Any]

_CYCLES = (
    "One cycle, from frames to frames, in µs. The time of a cycle is the smallest of {rounds} repeats that are equal "
    "to the bit; the distribution of all repeats is in brackets."
)
_PLANS = "One programme that places the stop of a recorded move, in µs. Every program solves the same problem:"
_BUS = (
    "From a position frame on its way to the bus until its command is back, in µs: the daemon, and an echo for "
    "comparison, in a process of its own. All repeats."
)
_VALVES = (
    "One daemon with several valves at 1 kHz: processor time of its loop in each period, the smallest of all repeats, "
    "in µs:"
)
_SIMULATION = "A simulation without bus and processes, on one core:"
_INSTRUCTIONS = "Instructions of a cycle at 1 kHz, on average (`make instructions` holds them within 5 %):"
_MARKED = re.compile(r"(<!-- make benchmark -->\n).*(<!-- end of make benchmark -->)", re.DOTALL)


def report(document: Entry) -> str:
    """Return all tables of `document`, with the machine and the date above them."""
    parts = [
        [_machine(document)],
        [_CYCLES.format_map(document["machine"]), "", *tables.cycles(document)],
        [_PLANS, "", *tables.plans(document)],
        [_BUS, "", *tables.bus(document)],
        [_VALVES, "", *tables.valves(document)],
        [_SIMULATION, "", *tables.simulation(document)],
        [_INSTRUCTIONS, "", *tables.instructions(_counts())],
        tables.goals(document),
    ]
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


def publish(folder: Path) -> None:
    """Put the picture in `folder` into docs/, and its main tables into docs/speed.md, between their two marks.

    Raises:
        OSError: the benchmark has not written there.
    """
    document = json.loads((folder / "benchmark.json").read_text(encoding="utf-8"))
    shutil.copy(folder / "benchmark.png", ROOT / "docs" / "benchmark.png")
    parts = [
        [_machine(document)],
        [_CYCLES.format_map(document["machine"]), "", *tables.cycles(document)],
        [_PLANS, "", *tables.plans(document)],
        [_VALVES, "", *tables.valves(document)],
        [_SIMULATION, "", *tables.simulation(document)],
        [_INSTRUCTIONS, "", *tables.instructions(_counts())],
    ]
    text = "\n\n".join("\n".join(part) for part in parts)
    page = ROOT / "docs" / "speed.md"
    before = page.read_text(encoding="utf-8")
    page.write_text(_MARKED.sub(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", before), encoding="utf-8")


def _machine(document: Entry) -> str:
    about = document["machine"]
    versions = ", ".join(f"{name} {version.partition(' ')[0]}" for name, version in about["versions"].items())
    return f"{about['processor']}, {about['date']}, commit {about['commit']}; {versions}."


def _counts() -> dict[str, Entry]:
    counts: dict[str, Entry] = json.loads(REFERENCE.read_text(encoding="utf-8"))
    return counts
