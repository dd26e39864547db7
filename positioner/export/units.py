"""The unit in which a signal is exported, and the name of its column. Pure."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

SI_UNITS: Mapping[str, tuple[str, float]] = {
    **{unit: ("m", factor) for unit, factor in (("km", 1e3), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6), ("µm", 1e-6))},
    **{unit: ("m/s", factor) for unit, factor in (("cm/s", 1e-2), ("mm/s", 1e-3))},
    **{
        unit: ("Pa", factor) for unit, factor in (("hPa", 1e2), ("mbar", 1e2), ("kPa", 1e3), ("bar", 1e5), ("MPa", 1e6))
    },
    "psi": ("Pa", 6894.757),
    **{
        unit: ("s", factor) for unit, factor in (("us", 1e-6), ("µs", 1e-6), ("ms", 1e-3), ("min", 60.0), ("h", 3600.0))
    },
    "kN": ("N", 1e3),
    "mV": ("V", 1e-3),
}
"""Unit of a DBC signal → its unit in SI, and the factor to it. Other units, and the mA of a loop current, are kept."""
UNIT_OF_SUFFIX: Mapping[str, str] = {"_m_per_s": "m/s", "_ma": "mA", "_pa": "Pa", "_m": "m"}
"""Unit of a field of the positioner's messages, by the suffix of its name; the longer suffixes first."""
_WORDS = {"%": "percent", "°": "deg", "µ": "u", "Ω": "Ohm", "²": "2", "³": "3"}


def column_name(message: str, signal: str, unit_in_dbc: str, unit: str) -> str:
    """Return `STEM_POSITION/Position_m` for the signal `Position_mm` that is exported in m."""
    old, new = _as_word(unit_in_dbc), _as_word(unit)
    bare = signal.removesuffix(f"_{old}") if old else signal
    return f"{message}/{bare}_{new}" if new else f"{message}/{bare}"


def _as_word(unit: str) -> str:
    """Return a unit in letters, digits and underscores: `m_per_s` for m/s."""
    for sign, word in _WORDS.items():
        unit = unit.replace(sign, word)
    return re.sub(r"\W+", "_", unit.replace("/", "_per_")).strip("_")
