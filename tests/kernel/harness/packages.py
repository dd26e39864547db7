"""Debian packages unpacked into a folder of their own: nothing is installed, and an ordinary user can do it."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

USER_MODE = (
    *("user-mode-linux", "busybox-static", "can-utils", "iproute2", "kmod", "systemd", "udev", "dbus", "make"),
    *("python3", "python3-venv"),
)
EMULATED = ("qemu-system-x86", "linux-image-amd64", "busybox-static")
_MERGED = ("bin", "sbin", "lib", "lib64")


class CannotFetchError(Exception):
    """A kernel cannot be had here; the message says in one line what is missing."""


def unpacked(cache: Path, names: Sequence[str]) -> Path:
    """Return the root folder of `names` and of what they need beyond this machine's packages; fetched once.

    Raises:
        CannotFetchError: this machine has no apt, or the packages cannot be fetched.
    """
    for tool in ("apt-get", "dpkg-deb", "tar"):
        if shutil.which(tool) is None:
            raise CannotFetchError(f"kernel tests need {tool} (a Debian or Ubuntu machine), or a host that has vcan")
    folder = cache / hashlib.sha256(" ".join(names).encode()).hexdigest()[:12]
    root, finished = folder / "root", folder / "unpacked"
    if finished.exists():
        return root
    shutil.rmtree(folder, ignore_errors=True)
    for part in ("lists/partial", "archives/partial", "root/usr"):
        (folder / part).mkdir(parents=True)
    for name in _MERGED:
        (root / "usr" / name).mkdir()
        (root / name).symlink_to(f"usr/{name}")
    _apt(folder, "update")
    # the newest version of everything; installed packages of another version do not count
    _apt(folder, "install", "--download-only", "--yes", "--no-install-recommends", *names)
    for archive in sorted((folder / "archives").glob("*.deb")):
        _unpack(archive, root)
        archive.unlink()
    finished.touch()
    return root


def _apt(folder: Path, *arguments: str) -> None:
    options = {
        "Debug::NoLocking": "1",
        "APT::Sandbox::User": "",
        "Acquire::Retries": "3",
        "Dir::State::Lists": f"{folder}/lists",
        "Dir::Cache": str(folder),
        "Dir::Cache::pkgcache": "",
        "Dir::Cache::srcpkgcache": "",
        "Dir::Log": str(folder),
    }
    words = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
    done = subprocess.run(["apt-get", "-q", *words, *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip() or "it said nothing").splitlines()[-1]
        raise CannotFetchError(f"kernel tests: apt-get {arguments[0]} failed: {last}")


def _unpack(archive: Path, root: Path) -> None:
    # dpkg-deb -x would put folders where the links of the merged /usr are
    with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", str(archive)], stdout=subprocess.PIPE) as contents:
        tar = ["tar", "-x", "--keep-directory-symlink", "--no-same-owner", "-C", str(root)]
        subprocess.run(tar, stdin=contents.stdout, check=True)
    if contents.returncode:
        raise CannotFetchError(f"kernel tests: {archive.name} is damaged; remove {root.parent} and try again")


def one(root: Path, pattern: str) -> Path:
    """Return the newest path under `root` that matches.

    Raises:
        CannotFetchError: there is none.
    """
    found = sorted(root.glob(pattern))
    if not found:
        raise CannotFetchError(f"kernel tests: the packages hold no {pattern}; remove {root.parent} and try again")
    return found[-1]
