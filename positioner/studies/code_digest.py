"""Digests of the code that a study runs: a stored result is of the same code, and so is every worker. Shell."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import plant_emulator
import positioner
from positioner.inputs.plug_in import Kind
from positioner.inputs.plug_in_digest import plug_in_digest
from positioner.laws.registry import is_outside
from positioner.wire.codec import packaged_dbc_text

if TYPE_CHECKING:
    from collections.abc import Callable

UNUSED_ROOMS = frozenset(("campaign", "cli", "conformance", "doctor", "host", "pictures", "replay", "runtime", "store"))
"""Rooms whose code no bout runs."""
USED_MODULES = {
    "bench": frozenset(
        (
            *(
                "columns",
                "configure",
                "frame_log",
                "inprocess",
                "metrics",
                "modes",
                "own_plant",
                "playable",
                "recording",
                "scenario",
            ),
            *("sensor_noise", "setpoint_file", "setpoints"),
        )
    ),
    "studies": frozenset(
        ("bouts", "conditions", "direct", "entrants", "identification", "identified_plant", "league", "tuned", "valves")
    ),
}
"""Modules that a bout runs, for each room of which it runs only some."""


def code_digest(law: str) -> str:
    """Return a digest of everything that a bout of `law` depends on: sources, presets and its tuned parameters.

    Of a law from outside it covers the source of that law, too.
    """

    def is_used(within: Path) -> bool:
        room = within.parts[0]
        is_of_another_law = "tuned" in within.parts[:-1] and within.stem != law.replace("-", "_")
        return (
            room not in UNUSED_ROOMS and within.stem in USED_MODULES.get(room, {within.stem}) and not is_of_another_law
        )

    own = plug_in_digest(Kind.LAW, law) if is_outside(law) else ""
    return _digest(is_used, own)


@lru_cache(maxsize=1)
def whole_digest() -> str:
    """Return a digest of everything that any study may run."""
    return _digest(lambda _within: True)


def _digest(is_used: Callable[[Path], bool], own: str = "") -> str:
    # the DBC lies beside the package in a source tree, and in it where it is installed
    digest = hashlib.sha256(packaged_dbc_text().encode() + own.encode())
    for package in (positioner, plant_emulator):
        root = Path(str(package.__file__)).parent
        for path in sorted(root.rglob("*")):
            within = path.relative_to(root)
            if path.suffix in {".py", ".toml"} and is_used(within):
                digest.update(str(within).encode() + path.read_bytes())
    return digest.hexdigest()
