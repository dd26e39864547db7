"""The reference of campaign files, from the dataclasses that they are read into. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from documents.configuration import section
from documents.keys import tables_of
from positioner.campaign.schema import CampaignFile

if TYPE_CHECKING:
    from documents.keys import Table

_INTRODUCTION = """\
# Campaign files

Every key of the file for `positioner campaign FILE`: laws over ranges of parameters ([how](../campaign.md)). The file
of a law, and that of the base, lie beside this file, if they are relative. `examples/campaign.toml` shows a file;
`positioner campaign --keys` lists the keys that `[parameters]` may change. Every mistake in the file is reported with
its line before anything is played.
"""


def tables() -> list[Table]:
    """Return every table of a campaign file."""
    return tables_of(CampaignFile)


def page() -> str:
    """Return the reference in Markdown."""
    return _INTRODUCTION + "".join(section(table) for table in tables())
