"""Plug-ins: laws and plants of others, by the name of an entry point or as FILE.py:NAME. Shell: runs their code.

An entry point (packaging.python.org, "Entry points specification") is a name that an installed distribution gives to
an object of its own. A name is examined without running the code behind it; only `loaded` runs it.
"""

from __future__ import annotations

import ast
import hashlib
import os
import re
import signal
import stat
import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from positioner.errors import ConfigurationError, Problem, shortened
from positioner.inputs.nearest import nearest

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.metadata import EntryPoint

_LARGEST_BYTES = 1 << 20
_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_FILE_AND_NAME = re.compile(r"(?P<file>.*\.py):(?P<name>\w+)")


class Kind(StrEnum):
    """What a plug-in is; the value is the word in a message."""

    LAW = "law"
    PLANT = "plant"

    @property
    def group(self) -> str:
        """The group of its entry points."""
        return f"positioner.{self.value}s"


@dataclass(frozen=True, slots=True)
class FileAndName:
    """An object of a Python file."""

    file: Path
    name: str

    @property
    def label(self) -> str:
        """What messages call it: the file without its folder, and the name."""
        return f"{self.file.name}:{self.name}"


def file_and_name(given: str) -> FileAndName | None:
    """Return what FILE.py:NAME stands for, None where `given` is no such name."""
    found = _FILE_AND_NAME.fullmatch(given)
    return FileAndName(Path(found["file"]), found["name"]) if found else None


def anchored(given: str, folder: Path) -> str:
    """Return the name with a relative file beside `folder`; other names stay as they are."""
    found = file_and_name(given)
    return given if found is None else f"{folder / found.file}:{found.name}"


def installed(kind: Kind) -> dict[str, EntryPoint]:
    """Return the entry points of all installed distributions by name; of two with one name the first counts."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - most commands name no plug-in

    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=kind.group):
        found.setdefault(entry.name, entry)
    return found


def problem_of(kind: Kind, given: str, known: tuple[str, ...], unknown: str = "is unknown") -> str | None:
    """Return what is wrong with a name that is none of `known`, None where it is a plug-in; its code does not run.

    unknown: what is said of a name that nothing has.
    """
    found = file_and_name(given)
    if found is None:
        if given.endswith(".py"):
            return f"names a file: say which {kind} in it is meant: {given}:NAME"
        if given in installed(kind):
            return None
        return f"{unknown}; {nearest(given, (*known, *installed(kind)))}"
    try:
        names = _names_in(_parsed(found.file))
    except ConfigurationError as error:
        return error.problems[0].message
    return None if found.name in names or "*" in names else _lacks(found, names)


def loaded(kind: Kind, given: str) -> Any:
    """Return the object behind the name of a plug-in.

    Raises:
        ConfigurationError: there is none, or its code fails; the message names the file and its line.
    """
    found = file_and_name(given)
    if found is not None:
        module = _module(found.file)
        if not hasattr(module, found.name):
            names = [name for name in vars(module) if not name.startswith("_")]
            raise _refused(str(found.file), found.name, None, _lacks(found, names))
        return getattr(module, found.name)
    entry = installed(kind).get(given)
    if entry is None:
        raise _refused(given, str(kind), None, "is not installed here")
    try:
        return entry.load()
    except BaseException as error:  # code of others may raise anything
        if is_interrupt(error):
            raise
        where = f"{entry.value} of {entry.dist.name}" if entry.dist else entry.value
        raise _refused(given, where, None, f"cannot be loaded: {text_of_error(error)}") from error


def _lacks(found: FileAndName, names: list[str]) -> str:
    listed = nearest(found.name, names) if names else "it defines nothing"
    return f"{found.file} has no {found.name}; {listed}"


def is_interrupt(error: BaseException) -> bool:
    """Return whether an error out of the code of others is a person's Ctrl-C, which ends the command.

    Where the program has a handler of its own for SIGINT, as the daemon has, Python raises no KeyboardInterrupt: then
    the code itself has raised it, and it is an error as any other.
    """
    return isinstance(error, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) is signal.default_int_handler


def text_of_error(error: BaseException) -> str:
    """Return the kind and the text of an error out of the code of others, in one line; the text may fail, too."""
    try:
        text = " ".join(str(error).split())
    except BaseException as failure:  # noqa: BLE001 - code of others may raise anything
        text = f"its text cannot be had: {type(failure).__name__}"
    return f"{type(error).__name__}: {shortened(text)}"


def changeable_by_others(file: Path, owner: int = 0) -> str | None:
    """Return who but `owner` can change the code of a file, what it imports beside it, or the way to them; else None.

    A folder above may be one like /tmp, in which everybody writes, but where nobody can replace what is the owner's.
    """
    for code in with_imports(file):
        for way in (code.absolute(), code.resolve()):
            own = (way, way.parent, way.parent / "__pycache__")
            for place in (*own, *way.parent.parents):
                try:
                    status = place.lstat()
                except OSError:
                    continue  # not there; who reads the code says so
                if status.st_uid != owner:
                    return f"{place} belongs to user {status.st_uid}"
                is_shared = bool(status.st_mode & stat.S_ISVTX) and place not in own
                if not stat.S_ISLNK(status.st_mode) and status.st_mode & _BY_OTHERS and not is_shared:
                    return f"{place} can be written by others"
    return None


def _parsed(file: Path) -> ast.Module:
    return ast.parse(_compiled(file)[0])


def _compiled(file: Path) -> tuple[bytes, Any]:
    """Return the source of a file, and its code.

    Raises:
        ConfigurationError: it cannot be read, or is no Python.
    """
    try:
        if not file.is_file() and file.exists():
            raise _refused(str(file), "file", None, f"{file} is no plain file")
        with file.open("rb") as opened:
            source = opened.read(_LARGEST_BYTES + 1)
        if len(source) > _LARGEST_BYTES:
            raise _refused(str(file), "file", None, f"{file} is larger than {_LARGEST_BYTES >> 20} MiB: no law is")
        return source, compile(source, str(file), "exec", dont_inherit=True)
    except OSError as error:
        raise _refused(str(file), "file", None, f"{file} cannot be read: {error.strerror}") from error
    except SyntaxError as error:
        line = f", line {error.lineno}" if error.lineno else ""  # none where the file holds null bytes
        text = f"{file}{line}: {error.msg}"
        raise _refused(str(file), "syntax", error.lineno, text) from error
    except ValueError as error:  # null bytes, before Python 3.11.4
        raise _refused(str(file), "syntax", None, f"{file}: {error}") from error
    except (RecursionError, MemoryError) as error:
        text = f"{file} is no Python source: {str(error) or 'nested too deeply'}"
        raise _refused(str(file), "file", None, text) from error


def _names_in(tree: ast.Module) -> list[str]:
    """Return what a module defines at its top level; `*` where it imports names that only running it would show."""
    names: list[str] = []
    for node in tree.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.append(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names += [alias.asname or alias.name.partition(".")[0] for alias in node.names]
        else:  # an assignment, or a branch that defines names
            names += [
                each.id for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
            ]
            inner = [each.name for each in ast.walk(node) if isinstance(each, ast.ClassDef | ast.FunctionDef)]
            names += inner
    return names


def _module(file: Path) -> ModuleType:
    """Return the module of a file, run once for each content; modules beside it can be imported by it.

    Raises:
        ConfigurationError: as `loaded`.
    """
    if os.geteuid() == 0 and (problem := changeable_by_others(file)):
        text = f"as root only code that root alone can change is run, and {problem}; run this as another user"
        raise _refused(str(file), "file", None, f"{text}, or give the file and its folders to root")
    source, code = _compiled(file)
    digest = hashlib.sha256(str(file.absolute()).encode() + b"\0" + source).hexdigest()
    name = f"positioner_plug_in_{digest[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = str(file)
    folder = str(file.absolute().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        exec(code, module.__dict__)  # noqa: S102 - the user asks for this file
    except BaseException as error:
        del sys.modules[name]
        if is_interrupt(error):
            raise
        raise _refused(str(file), "code", line_in(error, file), text_of_error(error)) from error
    return module


def with_imports(file: Path) -> list[Path]:
    """Return `file` and, in a fixed order, the modules in its folder that it imports, directly or through others."""
    found, waiting = [file], [file]
    while waiting:
        for each in _imported_beside(waiting.pop(), file.parent):
            if each not in found:
                found.append(each)
                waiting.append(each)
    return [file, *sorted(found[1:])]


def _imported_beside(file: Path, folder: Path) -> Iterator[Path]:
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return  # who loads it says so
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module or ""]
        else:
            continue
        for name in names:
            root = folder / name.partition(".")[0]
            if root.is_dir():
                yield from sorted(each for each in root.rglob("*.py") if "__pycache__" not in each.parts)
            elif root.with_suffix(".py").is_file():
                yield root.with_suffix(".py")


def line_in(error: BaseException, file: Path) -> int | None:
    """Return the line of `file` in which an error arose: the last one that its traceback knows."""
    line, trace = None, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(file):
            line = trace.tb_lineno
        trace = trace.tb_next
    return line


def _refused(source: str, where: str, line: int | None, message: str) -> ConfigurationError:
    return ConfigurationError(source, (Problem(where, line, " ".join(message.split())),))
