"""Changes the safety-critical modules in every way that mutmut knows, and lets their tests find each change.

Start it as `python -m endurance.mutants`; `make mutants` does. `[tool.mutmut]` in pyproject.toml names the modules and
the tests; the changed copies are made in `mutants/`. A change that no test can find, because it changes nothing, is
marked where it stands: `# pragma: no mutate`, with the reason.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

STATISTICS = Path("mutants/mutmut-cicd-stats.json")


def main() -> int:
    """Run it from the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: one for each core)")
    options = parser.parse_args()
    began_s = time.monotonic()
    mutmut = [sys.executable, "-m", "mutmut"]
    done = subprocess.run([*mutmut, "run", "--max-children", str(options.jobs)], check=False)
    subprocess.run([*mutmut, "export-cicd-stats"], check=False, stdout=subprocess.DEVNULL)
    if done.returncode or not STATISTICS.is_file():
        sys.stderr.write("mutants: mutmut could not run; the reason is in its last lines\n")
        return 1
    counts = json.loads(STATISTICS.read_text(encoding="utf-8"))
    found = counts["killed"] + counts["timeout"]
    escaped = counts["total"] - found - counts["skipped"]
    took = f"{(time.monotonic() - began_s) / 60:.1f} min"
    sys.stdout.write(f"{counts['total']} changes, {found} found by a test, {escaped} escaped, in {took}\n")
    if escaped:
        subprocess.run([*mutmut, "results"], check=False)
        sys.stderr.write("mutants: look at one with `mutmut show NAME`; write the test that finds it\n")
    return 1 if escaped else 0


if __name__ == "__main__":
    raise SystemExit(main())
