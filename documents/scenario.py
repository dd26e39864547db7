"""The reference of scenario files, from the dataclass that the bench reads them into. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from documents.configuration import section
from documents.keys import tables_of
from positioner.bench.scenario import Scenario

if TYPE_CHECKING:
    from documents.keys import Table

_INTRODUCTION = """\
# Scenario files

Every key of a scenario, which is one run of the [bench](../bench.md): for `positioner bench --scenario FILE`, and as
the base of a [campaign](campaign-files.md). The end of a key names its unit. The file of a law, and a DBC, lie beside
this file, if they are relative. The tables have the keys and limits of [plant files](plant-files.md) and of the
[configuration](configuration.md). The packaged scenarios stand in `positioner/bench/scenarios/`.
"""


def tables() -> list[Table]:
    """Return every table of a scenario file."""
    return tables_of(Scenario)


def page() -> str:
    """Return the reference in Markdown."""
    return _INTRODUCTION + "".join(section(table) for table in tables())
