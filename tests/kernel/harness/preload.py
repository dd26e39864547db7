"""A library that lets user-mode Linux run on processors whose registers it does not know, made on the spot."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

from harness.packages import CannotFetchError, unpacked

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

COMPILERS = ("cc", "gcc", "clang", "tcc")
FETCHED = ("tcc",)
_SOURCE = Path(__file__).with_name("ptrace.c")
_OPTIONS = ("-shared", "-fPIC", "-nostdlib")


def library(cache: Path, fetch: Callable[[Path, Sequence[str]], Path] = unpacked) -> Path | None:
    """Return the library for LD_PRELOAD, made once with a compiler of this machine or a fetched one; None without."""
    made = cache / f"ptrace-{hashlib.sha256(_SOURCE.read_bytes()).hexdigest()[:12]}.so"
    if made.exists():
        return made
    cache.mkdir(parents=True, exist_ok=True)
    unfinished = made.with_suffix(".unfinished")
    for compiler in _compilers(cache, fetch):
        done = subprocess.run(
            [*compiler, *_OPTIONS, "-o", str(unfinished), str(_SOURCE)], check=False, capture_output=True
        )
        if done.returncode == 0:
            return unfinished.rename(made)
    return None


def _compilers(cache: Path, fetch: Callable[[Path, Sequence[str]], Path]) -> Iterator[list[str]]:
    """Yield the commands of the compilers that are there, then of the one that can be fetched."""
    yield from ([name] for name in COMPILERS if shutil.which(name))
    try:
        root = fetch(cache, FETCHED)
    except CannotFetchError:
        return
    yield [str(root / "usr/bin/tcc"), "-B", str(next(root.glob("usr/lib/*/tcc"), root))]
