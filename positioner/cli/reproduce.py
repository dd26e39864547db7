"""`positioner reproduce`: the paper's five simulations, compared with its results. Shell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_study, workers_of
from positioner.cli.tables import add_output, note, show_result
from positioner.errors import ExitCode, writing
from positioner.report.text import markdown

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

The output directory then holds: reproduce.png (all positions on one page), figure-4.png to figure-8.png (the paper's
figures), all of them also as .svg, reproduce.md (the published results beside ours, and the figures) and reproduce.json
(the same for programs).
One of the runs, frame by frame on a bus: positioner bench --scenario paper-3

exit status: 0 done, 1 failed, 2 wrong command line, 74 the output directory cannot be written.
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
    add_output(parser)
    add_study(parser, Path("reproduce"))


def _run(arguments: argparse.Namespace) -> ExitCode:
    # matplotlib and the plant are needed here only
    from positioner.pictures.files import save  # noqa: PLC0415
    from positioner.studies.interpretations import NoiseKind, interpretations  # noqa: PLC0415
    from positioner.studies.published_results import assess  # noqa: PLC0415
    from positioner.studies.reproduce import SIMULATIONS, all_runs, reproduce  # noqa: PLC0415
    from positioner.studies.reproduce_pictures import FIGURE_OF, page_figure, simulation_figure  # noqa: PLC0415
    from positioner.studies.reproduce_report import blocks, to_json  # noqa: PLC0415

    both = (NoiseKind.FILTERED, NoiseKind.RAW)
    noises = both if arguments.reading == "both" else (NoiseKind(arguments.reading),)
    out: Path = arguments.out
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    played_runs = reproduce(all_runs(interpretations(noises), short=arguments.short), workers_of(arguments))
    found = assess(played_runs)
    text, values = blocks(played_runs, found), to_json(played_runs, found)
    with writing(out):
        for simulation in SIMULATIONS:
            figure = simulation_figure(simulation, played_runs, found)
            save(figure, out / f"figure-{FIGURE_OF[simulation]}.png")
        save(page_figure(played_runs, found), out / "reproduce.png")
        (out / "reproduce.md").write_text(markdown(text), encoding="utf-8")
        (out / "reproduce.json").write_text(values, encoding="utf-8")
    show_result(arguments, text, values)
    note(f"\n{out}: reproduce.png, figure-4.png to figure-8.png, the same as .svg, reproduce.md, reproduce.json")
    return ExitCode.OK
