"""The builds of the positioner that can be measured here: the source, and the compiled one where it is installed."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

ROOT = Path(__file__).resolve().parents[2]
COMPILED = ROOT / "build" / "compiled"
"""Where the Makefile installs the wheel. Without a C compiler that holds no compiled modules."""


@dataclass(frozen=True, slots=True)
class Build:
    """How a process of one build is started: its Python, and its environment."""

    python: str
    environment: Mapping[str, str]


def builds() -> Mapping[str, Build]:
    """Return every build that is there, by its name."""
    found = {"interpreted": _build()}
    if (COMPILED / "installed").exists():
        other = _build(COMPILED)
        named = "from benchmarks.machine import build; print(build())"
        told = subprocess.run(
            [other.python, "-c", named], env=other.environment, capture_output=True, text=True, check=True
        )
        found.setdefault(told.stdout.strip(), other)
    return found


def _build(*folders: Path) -> Build:
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}
    # a safe path: the source in the working directory must not hide the installed packages
    paths = os.pathsep.join(str(each) for each in (*folders, ROOT / "tests"))
    return Build(sys.executable, kept | {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1"})
