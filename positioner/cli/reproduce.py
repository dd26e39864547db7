"""`positioner reproduce`: the paper's five simulations, beside what it claims of them. Shell."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from positioner.errors import ExitCode, StateError

_EPILOG = """\
examples:
  positioner reproduce                     every interpretation: about ten minutes of one core
  positioner reproduce --short             the moves, within half a minute: 15 ms a setpoint instead of 1 s, which
                                           judges no claim about what happens at rest
  positioner reproduce --reading A         white noise and a Kalman filter only

interpretations of the paper, where it leaves a choice:
  A           noise white, 2 % of the reading; position and speed from a Kalman filter
  B           each draw of the noise held for 10 ms; position raw, speed by differences
Both are played with α and β of eq. 22 in SI and in cm, and each with a control run without noise.

It leaves in the output directory: reproduce.png (everything on one page), figure-4.png to figure-8.png (the paper's
figures), reproduce.md (its claims beside what is seen, and the figures) and reproduce.json (the same for programs).
One of its runs, frame by frame over a bus: positioner bench --scenario paper-3
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "reproduce",
        help="play the paper's simulations beside its claims",
        description="Play the paper's five simulations, and set what is seen beside what the paper claims.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--reading", choices=("A", "B", "both"), default="both", help="of the noise (%(default)s)")
    parser.add_argument("--short", action="store_true", help="15 ms a setpoint: shows the moves, judges no rest")
    parser.add_argument("--workers", type=int, metavar="N", help="processes (one a core)")
    parser.add_argument(
        "--out", type=Path, default=Path("reproduce"), metavar="DIR", help="output directory (%(default)s)"
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> ExitCode:
    # matplotlib and the plant are needed here only
    from positioner.studies.interpretations import Noise, interpretations  # noqa: PLC0415
    from positioner.studies.published_results import assess  # noqa: PLC0415
    from positioner.studies.reproduce import SIMULATIONS, all_runs, reproduce  # noqa: PLC0415
    from positioner.studies.reproduce_pictures import FIGURE_OF, draw_figure, draw_page  # noqa: PLC0415
    from positioner.studies.reproduce_report import to_json, to_markdown  # noqa: PLC0415

    both = (Noise.FILTERED, Noise.RAW)
    noises = both if arguments.reading == "both" else (Noise(arguments.reading),)
    out: Path = arguments.out
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StateError(f"{out}: cannot be written: {error.strerror}") from error
    played_runs = reproduce(all_runs(interpretations(noises), short=arguments.short), arguments.workers)
    found = assess(played_runs)
    for simulation in SIMULATIONS:
        draw_figure(out / f"figure-{FIGURE_OF[simulation]}.png", simulation, played_runs, found)
    draw_page(out / "reproduce.png", played_runs, found)
    text = to_markdown(played_runs, found)
    (out / "reproduce.md").write_text(text, encoding="utf-8")
    (out / "reproduce.json").write_text(to_json(played_runs, found), encoding="utf-8")
    sys.stdout.write(text)
    sys.stdout.write(f"\n{out}: reproduce.png, figure-4.png to figure-8.png, reproduce.md, reproduce.json\n")
    return ExitCode.OK
