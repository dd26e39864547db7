"""Measures everything in one run, and writes the figures, the tables and the picture.

python -m benchmarks --out out/benchmark
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import subprocess
from pathlib import Path

from tqdm import tqdm

from benchmarks import machine
from benchmarks.cases import cycle_cases, peer_cases, plan_cases
from benchmarks.measure import ROUNDS, Worker, measure, start
from benchmarks.report import report
from benchmarks.summary import summarize

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/benchmark"), metavar="DIR", help="default: %(default)s")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="repeats of every case (default: %(default)s)")
    parser.add_argument("--core", type=int, default=machine.last_core(), help="processor to use (default: %(default)s)")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    workers = [start(options.core, os.environ)]
    try:
        document = _measure(workers, options.rounds)
    finally:
        for worker in workers:
            worker.end()
    text = report(document)
    (options.out / "benchmark.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    (options.out / "benchmark.md").write_text(text, encoding="utf-8")
    print(text)  # noqa: T201 - what a person has asked for


def _measure(workers: list[Worker], rounds: int) -> dict[str, object]:
    each = len(cycle_cases()) + len(plan_cases())
    total = (each * len(workers) + len(peer_cases())) * (rounds + 1)
    with tqdm(total=total, desc="benchmark", unit=" plays", disable=None) as bar:

        def progress(name: str) -> None:
            bar.set_postfix_str(name, refresh=False)
            bar.update()

        figures = summarize(list(measure(workers, rounds, progress)))
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    about = {
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "processor": machine.processor(),
        "commit": commit,
        "versions": workers[0].versions,
    }
    return {"machine": about} | figures


if __name__ == "__main__":
    main()
