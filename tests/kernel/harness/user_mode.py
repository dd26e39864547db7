"""User-mode Linux on the host's own file tree, under an overlay: nothing that a test does reaches the host."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from harness import preload, script
from harness.packages import USER_MODE, one, unpacked
from harness.plan import CACHE, CAN_MODULES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.plan import Kind

_MEMORY_MIB = 1536
_INIT = """#!/bin/sh
# Process 1: an overlay over the host's tree.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp LANG=C.UTF-8
busybox={root}/usr/bin/busybox
mount -t proc proc /proc
mount -t tmpfs -o mode=755 tmpfs /run
$busybox insmod {overlay}
$busybox mkdir /run/upper /run/work /run/new /run/packages
# a mount of its own: an overlay takes no layer that lies within another
mount -t hostfs none /run/packages -o {root}
layers=lowerdir=/run/packages:/,upperdir=/run/upper,workdir=/run/work
mount -t overlay -o $layers overlay /run/new || exec $busybox poweroff -f
cd /run/new
mount -t proc proc proc
mount -t sysfs sysfs sys
mount -t devtmpfs dev dev
mkdir -p dev/pts dev/shm
mount -t devpts devpts dev/pts
mount -t tmpfs tmpfs dev/shm
mkdir -p mnt/host {out_inside}
mount -t hostfs none {out_inside} -o {out}
pivot_root . mnt/host
cd /
exec /bin/sh {begin}
"""


def command(kind_name: str, kind: Kind, out: Path, tests: Sequence[str]) -> list[str]:
    """Write what the kernel runs into `out`, which it sees as well, and return the command that starts it."""
    root = unpacked(CACHE, USER_MODE)
    modules = one(root, "usr/lib/uml/modules/*/kernel")
    needed = [one(modules, f"**/{name}.ko") for name in CAN_MODULES]
    init = out / "init"
    init.write_text(
        _INIT.format(
            root=root,
            overlay=one(modules, "fs/overlayfs/overlay.ko"),
            out=out,
            out_inside=str(out).lstrip("/"),
            begin=script.write_begin(out, kind_name, kind, needed, tests),
        ),
        encoding="utf-8",
    )
    init.chmod(0o755)
    start = [str(root / "usr/bin/linux.uml"), f"mem={_MEMORY_MIB}M", "rootfstype=hostfs", "rootflags=/", "rw"]
    quiet = ["con=null", "con0=fd:0,fd:1", "quiet", "systemd.show_status=false"]
    return ["env", *_environment(), *start, f"init={init}", *quiet]


def _environment() -> list[str]:
    """Return the settings of the process that is the kernel."""
    registers = preload.library(CACHE)
    settings = [f"LD_PRELOAD={registers}"] if registers else []
    # its memory is a file; a container often has a small /dev/shm
    shared = Path("/dev/shm")  # noqa: S108 - where user-mode Linux puts it
    if not shared.is_dir() or os.statvfs(shared).f_bavail * os.statvfs(shared).f_frsize < 2 * _MEMORY_MIB << 20:
        settings.append(f"TMPDIR={CACHE}")
    return settings
