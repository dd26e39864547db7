"""A folder of JSON files in a state directory, written in one step each, also by root for another owner. Shell.

The owner decides which files are there. So root opens no link, waits for no pipe, and gives what it makes to the owner.
"""

from __future__ import annotations

import json
import math
import os
import stat
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from positioner.errors import StateError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_LARGEST_BYTES = 4 << 20


@contextmanager
def opened(parent: Path, name: str) -> Iterator[int]:
    """Yield a descriptor of a folder, which is no link.

    Raises:
        OSError: there is none, or it may not be read.
    """
    outer = os.open(parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        folder = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=outer)
    finally:
        os.close(outer)
    try:
        yield folder
    finally:
        os.close(folder)


@contextmanager
def writable(parent: Path, name: str, what: str) -> Iterator[int]:
    """Yield a descriptor of a folder, made where it is missing; `what` goes into it, such as `the result`.

    Raises:
        StateError: there is none, or what the `with` block does in it fails.
    """
    try:
        parent.mkdir(parents=True, exist_ok=True)
        is_new = not os.path.lexists(parent / name)
        (parent / name).mkdir(mode=0o750, exist_ok=True)
        with opened(parent, name) as folder:
            if is_new:
                _give_to(parent.stat(), folder)
            yield folder
    except OSError as error:
        why = f"{error.strerror}; become the owner of the directory, or give another one with --state"
        raise StateError(f"{parent / name}: {what} cannot be kept: {why}") from error


def _give_to(owner: os.stat_result, descriptor: int) -> None:
    """Give what this process has made to the owner of the folder around it."""
    if os.geteuid() == 0:
        os.fchown(descriptor, owner.st_uid, owner.st_gid)


def names(folder: int) -> list[str]:
    """Return the names of the files in a folder."""
    return os.listdir(folder)


def free_name(folder: int, stem: str) -> str:
    """Return a name that no file of the folder has: `stem`, and a number where needed."""
    taken, number = set(names(folder)), 1
    while (name := f"{stem}.json" if number == 1 else f"{stem}-{number}.json") in taken:
        number += 1
    return name


def check_writable(folder: int) -> None:
    """Do nothing where this process can make files in the folder.

    Raises:
        OSError: it cannot.
    """
    name = f".check.{os.getpid()}"
    os.close(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600, dir_fd=folder))
    os.unlink(name, dir_fd=folder)


def write(folder: int, name: str, content: dict[str, Any]) -> None:
    """Put the file in place in one step, once it is on the disk."""
    fresh = f".{name}.{os.getpid()}"
    with suppress(FileNotFoundError):
        os.unlink(fresh, dir_fd=folder)
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o640, dir_fd=folder)
    try:
        _give_to(os.fstat(folder), descriptor)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            json.dump(_plain(content), file, indent=1, allow_nan=False, ensure_ascii=False)
            file.write("\n")
            file.flush()
            os.fsync(descriptor)
        os.rename(fresh, name, src_dir_fd=folder, dst_dir_fd=folder)
    except BaseException:
        with suppress(OSError):
            os.unlink(fresh, dir_fd=folder)
        raise
    os.fsync(folder)


def _plain(value: Any) -> Any:
    """Return the value as JSON can hold it: a number that is none becomes None."""
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read(folder: int, name: str) -> dict[str, Any]:
    """Return the object in a plain file of the folder; it never waits.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no plain JSON file.
    """
    descriptor = os.open(name, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW, dir_fd=folder)
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1 or status.st_size > _LARGEST_BYTES:
            raise ValueError("no plain file")
        content = json.loads(file.read())
    if not isinstance(content, dict):
        raise ValueError("no object")  # noqa: TRY004 - of the file
    return content
