"""Whether the counters are those of the log, exactly, live and over kill -9: `make diagnostics-test`.

    PYTHONPATH=tests python tests/health/acceptance_counters.py [--short] [--kills N]

Daemons control emulated valves, and each record is counted again. Then processes that count are killed at random
instants, half of them with the table writer, which saves every 3 ms here; after each kill what is kept must be what the
cycles of all lives give, to the last digit.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from goal_table import show
from killed_counters import Lives, counted, real_run
from tqdm import tqdm


def main() -> int:
    """Print the table; return 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="a few runs and kills")
    parser.add_argument("--kills", type=int, default=1000, help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="(%(default)s)")
    options = parser.parse_args()
    kills = 10 if options.short else options.kills
    lengths = (2000,) if options.short else (2000, 5000, 8000)
    differ, cycles, done, lost = 0, 0, 0, 0
    wrong: list[str] = []
    with tempfile.TemporaryDirectory(prefix="counters-") as name:
        folder, real = Path(name), None
        for samples in lengths:
            for lockstep in (True, False):
                real = real_run(folder / f"run-{samples}-{lockstep}", samples, lockstep=lockstep)
                differ += counted(real.settings, {}, real.cycles).counting.so_far != real.counters
                cycles += len(real.cycles)
        assert real is not None
        lives = Lives(folder / "lives", real, options.seed)
        for number in tqdm(range(kills), "kills", disable=None):
            try:
                counts, not_kept = lives.kill_one()
            except AssertionError as error:
                wrong.append(f"kill {number}: {error}")
                break
            done, lost = done + counts, lost + not_kept
    recounted = f"counters of {2 * len(lengths)} runs ({cycles} cycles) unlike a recount of their record"
    killed = f"kills with kill -9 ({done} cycles counted, {lost} of them lost)"
    status = show(
        [
            (recounted, "0", f"{differ}", not differ),
            (killed, f"{kills}", f"{kills - len(wrong)}", not wrong),
            ("kept counters unlike a recount of all lives", "0", f"{len(wrong)}", not wrong),
        ]
    )
    print("\n".join(wrong))  # noqa: T201
    return status


if __name__ == "__main__":
    sys.exit(main())
