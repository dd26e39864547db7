"""The results of a campaign as a Parquet file that says what it holds. Shell."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import positioner
from positioner.bench.result import installed_versions
from positioner.campaign.run import Figures
from positioner.campaign.study import code_of
from positioner.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from positioner.campaign.plan import Campaign
    from positioner.campaign.run import PlayedRun

INSTALL = "pyarrow is not installed: pip install 'sticking-valve-positioner[campaign]'"


def parquet() -> tuple[Any, Any]:
    """Return pyarrow and its module for Parquet.

    Raises:
        UsageError: it is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        from pyarrow import parquet as pq  # noqa: PLC0415
    except ImportError as error:
        raise UsageError(INSTALL) from error
    return pa, pq


def write_table(path: Path, campaign: Campaign, played: Sequence[PlayedRun]) -> None:
    """Write one row for each run to `path`, in place of what is there: parameters, law, seed, figures, failure."""
    pa, pq = parquet()
    names = [each.name for each in campaign.parameters]
    of_values = {float: pa.float64(), int: pa.int64(), bool: pa.bool_(), str: pa.string()}
    columns: dict[str, Any] = {
        "point": pa.array([each.run.point for each in played], pa.int32()),
        "law": pa.array([each.run.law for each in played], pa.string()),
        "seed": pa.array([each.run.seed for each in played], pa.int64()),
    }
    for place, name in enumerate(names):
        values = [each.run.values[place] for each in played]
        columns[name] = pa.array(values, of_values[type(values[0])])
    hints = get_type_hints(Figures)
    for field in fields(Figures):
        is_count = hints[field.name] is int or int in get_args(hints[field.name])
        figures = [each.outcome.figures for each in played]
        found = [None if each is None else getattr(each, field.name) for each in figures]
        columns[field.name] = pa.array(found, pa.int64() if is_count else pa.float64())
    columns["failure"] = pa.array([each.outcome.failure for each in played], pa.string())
    table = pa.table(columns).replace_schema_metadata(_about(campaign))
    part = path.with_suffix(".part")
    pq.write_table(table, part)
    with part.open("rb") as file:
        os.fsync(file.fileno())
    part.replace(path)


def _about(campaign: Campaign) -> dict[str, str]:
    """Return what is written beside the rows: all that is needed to play the campaign again."""
    return {
        "campaign": campaign.text,
        "campaign_digest": campaign.digest,
        "scenario": json.dumps(asdict(campaign.base)),
        "version": positioner.__version__,
        "code": json.dumps({law: code_of(law) for law in campaign.laws}),
        "packages": json.dumps(installed_versions()),
    }
