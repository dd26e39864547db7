"""The builds of the positioner that can be measured here: the source, and a compiled one where there is one."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

ROOT = Path(__file__).resolve().parents[2]


INSTALLED = ROOT / "build" / "compiled"
"""Where the Makefile installs the wheel; without a C compiler it has no compiled modules."""


def environments() -> Mapping[str, Mapping[str, str]]:
    """Return the environment of a process of each build that is there, by the name of the build."""
    found = {"interpreted": _environment(ROOT)}
    if any((INSTALLED / "positioner").rglob("*.so")):
        found["compiled"] = _environment(INSTALLED)
    return found


def _environment(folder: Path) -> dict[str, str]:
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}
    return kept | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT / 'tests'}"}
