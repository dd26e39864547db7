"""The reference of the configuration, and how a table of settings is shown as Markdown. Pure.

`positioner check --example` shows the same keys as a file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from documents.keys import REQUIRED, tables_of
from positioner.config.schema import Configuration
from positioner.health.causes import LIMITS
from positioner.valve.parameters import ValveParameters
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from documents.keys import Table

_INTRODUCTION = """\
# Configuration

Every key that a configuration may hold, as `positioner run` reads it. `positioner check FILE` reports every mistake
with its line, its limits and the nearest known key; `positioner check --example` prints a file with every key.

Units are SI; the loop current is in mA. The end of a key names its unit. Every key may be left out, but for those of
`[valve]`: give all of them, or `preset = "paper"` or `"graphite"` for a valve with a name. Their column *default* shows
the paper's valve. In a file with several valves each table may stand at the top or in a `[[valve]]`
([how](../install.md#several-valves-in-one-process)).
"""


def tables() -> list[Table]:
    """Return every table of a configuration, in the order of the example."""
    return tables_of(Configuration, Configuration(valve=ValveParameters(id="FV-101")))


def page() -> str:
    """Return the reference in Markdown."""
    return _INTRODUCTION + "".join(section(table) for table in tables() if table.keys)


def section(table: Table) -> str:
    """Return one table of the reference in Markdown."""
    heading = table.names[0] if len(table.names) == 1 else f"{table.names[0].rpartition('.')[0]}.NAME"
    lines = [f"\n## [{heading}]\n" if heading else "\n## At the top\n"]
    if len(table.names) > 1:
        lines += ["`NAME` is one of these:\n", *_alike(table), ""]
    elif table.texts[0]:
        lines += [f"{table.texts[0]}\n"]
    lines += ["| key | value | limits | unit | default | what it is |", "|---|---|---|---|---|---|"]
    for key in table.keys:
        shown = "" if len(table.names) > 1 and key.default != REQUIRED else key.default
        lines.append(f"| `{key.name}` | {key.kind} | {key.limits} | {key.unit} | {shown} | {key.text} |")
    return "\n".join(lines) + "\n"


def _alike(table: Table) -> list[str]:
    """Return a row for each of several tables with the same keys; those of alarms show their usual limits."""
    rows = ["| NAME | what it is | usual limit | NE 107 | usual serious limit | NE 107 |", "|---|---|---|---|---|---|"]
    usual = {cause.key: limits for cause, limits in LIMITS.items()}
    names = [name.rpartition(".")[2] for name in table.names]
    if not set(names) <= set(usual):
        return [f"- `{name}`: {text}" for name, text in zip(names, table.texts, strict=True)]
    for name, text in zip(names, table.texts, strict=True):
        limits = usual[name]
        serious = f"{limits.serious_limit:g}" if limits.serious_limit else ""
        category = in_words(limits.serious_category) if serious else ""
        rows.append(f"| `{name}` | {text} | {limits.limit:g} | {in_words(limits.category)} | {serious} | {category} |")
    return rows
