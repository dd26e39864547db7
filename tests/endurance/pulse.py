"""Memory and descriptors of a process, sampled over its life, and whether they grew."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, linear_regression

_KIB = 1024
_WARM_UP = 0.4
"""Share of a process's life in which its memory may grow: caches and the cells of the table fill."""
_FEWEST = 10


@dataclass(slots=True)
class Pulse:
    """One process: the instants of the measurements (s), its resident memory (bytes), its open descriptors."""

    name: str
    process: int
    times_s: list[float] = field(default_factory=list)
    memory_bytes: list[int] = field(default_factory=list)
    descriptors: list[int] = field(default_factory=list)

    def measure(self, now_s: float) -> None:
        """Measure the process; one that has ended changes nothing."""
        try:
            text = Path(f"/proc/{self.process}/smaps_rollup").read_text("ascii")
            descriptors = sum(1 for _ in Path(f"/proc/{self.process}/fd").iterdir())
        except OSError:
            return
        resident = next((line.split() for line in text.splitlines() if line.startswith("Rss:")), None)
        if resident is None:
            return  # it is ending
        self.times_s.append(now_s)
        self.memory_bytes.append(int(resident[1]) * _KIB)
        self.descriptors.append(descriptors)

    @property
    def is_long(self) -> bool:
        """Whether there are enough measurements to distinguish growth from chance."""
        return len(self.times_s) >= _FEWEST

    @property
    def growth(self) -> float:
        """Growth of the memory over the life after the warm-up, by least squares, as a share of its mean."""
        start = int(_WARM_UP * len(self.times_s))
        times_s, memory = self.times_s[start:], self.memory_bytes[start:]
        slope = linear_regression(times_s, memory).slope
        return slope * (times_s[-1] - times_s[0]) / fmean(memory)

    @property
    def leaked(self) -> int:
        """The least number of descriptors in the last third less that in the second; those of a commit come and go."""
        third = len(self.descriptors) // 3
        return min(self.descriptors[2 * third :]) - min(self.descriptors[third : 2 * third])
