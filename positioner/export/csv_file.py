"""An export as CSV: one row for each frame, one column for each signal, and a description of the columns beside it.

A cell is empty where the frame is one of another message. The description is a metadata document of "CSV on the Web"
(W3C, "Metadata Vocabulary for Tabular Data", 2015). Shell.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from positioner.export.log_rows import Group
    from positioner.export.signals import Value

TIME = "time_s"
TIME_MEANING = "instant of the frame in the log"


def write_csv(path: Path, groups: Sequence[Group], rows: Iterable[tuple[float, int, list[Value]]]) -> None:
    """Write the rows to `path`; each number has as many digits as it needs to be read again to the bit."""
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join([TIME, *(signal.column for group in groups for signal in group.signals)]) + "\n")
        file.writelines(_lines(groups, rows))


def _lines(groups: Sequence[Group], rows: Iterable[tuple[float, int, list[Value]]]) -> Iterator[str]:
    widths = [len(group.signals) for group in groups]
    before = ["," * (1 + sum(widths[:number])) for number in range(len(groups))]
    after = ["," * sum(widths[number + 1 :]) + "\n" for number in range(len(groups))]
    for time_s, number, values in rows:
        cells = ",".join(["" if value is None else repr(value) for value in values])
        yield f"{time_s!r}{before[number]}{cells}{after[number]}"


def description_of(name: str, groups: Sequence[Group]) -> str:
    """Return the description of the columns of the file `name`, as JSON."""
    columns = [_column(TIME, "double", "s", TIME_MEANING)]
    columns += [
        _column(signal.column, "integer" if signal.is_whole else "double", signal.unit, signal.meaning)
        for group in groups
        for signal in group.signals
    ]
    document = {"@context": "http://www.w3.org/ns/csvw", "url": name, "tableSchema": {"columns": columns}}
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _column(title: str, datatype: str, unit: str, text: str) -> dict[str, str]:
    return {"titles": title, "datatype": datatype, "schema:unitText": unit, "dc:description": text}
