"""The builds of the positioner that can be measured here: the source, and a compiled one where there is one."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

ROOT = Path(__file__).resolve().parents[2]


def environments(compiled: Path | None) -> Mapping[str, Mapping[str, str]]:
    """Return the environment of a process of each build, by the name of the build; `compiled`: where one lies."""
    folders = {"interpreted": ROOT} | ({"compiled": compiled.resolve()} if compiled else {})
    return {name: _environment(folder) for name, folder in folders.items()}


def _environment(folder: Path) -> dict[str, str]:
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}
    return kept | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT / 'tests'}"}
