"""Measures everything in one run, and writes the figures, the tables and the picture.

python -m benchmarks --out out/benchmark
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from benchmarks import machine
from benchmarks.builds import ROOT, builds
from benchmarks.cases import ROUNDS
from benchmarks.measure import measure, plays, start
from benchmarks.picture import draw
from benchmarks.report import publish, report
from benchmarks.summary import summarize

if TYPE_CHECKING:
    from benchmarks.measure import Measured, Worker


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/benchmark"), metavar="DIR", help="default: %(default)s")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="repeats of every case (default: %(default)s)")
    parser.add_argument("--core", type=int, default=machine.last_core(), help="processor to use (default: %(default)s)")
    parser.add_argument("--publish", action="store_true", help="put the last figures into docs/; measure nothing")
    options = parser.parse_args()
    if options.publish:
        publish(options.out)
        return
    options.out.mkdir(parents=True, exist_ok=True)
    workers = [start(options.core, environment) for environment in builds().values()]
    try:
        document = {"machine": _about(workers[0]) | {"rounds": options.rounds}} | summarize(
            _measured(workers, options.rounds)
        )
    finally:
        for worker in workers:
            worker.end()
    text = report(document)
    (options.out / "benchmark.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    (options.out / "benchmark.md").write_text(text, encoding="utf-8")
    draw(options.out / "benchmark.png", document)
    print(text)  # noqa: T201 - what a person has asked for


def _measured(workers: list[Worker], rounds: int) -> list[Measured]:
    total = sum(repeats + 1 for *_, repeats in plays(workers, rounds))
    with tqdm(total=total, desc="benchmark", unit=" plays", disable=None) as bar:

        def progress(name: str) -> None:
            bar.set_postfix_str(name, refresh=False)
            bar.update()

        return measure(workers, rounds, progress)


def _about(worker: Worker) -> dict[str, Any]:
    described = ("git", "describe", "--always", "--dirty")
    commit = subprocess.run(described, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()
    return {
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "processor": machine.processor(),
        "commit": commit,
        "versions": worker.versions,
    }


if __name__ == "__main__":
    main()
