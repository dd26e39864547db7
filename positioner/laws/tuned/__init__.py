"""Packaged parameters of the laws that need tuning: one file for each law, written by `positioner tune`. Pure.

Each file is a whole configuration; its comment says how `positioner tune` found the `[control.<law>]` table.
"""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any, TypeVar

from positioner.inputs import toml_reader

T = TypeVar("T")


def table_name(law: str) -> str:
    """Return the table under `[control]` that holds the parameters of `law`: its name, without hyphens."""
    return law.replace("-", "_")


@cache
def tuned(law: str, kind: type[T]) -> T:
    """Return the packaged parameters of `law` as a `kind`.

    Raises:
        ConfigurationError: the file does not make a `kind`: it was not written by `positioner tune`.
    """
    source = f"{table_name(law)}.toml"
    text = resources.files(__package__).joinpath(source).read_text(encoding="utf-8")
    table: dict[str, Any] = toml_reader.tables(text, source)["control"][table_name(law)]
    return toml_reader.build(table, kind, source)
