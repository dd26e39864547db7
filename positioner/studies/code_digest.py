"""Digests of the code that a study runs: a stored result is of the same code, and so is every worker. Shell."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

import plant_emulator
import positioner
from positioner.inputs.plug_in import Kind
from positioner.inputs.plug_in_digest import plug_in_digest
from positioner.laws.registry import is_outside
from positioner.wire.codec import packaged_dbc_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


class HasLaw(Protocol):
    """An item of a study; `physics`, if it has that, is the name of its plant's own physics."""

    @property
    def law(self) -> str:
        """Name of the law."""


T = TypeVar("T", bound=HasLaw)

UNUSED_ROOMS = frozenset(
    ("campaign", "cli", "conformance", "doctor", "host", "pictures", "replay", "robustness", "runtime", "store")
)
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


_FOLDERS = {
    "nmpc": ("nmpc",),
    "quasi-static": ("nmpc",),
    "paper": ("paper",),
}
"""Folders of `laws` whose code a law runs, by the beginning of its name."""
_OTHERS = ("rivals",)
"""Of a law whose name begins otherwise."""
_OF_LAWS = frozenset((*_OTHERS, *(folder for folders in _FOLDERS.values() for folder in folders)))


def _folders_of(law: str) -> tuple[str, ...]:
    """Return the folders of `laws` whose code a law runs, all of them for a law from outside, which may use any."""
    if is_outside(law) and not law.startswith("nmpc"):
        return tuple(_OF_LAWS)
    return next((folders for begins, folders in _FOLDERS.items() if law.startswith(begins)), _OTHERS)


def code_digest(law: str) -> str:
    """Return a digest of everything that a bout of `law` depends on: sources, presets and its tuned parameters.

    Of a law from outside it covers the source of that law, too.
    """
    of_law = _folders_of(law)

    def is_used(within: Path) -> bool:
        room, folders = within.parts[0], within.parts[:-1]
        is_of_another_law = "tuned" in folders and within.stem != law.replace("-", "_")
        if folders[:1] == ("laws",) and folders[1:2] and folders[1] in _OF_LAWS:
            is_of_another_law = folders[1] not in of_law
        return (
            room not in UNUSED_ROOMS and within.stem in USED_MODULES.get(room, {within.stem}) and not is_of_another_law
        )

    own = plug_in_digest(Kind.LAW, law) if is_outside(law) else ""
    return _digest(is_used, own)


def own_code(item: object) -> str:
    """Return a digest of the source of an item's `physics`, where its plant has physics of its own; else nothing."""
    physics = getattr(item, "physics", "")
    return plug_in_digest(Kind.PLANT, physics) if physics else ""


def code_of_each(items: Sequence[T], of_law: Mapping[str, str]) -> list[str]:
    """Return for each item a digest of the code on which its result depends.

    of_law: that of its law, by name. To it comes that of its own physics, where its plant has some.
    """
    own: dict[str, str] = {}
    found = []
    for item in items:
        physics = getattr(item, "physics", "")
        if physics not in own:
            own[physics] = own_code(item)
        found.append(of_law[item.law] + own[physics])
    return found


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
