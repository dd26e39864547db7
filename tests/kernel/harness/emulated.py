"""QEMU with two SJA1000 CAN controllers on one bus, on the host's own file tree, which it can only read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from harness import script
from harness.packages import EMULATED, USER_MODE, one, unpacked
from harness.plan import CACHE, CAN_MODULES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.plan import Kind

_BOOT_MODULES = (
    *("virtio_ring", "virtio", "virtio_pci_legacy_dev", "virtio_pci_modern_dev", "virtio_pci"),
    *("netfs", "fscache", "9pnet", "9pnet_virtio", "9p", "overlay"),
)
"""In the order of their needs; the packages hold no list of dependencies before they are installed."""
_CONTROLLER_MODULES = ("sja1000", "kvaser_pci")

_INIT = """#!/bin/busybox sh
/bin/busybox mkdir -p /proc /sys /host /packages /memory
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
for module in {modules}; do /bin/busybox insmod /modules/$module.ko || echo "no module $module"; done
for share in host packages; do
    /bin/busybox mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,cache=loose,ro $share /$share
done
/bin/busybox mount -t tmpfs tmpfs /memory
/bin/busybox mkdir /memory/upper /memory/work /memory/new
layers=lowerdir=/packages:/host,upperdir=/memory/upper,workdir=/memory/work
/bin/busybox mount -t overlay -o $layers overlay /memory/new
cd /memory/new
/bin/busybox mount -t proc proc proc
/bin/busybox mount -t sysfs sysfs sys
/bin/busybox mount -t devtmpfs dev dev
/bin/busybox mkdir -p dev/shm dev/pts ./{out}
/bin/busybox mount -t devpts devpts dev/pts
/bin/busybox mount -t tmpfs tmpfs dev/shm
/bin/busybox mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,cache=none out ./{out}
/bin/busybox umount /proc
/bin/busybox umount /sys
exec /bin/busybox switch_root /memory/new /bin/sh {begin}
"""


def command(kind_name: str, kind: Kind, out: Path, tests: Sequence[str]) -> list[str]:
    """Write the scripts and the initramfs of the machine into `out`, and return the command that starts it."""
    root, packages = unpacked(CACHE, EMULATED), unpacked(CACHE, USER_MODE)
    needed = [_module(root, name) for name in (*CAN_MODULES, *_CONTROLLER_MODULES)]
    begin = script.write_begin(out, kind_name, kind, needed, tests)
    init = _INIT.format(modules=" ".join(_BOOT_MODULES), out=str(out).lstrip("/"), begin=begin)
    files = {"init": (init.encode(), 0o755), "bin/busybox": (one(root, "usr/bin/busybox").read_bytes(), 0o755)}
    for name in _BOOT_MODULES:
        files[f"modules/{name}.ko"] = (_module(root, name).read_bytes(), 0o644)
    (out / "initramfs").write_bytes(_cpio(files))
    libraries = ":".join(str(root / path) for path in ("usr/lib/x86_64-linux-gnu", "lib/x86_64-linux-gnu"))
    share = [word for name in ("qemu", "seabios") for word in ("-L", str(root / "usr/share" / name))]
    return [
        *("env", f"LD_LIBRARY_PATH={libraries}", str(root / "usr/bin/qemu-system-x86_64"), *share),
        *("-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2", "-m", "2048"),
        *("-nodefaults", "-display", "none", "-no-reboot", "-serial", "stdio"),
        *("-object", "can-bus,id=bus", "-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus"),
        *("-virtfs", "local,path=/,mount_tag=host,security_model=none,multidevs=remap,readonly=on"),
        *("-virtfs", f"local,path={packages},mount_tag=packages,security_model=none,multidevs=remap,readonly=on"),
        *("-virtfs", f"local,path={out},mount_tag=out,security_model=none,multidevs=remap"),
        *("-kernel", str(one(root, "boot/vmlinuz-*")), "-initrd", str(out / "initramfs")),
        *("-append", "console=ttyS0 panic=-1 quiet tsc=unstable systemd.show_status=false"),
    ]


def _module(root: Path, name: str) -> Path:
    return one(root, f"lib/modules/*/kernel/**/{name}.ko")


def _cpio(files: dict[str, tuple[bytes, int]]) -> bytes:
    """Return an archive in the "newc" format, which the kernel unpacks (kernel.org, buffer-format)."""
    folders = {str(parent) for name in files for parent in Path(name).parents if str(parent) != "."}
    entries = [(name, b"", 0o040755) for name in sorted(folders)]
    entries += [(name, data, 0o100000 | mode) for name, (data, mode) in files.items()]
    archive = bytearray()
    for number, (name, data, mode) in enumerate([*entries, ("TRAILER!!!", b"", 0)], 1):
        fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(name) + 1, 0)
        header = b"070701" + b"".join(b"%08X" % field for field in fields) + name.encode() + b"\0"
        for part in (header, data):
            archive += part + bytes(-len(part) % 4)
    return bytes(archive)
