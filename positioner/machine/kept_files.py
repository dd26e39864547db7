"""Kept files: JSON files in a state directory, written in one step each, also by root for another owner. Shell.

The owner decides which files are there. So root opens no link, waits for no pipe, and gives what it makes to the owner.
A file that cannot be used is one line, and another one is used in its place; who holds the directory moves it aside,
and nobody deletes it.
"""

from __future__ import annotations

import json
import math
import os
import stat
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, TypeVar

from positioner.errors import StateError, in_one_line, shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

T = TypeVar("T")

DAMAGED = "damaged"
"""The usual fault of a file that is set aside, a part of its new name."""
_UNUSABLE = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""What reading and using the content of a file that is not as it was written may raise."""
_LARGEST_BYTES = 4 << 20
_MOST_DIGITS = 19
"""Of an integer: those of 2^63, which counts microseconds for 292,000 years."""
_LARGEST = 1e100
"""Of a number: far beyond any quantity in SI units, and the product of three is still a float."""


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
        ValueError: it is no plain JSON file, or holds a number that no quantity has.
    """
    descriptor = os.open(name, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW, dir_fd=folder)
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1 or status.st_size > _LARGEST_BYTES:
            raise ValueError(f"is no plain file of at most {_LARGEST_BYTES >> 20} MiB")
        data = file.read()
    try:
        content = json.loads(data, parse_int=_integer, parse_float=_number, parse_constant=_number)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    if not isinstance(content, dict):
        raise ValueError("holds no JSON object")  # noqa: TRY004 - of the file
    return content


def _integer(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"holds the impossible number {text[:_MOST_DIGITS]}…")
    return int(text)


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) <= _LARGEST:
        raise ValueError(f"holds the impossible number {text[:_MOST_DIGITS]}")
    return value


def used(
    folder: int,
    names_in_order: Iterable[str],
    use: Callable[[str, dict[str, Any]], T],
    reject: Callable[[str, Exception], object],
) -> Iterator[T]:
    """Yield what `use` makes of each file that it can use; `reject` gets the name of any other one, and the error.

    A name without a file is passed over.
    """
    for name in names_in_order:
        try:
            found = use(name, read(folder, name))
        except FileNotFoundError:
            continue
        except (OSError, *_UNUSABLE) as error:
            reject(name, error)
        else:
            yield found


def why(error: Exception) -> str:
    """Return in one short line why a file cannot be used."""
    if isinstance(error, OSError):
        return f"cannot be read: {error.strerror}"
    text = str(error) if type(error) is ValueError else ""  # what our own checks say
    return in_one_line(shortened(text)) or "is damaged: it holds something else than was written"


def set_aside(directory: Path, name: str, fault: str, sidecars: Iterable[str] = ()) -> list[tuple[Path, Path]]:
    """Move a file that is not used aside, with those of its `sidecars` that are there; return each former and new path.

    `results/signature-1.json` becomes `results/signature-1.<fault>-<UTC time>-<n>.json`.

    Raises:
        OSError: it cannot be moved.
    """
    path = directory / name
    aside, moved = unused_name(directory, f"{path.name.partition('.')[0]}.{fault}", path.suffix), []
    for suffix in ("", *sidecars):
        before, after = path.with_name(f"{path.name}{suffix}"), aside.with_name(f"{aside.name}{suffix}")
        if os.path.lexists(before):
            before.rename(after)
            moved.append((before, after))
    sync(directory)
    return moved


def unused_name(directory: Path, stem: str, suffix: str) -> Path:
    """Return a path in the directory that no file has: `stem`, the UTC time, a number, `suffix`."""
    stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    taken = {path.name for path in directory.iterdir()}
    number = 1
    while any(each.startswith(f"{stem}-{stamp}-{number}{suffix}") for each in taken):
        number += 1
    return directory / f"{stem}-{stamp}-{number}{suffix}"


def sync(directory: Path) -> None:
    """Make renames in the directory last through a power cut."""
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
