"""An export as Parquet: a row for each frame, a column for each signal, null in the frames of other messages. Shell.

Unit, comment, message and signal of a column are the metadata of its field.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from positioner.errors import UsageError
from positioner.export.chunks import chunks, kind_of
from positioner.export.csv_file import TIME, TIME_MEANING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from positioner.export.log_rows import Group
    from positioner.export.signals import Value

_INSTALL = "pyarrow is not installed: pip install 'sticking-valve-positioner[export]'"


def write_parquet(path: Path, groups: Sequence[Group], rows: Iterable[tuple[float, int, list[Value]]]) -> None:
    """Write the rows to `path`.

    Raises:
        UsageError: pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as error:
        raise UsageError(_INSTALL) from error
    columns = [(number, group, index) for number, group in enumerate(groups) for index in range(len(group.signals))]
    fields = [pa.field(TIME, pa.float64(), nullable=False, metadata={"unit": "s", "comment": TIME_MEANING})]
    for _, group, index in columns:
        signal = group.signals[index]
        about = {"unit": signal.unit, "comment": signal.meaning, "message": group.message.name, "signal": signal.name}
        fields.append(pa.field(signal.column, pa.from_numpy_dtype(kind_of(signal)), metadata=about))
    schema = pa.schema(fields)
    with parquet.ParquetWriter(path, schema) as writer:
        for chunk in chunks(groups, rows):
            arrays = [pa.array(chunk.time_s)]
            for number, group, index in columns:
                values, held = chunk.column(number, index, group.signals[index])
                arrays.append(_among_others(pa, len(chunk.time_s), chunk.places[number], values, held))
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema), row_group_size=len(chunk.time_s))


def _among_others(
    pa: Any, rows: int, places: NDArray[np.intp], values: NDArray[np.generic], held: NDArray[np.bool_] | None
) -> Any:
    """Return the values at their places among `rows`, null in all others."""
    data, is_null = np.zeros(rows, values.dtype), np.ones(rows, np.bool_)
    data[places] = values
    is_null[places] = False if held is None else ~held
    return pa.array(data, mask=is_null, from_pandas=False)
