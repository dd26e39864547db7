"""`positioner reproduce`: the paper's five simulations, compared with its results. Shell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_study, workers_of
from positioner.errors import ExitCode, writing

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands

_EPILOG = """\
examples:
  positioner reproduce                     every interpretation: about ten minutes on one core
  positioner reproduce --short             only the moves, in half a minute: dwells of 15 ms instead of 1 s, too short
                                           to decide results about the stem at rest
  positioner reproduce --reading A         white noise and a Kalman filter only

interpretations of the paper, where it is not explicit:
  A           white noise, 2 % of the reading; position and speed from a Kalman filter
  B           each draw of the noise held for 10 ms; raw position, speed from differences
Both are played with α and β of eq. 22 in SI and in cm, and each with a control run without noise.

The output directory then holds: reproduce.png (everything on one page), figure-4.png to figure-8.png (the paper's
figures), reproduce.md (the published results beside ours, and the figures) and reproduce.json (the same for programs).
One of the runs, frame by frame on a bus: positioner bench --scenario paper-3
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner reproduce`."""
    parser = add_command(
        commands, "reproduce", _run, "play the paper's simulations, and compare with its published results", _EPILOG
    )
    parser.add_argument(
        "--reading",
        choices=("A", "B", "both"),
        default="both",
        help="interpretation of the paper's noise (default: %(default)s)",
    )
    parser.add_argument("--short", action="store_true", help="dwells of 15 ms: too short for the stem to rest")
    add_study(parser, Path("reproduce"))


def _run(arguments: argparse.Namespace) -> ExitCode:
    # matplotlib and the plant are needed here only
    from positioner.studies.interpretations import NoiseKind, interpretations  # noqa: PLC0415
    from positioner.studies.published_results import assess  # noqa: PLC0415
    from positioner.studies.reproduce import SIMULATIONS, all_runs, reproduce  # noqa: PLC0415
    from positioner.studies.reproduce_pictures import FIGURE_OF, draw_figure, draw_page  # noqa: PLC0415
    from positioner.studies.reproduce_report import to_json, to_markdown  # noqa: PLC0415

    both = (NoiseKind.FILTERED, NoiseKind.RAW)
    noises = both if arguments.reading == "both" else (NoiseKind(arguments.reading),)
    out: Path = arguments.out
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    played_runs = reproduce(all_runs(interpretations(noises), short=arguments.short), workers_of(arguments))
    found = assess(played_runs)
    text = to_markdown(played_runs, found)
    with writing(out):
        for simulation in SIMULATIONS:
            draw_figure(out / f"figure-{FIGURE_OF[simulation]}.png", simulation, played_runs, found)
        draw_page(out / "reproduce.png", played_runs, found)
        (out / "reproduce.md").write_text(text, encoding="utf-8")
        (out / "reproduce.json").write_text(to_json(played_runs, found), encoding="utf-8")
    sys.stdout.write(text)
    sys.stdout.write(f"\n{out}: reproduce.png, figure-4.png to figure-8.png, reproduce.md, reproduce.json\n")
    return ExitCode.OK
