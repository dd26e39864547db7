"""The script that runs the tests inside a kernel, the same for every kind."""

from __future__ import annotations

import shlex
import sys
from typing import TYPE_CHECKING

from harness.plan import INSIDE, PROJECT, RESULTS, WHEELS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_HOME = "/run/tests"
"""A folder of the kernel's own: what the host has in its temporary folder may be somebody else's."""


def write_inside(out: Path, kind_name: str, tests: Sequence[str]) -> Path:
    """Write the script into `out`, which the kernel sees at the same path, and return where it lies."""
    settings = {
        INSIDE: kind_name,
        RESULTS: str(out / "results.jsonl"),
        "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
        "PYTHONPATH": f"{PROJECT}:{PROJECT}/tests:{PROJECT}/tests/kernel",
        "PYTHONDONTWRITEBYTECODE": "1",
        "HOME": _HOME,
        "TMPDIR": _HOME,
        "LANG": "C.UTF-8",
        "MPLCONFIGDIR": _HOME,
        "OPENBLAS_NUM_THREADS": "1",
        "PIP_NO_INDEX": "1",
        "PIP_FIND_LINKS": str(WHEELS),
    }
    pytest = [sys.executable, "-m", "pytest", "-p", "harness.inside", "-p", "no:cacheprovider", *tests]
    lines = [
        *(f"export {name}={shlex.quote(value)}" for name, value in settings.items()),
        f"mkdir -p -m 1777 {_HOME}",
        f"cd {PROJECT}",
        f"{shlex.join(pytest)} > {out}/pytest.log 2>&1",
        "sync",
    ]
    path = out / "inside"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
