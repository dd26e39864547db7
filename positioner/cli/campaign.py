"""`positioner campaign`: a study over the parameters of plant, sensor, actuator and laws. Shell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_workers, workers_of
from positioner.cli.tables import add_output, note, show_result
from positioner.errors import BenchError, ExitCode, UsageError, writing

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands

_EPILOG = """\
examples:
  positioner campaign examples/campaign.toml            on every core of this machine
  positioner campaign examples/campaign.toml --dask tcp://192.0.2.1:8786
  positioner campaign --keys                            every key that a campaign may change

A cluster: `dask scheduler`, and on every node, with this package installed:
  dask worker ADDRESS --nworkers auto --nthreads 1

An interrupted campaign continues where it stopped, also when the machine was switched off: the same command again. With
more seeds, laws or points (of a Sobol sequence) only the new runs are played.

The output directory then holds: runs.parquet (one row for each run: parameters, law, seed, figures; in its metadata the
file of the campaign, the version and digests of the code), summary.md and summary.json, sensitivity.png, corners.png,
and corners/ (the scenarios of the worst runs). runs.jsonl is the journal from which a campaign continues.

exit status: 0 done; 1 failed, or some run could not be played to its end (its row says why); 78 the file is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner campaign`."""
    summary = "play laws over ranges of parameters, on every core or on a cluster, and show what matters"
    parser = add_command(commands, "campaign", _run, summary, _EPILOG)
    parser.add_argument("file", type=Path, nargs="?", metavar="FILE", help="the campaign, a TOML file")
    parser.add_argument("--keys", action="store_true", help="list the keys that a campaign may change, and end")
    add_output(parser)
    add_workers(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="output directory (default: campaign-NAME)")


def _run(arguments: argparse.Namespace) -> ExitCode:
    # matplotlib and the plant are needed here only
    from positioner.campaign.keys import known_keys  # noqa: PLC0415
    from positioner.campaign.reader import load_campaign  # noqa: PLC0415
    from positioner.campaign.report import write_report  # noqa: PLC0415
    from positioner.campaign.study import play_campaign  # noqa: PLC0415
    from positioner.campaign.summary import summary_of  # noqa: PLC0415
    from positioner.campaign.table import parquet, write_table  # noqa: PLC0415

    if arguments.keys:
        sys.stdout.writelines(f"{key:48} {kind.__name__}\n" for key, kind in known_keys().items())
        return ExitCode.OK
    if arguments.file is None:
        raise UsageError("the file of a campaign is missing; an example is examples/campaign.toml")
    parquet()  # hours of work must not end with a package that is missing
    campaign = load_campaign(arguments.file)
    out = arguments.out or Path(f"campaign-{campaign.file.name}")
    played = play_campaign(campaign, out, workers_of(arguments))
    with writing(out):
        write_table(out / "runs.parquet", campaign, played)
        found = write_report(out, campaign, played, summary_of(campaign, played))
    show_result(arguments, found, (out / "summary.json").read_text(encoding="utf-8"))
    note(f"\n{out}: runs.parquet, summary.md, summary.json, sensitivity and corners (.png, .svg)")
    if failed := sum(each.outcome.figures is None for each in played):
        raise BenchError(f"{failed} of {len(played)} runs failed; the column `failure` of runs.parquet says why")
    return ExitCode.OK
