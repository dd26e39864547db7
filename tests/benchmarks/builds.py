"""The builds of the positioner that can be measured here: the source, and the compiled one where it is installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

ROOT = Path(__file__).resolve().parents[2]
COMPILED = ROOT / "build" / "compiled"
"""Where the Makefile installs the wheel. Without a C compiler that holds no compiled modules."""


def builds() -> Mapping[str, Mapping[str, str]]:
    """Return every build that is there: the environment in which this Python runs it, by its name."""
    found = {"interpreted": _environment()}
    if (COMPILED / "installed").exists():
        other = _environment(COMPILED)
        named = "from benchmarks.machine import build; print(build())"
        told = subprocess.run([sys.executable, "-c", named], env=other, capture_output=True, text=True, check=True)
        found.setdefault(told.stdout.strip(), other)
    return found


def _environment(*folders: Path) -> dict[str, str]:
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}
    # a safe path: the source in the working directory must not hide the installed packages
    paths = os.pathsep.join(str(each) for each in (*folders, ROOT / "tests"))
    return kept | {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1"}
