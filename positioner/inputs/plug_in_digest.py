"""A digest of the source of a plug-in: a result that its old code computed is not used again. Shell.

It covers the Python file, and the modules beside it that it imports; of an entry point every file of its package. Data
that a file reads is not covered.
"""

from __future__ import annotations

import hashlib
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.inputs.plug_in import file_and_name, installed, with_imports

if TYPE_CHECKING:
    from positioner.inputs.plug_in import Kind


def plug_in_digest(kind: Kind, given: str) -> str:
    """Return a digest of the source behind a name; empty where it is no plug-in."""
    found = file_and_name(given)
    if found is not None:
        return _digest(with_imports(found.file), found.file.parent)
    entry = installed(kind).get(given)
    if entry is None:
        return ""
    root = entry.module.partition(".")[0]
    spec = find_spec(root)
    folders = [Path(each) for each in (spec.submodule_search_locations or ())] if spec else []
    if folders:
        files = [file for folder in folders for file in sorted(folder.rglob("*")) if _is_source(file)]
        return _digest(files, folders[0].parent)
    return _digest([Path(spec.origin)], Path(spec.origin).parent) if spec and spec.origin else entry.value


def _is_source(file: Path) -> bool:
    return file.is_file() and "__pycache__" not in file.parts


def _digest(files: list[Path], folder: Path) -> str:
    digest = hashlib.sha256()
    for file in files:
        name = file.relative_to(folder) if file.is_relative_to(folder) else file.name
        digest.update(f"{name}\0".encode() + (file.read_bytes() if file.is_file() else b"") + b"\0")
    return digest.hexdigest()
