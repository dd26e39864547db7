"""The scripts that run inside a kernel once its root file system stands, the same for every kind and both engines."""

from __future__ import annotations

import os
import shlex
import sys
from typing import TYPE_CHECKING

from harness.booted import BOOT
from harness.plan import BEGAN, INSIDE, PROJECT, RESULTS, TIME_FACTOR, WHEELS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from harness.plan import Kind

_HOME = "/run/tests"
"""A folder of the kernel's own: files in the host's temporary folder may belong to another user."""
_UNREADABLE = ("/etc/.pwd.lock", "/etc/shadow", "/etc/gshadow", "/etc/shadow-", "/etc/gshadow-")
_PRIVATE = ("/root", "/var/lib/private", "/var/cache/private", "/var/log/private", "/var/cache/ldconfig")
_BEGIN = """#!/bin/sh
# Process 1 in the root of the tests: the modules, then the tests, or systemd which runs them.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp LANG=C.UTF-8
{replaced}
mount -t tmpfs -o mode=755 tmpfs /run
for module in {modules}; do
    case $module in */vcan.ko) options=echo={echo} ;; *) options= ;; esac
    busybox insmod $module $options
done
ip link set lo up
{start}
"""


def write_begin(out: Path, kind_name: str, kind: Kind, modules: Sequence[Path], tests: Sequence[str]) -> Path:
    """Write the scripts of process 1 and of the tests into `out`, which the kernel sees at the same path.

    Args:
        out: the folder.
        kind_name: the kind's name, which the tests get.
        kind: the properties of the kernel.
        modules: kernel modules to insert, in this order.
        tests: node IDs; with none the kernel only shows that it boots.

    Returns:
        The script for process 1.
    """
    inside = _write_inside(out, kind_name, kind, tests)
    begin = out / "begin"
    begin.write_text(
        _BEGIN.format(
            replaced=_replaced(),
            modules=" ".join(map(str, modules)),
            echo=int(kind.vcan_echo),
            start=BOOT.format(out=out) if kind.booted else f"/bin/sh {inside}\nbusybox poweroff -f",
        ),
        encoding="utf-8",
    )
    begin.chmod(0o755)
    return begin


def _write_inside(out: Path, kind_name: str, kind: Kind, tests: Sequence[str]) -> Path:
    settings = {
        INSIDE: kind_name,
        RESULTS: str(out / "results.jsonl"),
        TIME_FACTOR: str(kind.time_factor),
        "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
        "PYTHONPATH": f"{PROJECT}:{PROJECT}/tests:{PROJECT}/tests/kernel:{PROJECT}/tests/bus:{PROJECT}/tests/runtime",
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
        f"uname -r > {out}/{BEGAN}",
        f"{shlex.join(pytest)} > {out}/pytest.log 2>&1" if tests else ":",
        "sync",
    ]
    path = out / "inside"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _replaced() -> str:
    """Return the commands that replace files that only the host's root may read, where the kernel is not root's."""
    if os.getuid() == 0:
        return ""
    files = [f"rm -f {path}; : > {path}" for path in _UNREADABLE]
    folders = [f"mkdir -p {path} && mount -t tmpfs -o mode=700 tmpfs {path}" for path in _PRIVATE]
    return "\n".join(files + folders)
