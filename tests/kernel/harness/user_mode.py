"""User-mode Linux on the host's own file tree, under an overlay: nothing that a test does reaches the host."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from harness import script
from harness.packages import USER_MODE, one, unpacked
from harness.plan import CACHE, VCAN_MODULES, Kind

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_UNREADABLE = ("/etc/.pwd.lock", "/etc/shadow", "/etc/gshadow", "/etc/shadow-", "/etc/gshadow-")
_PRIVATE = ("/root", "/var/lib/private", "/var/cache/private", "/var/log/private", "/var/cache/ldconfig")

_INIT = """#!/bin/sh
# Process 1: an overlay over the host's tree, the modules, then the tests.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp LANG=C.UTF-8
busybox={root}/usr/bin/busybox
mount -t proc proc /proc
mount -t tmpfs -o mode=755 tmpfs /run
$busybox insmod {modules}/fs/overlayfs/overlay.ko
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
{replaced}
mkdir -p mnt/host {out_inside}
mount -t hostfs none {out_inside} -o {out}
pivot_root . mnt/host
cd /
mount -t tmpfs -o mode=755 tmpfs /run
for module in {module_paths}; do
    case $module in */vcan.ko) options=echo={echo} ;; *) options= ;; esac
    busybox insmod $module $options
done
ip link set lo up
{start}
"""
_BOOT = """mkdir -p /run/systemd/system
cat > /run/systemd/system/kernel-tests.service <<END
[Unit]
Description=Tests inside this kernel
[Service]
Type=oneshot
TimeoutStartSec=infinity
StandardOutput=append:{out}/pytest.log
StandardError=inherit
ExecStart=/bin/sh {out}/inside
ExecStopPost=/bin/busybox poweroff -f
END
cat > /run/systemd/system/kernel-tests.target <<END
[Unit]
Description=What the tests need, and the tests
Requires=basic.target
Wants=kernel-tests.service
After=basic.target
AllowIsolate=yes
END
for unit in systemd-timesyncd.service systemd-resolved.service systemd-firstboot.service \\
    ldconfig.service systemd-hwdb-update.service systemd-journal-catalog-update.service \\
    systemd-update-utmp.service systemd-machine-id-commit.service systemd-random-seed.service \\
    systemd-pstore.service systemd-tmpfiles-setup.service systemd-tmpfiles-setup-dev.service tmp.mount \\
    systemd-tmpfiles-clean.timer systemd-binfmt.service dev-hugepages.mount dev-mqueue.mount \\
    sys-kernel-debug.mount sys-kernel-tracing.mount; do
    ln -s /dev/null /run/systemd/system/$unit
done
rm -f /etc/fstab /etc/machine-id /etc/systemd/system/*.target.wants/*
echo 0123456789abcdef0123456789abcdef > /etc/machine-id
: > /etc/fstab
exec /lib/systemd/systemd systemd.unit=kernel-tests.target systemd.log_level=notice
"""


def command(kind_name: str, kind: Kind, out: Path, tests: Sequence[str]) -> list[str]:
    """Write what the kernel runs into `out`, which it sees as well, and return the command that starts it."""
    root = unpacked(CACHE, USER_MODE)
    modules = one(root, "usr/lib/uml/modules/*/kernel")
    inside = script.write_inside(out, kind_name, tests)
    init = out / "init"
    init.write_text(
        _INIT.format(
            root=root,
            modules=modules,
            module_paths=" ".join(str(modules / f"{name}.ko") for name in VCAN_MODULES),
            echo=int(kind.vcan_echo),
            out=out,
            out_inside=str(out).lstrip("/"),
            replaced=_replaced(),
            start=_BOOT.format(out=out) if kind.booted else f"/bin/sh {inside}\nbusybox poweroff -f",
        ),
        encoding="utf-8",
    )
    init.chmod(0o755)
    kernel = [str(root / "usr/bin/linux.uml"), "mem=1536M", "rootfstype=hostfs", "rootflags=/", "rw", f"init={init}"]
    return [*kernel, "con=null", "con0=fd:0,fd:1", "quiet", "systemd.show_status=false"]


def _replaced() -> str:
    """Return the commands that replace what only the host's root may read, where the kernel runs as somebody else."""
    if os.getuid() == 0:
        return ""
    files = [f"rm -f .{path}; : > .{path}" for path in _UNREADABLE]
    folders = [f"mkdir -p .{path} && mount -t tmpfs -o mode=700 tmpfs .{path}" for path in _PRIVATE]
    return "\n".join(files + folders)
