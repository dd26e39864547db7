"""New values in a configuration file: each in its line, with the comments around it left as they are. Shell."""

from __future__ import annotations

import os
import re
import shutil
from typing import TYPE_CHECKING, Any

from positioner.config.reader import load_config
from positioner.errors import ConfigurationError, UsageError, writing
from positioner.inputs import toml_reader
from positioner.inputs.toml_lines import keys_in

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_VALUE = re.compile(r"(?P<key>[^=]*=\s*)(?P<value>[^#]*?)(?P<rest>\s*(?:#.*)?)$")


def write_values(path: Path, tables: Mapping[str, Mapping[str, float]], valve: str) -> Path:
    """Write `tables`, values by table and key, for the valve with this id; return the backup that was made before.

    In a file of several valves they stand in its `[[valve]]`.

    Raises:
        UsageError: the file has a form in which the values cannot be replaced line by line.
        StateError: the file cannot be written.
    """
    text = toml_reader.read_text(path)
    valves = toml_reader.tables(text, str(path)).get("valve")
    element = None
    if isinstance(valves, list):
        element = [each.get("id") for each in valves].index(valve)
        tables = {name if name.split(".")[0] == "valve" else f"valve.{name}": tables[name] for name in tables}
    changed = with_values(text, tables, element)
    if not _holds(changed, tables, element):
        raise UsageError(f"{path}: its form is beyond --write (inline tables?): copy the values yourself")
    backup = _free_name(path)
    with writing(path):
        shutil.copy2(path, backup)
        new = path.with_name(f".{path.name}.new")
        new.write_text(changed, encoding="utf-8")
        shutil.copymode(path, new)
        os.replace(new, path)  # noqa: PTH105 - both names are in one folder
    try:
        load_config(path, valve=valve)
    except Exception:
        shutil.copy2(backup, path)
        raise
    return backup


def with_values(text: str, tables: Mapping[str, Mapping[str, float]], element: int | None) -> str:
    """Return the TOML `text` with new values, in the line of their key, or after the last line of their table.

    element: the number of the `[[valve]]` from 0; None in a file of one valve.
    """
    lines = text.splitlines()
    for table, values in tables.items():
        for key, value in values.items():
            _set(lines, (*table.split("."), key), repr(float(f"{value:.6g}")), element)
    return "\n".join(lines) + "\n"


def _set(lines: list[str], path: tuple[str, ...], value: str, element: int | None) -> None:
    found = [each for each in keys_in("\n".join(lines)) if element is None or each[2] == element]
    for number, key, _ in found:
        if key == path and (match := _VALUE.match(lines[number - 1])):
            lines[number - 1] = f"{match['key']}{value}{match['rest']}"
            return
    inside = [
        number
        for number, key, _ in found
        # the table's heading or one of its keys, but not the heading of a table inside it
        if key == path[:-1] or (key[:-1] == path[:-1] and not lines[number - 1].lstrip().startswith("["))
    ]
    if not inside:
        end = len(lines) if element is None else max(number for number, _, _ in found)
        lines[end:end] = ["", f"[{'.'.join(path[:-1])}]"]
        inside = [end + 2]
    lines.insert(max(inside), f"{path[-1]} = {value}")


def _holds(text: str, tables: Mapping[str, Mapping[str, float]], element: int | None) -> bool:
    """Return whether the TOML `text` has the values."""
    try:
        values: Any = toml_reader.tables(text, "")
    except ConfigurationError:
        return False
    if element is not None:
        values = {"valve": values["valve"][element]}
    for table, wanted in tables.items():
        here = values
        for part in table.split("."):
            here = here.get(part, {}) if isinstance(here, dict) else {}
        if not isinstance(here, dict) or any(here.get(key) != float(f"{value:.6g}") for key, value in wanted.items()):
            return False
    return True


def _free_name(path: Path) -> Path:
    names = (path.with_name(f"{path.name}.backup{number or ''}") for number in range(1000))
    return next(name for name in names if not name.exists())
