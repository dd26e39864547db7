"""The formats of an export. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.export.csv_file import description_of, write_csv
from positioner.export.mf4_file import write_mf4
from positioner.export.parquet_file import write_parquet
from positioner.export.whole_file import whole_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from positioner.export.log_rows import Group
    from positioner.export.signals import Value

    Rows = Iterable[tuple[float, int, list[Value]]]


def _csv(path: Path, groups: Sequence[Group], rows: Rows, begin_s: float) -> None:
    del begin_s
    with whole_file(path) as part:
        write_csv(part, groups, rows)
        with whole_file(path.with_name(f"{path.name}-metadata.json")) as about:
            about.write_text(description_of(path.name, groups), encoding="utf-8")


def _parquet(path: Path, groups: Sequence[Group], rows: Rows, begin_s: float) -> None:
    del begin_s
    with whole_file(path) as part:
        write_parquet(part, groups, rows)


def _mf4(path: Path, groups: Sequence[Group], rows: Rows, begin_s: float) -> None:
    with whole_file(path) as part:
        write_mf4(part, groups, rows, begin_s)


FORMATS: Mapping[str, Callable[[Path, Sequence[Group], Rows, float], None]] = {
    "csv": _csv,
    "parquet": _parquet,
    "mf4": _mf4,
}
"""Name of a format, which is the end of its files' names → what writes the groups' rows of a log to a file.

The last argument is the instant of the log's first frame in s.
"""
