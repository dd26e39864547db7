"""The rounds of the benchmark: in each of them every case is played once, in every worker that has it."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from benchmarks.cases import cases
from benchmarks.distribution import smallest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


@dataclass(slots=True)
class Measured:
    """One case in one worker: labels (n,), the durations of each round (R, n) in ns, and its results."""

    name: str
    build: str
    labels: tuple[str, ...]
    rounds_ns: list[list[int]] = field(default_factory=list)
    results: list[str] = field(default_factory=list)

    def smallest_ns(self, label: str) -> list[int]:
        """Return the smallest duration of every action with `label`."""
        return [duration for duration, own in zip(smallest(self.rounds_ns), self.labels, strict=True) if own == label]

    def all_ns(self, label: str) -> list[int]:
        """Return every duration of an action with `label`."""
        return [
            duration
            for durations in self.rounds_ns
            for duration, own in zip(durations, self.labels, strict=True)
            if own == label
        ]


class Worker:
    """A process of `benchmarks.worker`."""

    def __init__(self, command: list[str], environment: Mapping[str, str]) -> None:
        self._process = subprocess.Popen(
            command, env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        about = self._read()
        self.build: str = about["build"]
        self.versions: dict[str, str] = about["versions"]

    def ask(self, name: str) -> dict[str, Any]:
        """Return the answer about the case `name`.

        Raises:
            RuntimeError: the worker has ended; it has told why.
        """
        assert self._process.stdin is not None
        self._process.stdin.write(name + "\n")
        self._process.stdin.flush()
        return self._read()

    def end(self) -> None:
        """End the process."""
        self._process.communicate()

    def _read(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"a worker of the benchmark ended with status {self._process.wait()}")
        answer: dict[str, Any] = json.loads(line)
        return answer


def start(core: int, environment: Mapping[str, str]) -> Worker:
    """Return a worker of the build in `environment` on `core`."""
    return Worker([sys.executable, "-m", "benchmarks.worker", str(core)], environment)


def plays(workers: Sequence[Worker], rounds: int) -> list[tuple[Worker, str, int]]:
    """Return every case of every worker and its repeats, at most `rounds`; the first worker has what is not ours."""
    return [
        (worker, name, min(entry.rounds, rounds))
        for name, entry in cases().items()
        for worker in (workers[:1] if entry.foreign else workers)
    ]


def measure(workers: Sequence[Worker], rounds: int, progress: Callable[[str], None]) -> list[Measured]:
    """Return every case of every worker; `progress` is told each thing that is done."""
    found: list[tuple[Worker, int, Measured]] = []
    for worker, name, repeats in plays(workers, rounds):
        progress(name)
        labels = tuple(worker.ask(name)["labels"])
        found.append((worker, repeats, Measured(name, worker.build, labels)))
    for number in range(rounds):
        for worker, repeats, measured in found:
            if number < repeats:
                progress(measured.name)
                answer = worker.ask(measured.name)
                measured.rounds_ns.append(answer["durations_ns"])
                measured.results.append(answer["result"])
    return [measured for *_, measured in found]
