"""The `[wire]` table in the configuration of a valve, for programs that need only the frames. Pure but for the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.errors import ConfigurationError, Problem, UsageError
from positioner.inputs import toml_reader
from positioner.inputs.nearest import check_name
from positioner.inputs.toml_lines import problem_at
from positioner.wire.codec import make_codec
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.wire.codec import Codec


_TABLE = "[wire]"


def wire_table(path: Path, valve: str | None = None) -> dict[str, Any]:
    """Return the `[wire]` table of `path`, whose DBC, if it has a relative path, lies beside the file.

    `valve` is the id of the valve that is meant, where the file has several.

    Raises:
        ConfigurationError: the file cannot be read, or has no such table.
        UsageError: the file has no such valve, or several and none was named.
    """
    tables = toml_reader.tables(toml_reader.read_text(path), str(path))
    valves = tables.get("valve")
    own = _one_of(valves, valve, path) if isinstance(valves, list) else {}
    table = toml_reader.laid_over({"wire": tables.get("wire", {})}, {"wire": own.get("wire", {})})["wire"]
    if not isinstance(table, dict) or not table:
        text = "is missing: it names the DBC, the messages and the signals; see docs/own-dbc.md"
        raise ConfigurationError(str(path), (Problem(_TABLE, None, text),))
    if isinstance(table.get("dbc"), str):
        table = {**table, "dbc": str(path.absolute().parent / table["dbc"])}
    return table


def wire_codec(path: Path, valve: str | None = None, *, span_m: float = 0.127) -> Codec:
    """Return the codec of the `[wire]` table in `path`; 100 % of a signal in percent is `span_m`.

    Raises:
        ConfigurationError: as `wire_table`, and with every mistake in the table and its DBC.
        UsageError: as `wire_table`.
    """
    table = wire_table(path, valve)
    try:
        return make_codec(toml_reader.build(table, WireSettings, _TABLE), span_m=span_m)
    except ConfigurationError as error:
        text = toml_reader.read_text(path)
        named = [(f"wire.{each.where.removeprefix('wire.')}", each.message) for each in error.problems]
        raise ConfigurationError(str(path), tuple(problem_at(text, *each) for each in named)) from error


def _one_of(valves: list[Any], valve: str | None, path: Path) -> dict[str, Any]:
    """Return the tables of one `[[valve]]`.

    Raises:
        UsageError: there is no such valve, or there are several and none was named.
    """
    named = {str(each.get("id", number)): each for number, each in enumerate(valves, 1) if isinstance(each, dict)}
    if valve is not None:
        check_name("valve", valve, tuple(named))
        return named[valve]
    if len(named) != 1:
        raise UsageError(f"{path} has the valves {', '.join(named)}: name one of them with --valve")
    return next(iter(named.values()))
