"""Reading the lock files that `make install` installs from: one exact version and its hashes for each package."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from packaging.markers import Marker
from packaging.utils import canonicalize_name

if TYPE_CHECKING:
    from pathlib import Path

_FIRST = re.compile(r"(?P<name>[\w.-]+)(\[[\w,.-]+\])?==(?P<version>[\w.!+-]+)( ; (?P<marker>.+))?")
_HASH = re.compile(r"--hash=(\w+):([0-9a-f]+)")


@dataclass(frozen=True, slots=True)
class Locked:
    """One package of a lock file; `marker` says for which interpreters, None for all."""

    name: str
    version: str
    marker: Marker | None
    hashes: tuple[tuple[str, str], ...]

    def applies(self, python: str) -> bool:
        """Return whether it is for this Python, for example "3.11", on Linux."""
        environment = {"python_version": python, "python_full_version": f"{python}.0", "sys_platform": "linux"}
        return self.marker is None or self.marker.evaluate(environment)

    def line(self) -> str:
        """Return its requirement without the marker."""
        return " ".join([f"{self.name}=={self.version}", *(f"--hash={kind}:{value}" for kind, value in self.hashes)])


def read(path: Path) -> list[Locked]:
    """Return the packages of a lock file.

    Raises:
        ValueError: a line is no pinned package.
    """
    joined = path.read_text(encoding="utf-8").replace("\\\n", " ")
    found = []
    for line in joined.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        requirement, *_ = line.split(" --hash=")
        first = _FIRST.fullmatch(requirement.strip())
        if first is None:
            raise ValueError(f"{path.name}: {requirement.strip()!r} is no pinned package")
        marker = Marker(first["marker"]) if first["marker"] else None
        hashes = tuple((kind, value) for kind, value in _HASH.findall(line))
        found.append(Locked(canonicalize_name(first["name"]), first["version"], marker, hashes))
    return found
