"""`python building/completions.py SHARE` writes completions of our commands where each shell looks for them.

It runs in the environment that has the programs.
"""

from __future__ import annotations

import sys
from pathlib import Path

from plant_emulator.cli import main as plant_emulator
from positioner.cli import main as positioner
from positioner.machine.completion import SHELLS, completion

PLACES = {
    "bash": "bash-completion/completions/{}",
    "zsh": "zsh/site-functions/_{}",
    "fish": "fish/vendor_completions.d/{}.fish",
}


def write(share: Path) -> None:
    """Write a file for each program and shell below `share`."""
    for parser in (positioner.build_parser(), plant_emulator.build_parser()):
        for shell in SHELLS:
            path = share / PLACES[shell].format(parser.prog)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(completion(parser, shell) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
