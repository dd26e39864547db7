"""The units of a workshop: pressures in psi, bar or kPa, areas in square inches, written and read. Pure."""

from __future__ import annotations

import re
from types import MappingProxyType
from typing import TYPE_CHECKING

from positioner.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

PASCALS: Mapping[str, float] = MappingProxyType({"psi": 6894.757293168, "bar": 1e5, "kPa": 1e3, "Pa": 1.0})
_SQUARE_METRES = MappingProxyType({"in2": 0.0254 * 0.0254, "cm2": 1e-4, "m2": 1.0})
_NUMBER = r"(\d+(?:[.,]\d*)?)"
_SPAN_MA = 16.0


def pressure_gain(text: str) -> float:
    """Return K_p in Pa/mA of an I/P converter whose range is given like `3-15psi` or `0.2-1bar`, at 4 and 20 mA.

    Raises:
        UsageError: the text is no range of pressure.
    """
    found = re.fullmatch(rf"\s*{_NUMBER}\s*-\s*{_NUMBER}\s*({'|'.join(PASCALS)})\s*", text, re.IGNORECASE)
    if found is None or _number(found[2]) <= _number(found[1]):
        raise UsageError(f"--ip-range {text!r} is no range of pressure: write it like 3-15psi or 0.2-1bar")
    return (_number(found[2]) - _number(found[1])) * _unit(found[3], PASCALS) / _SPAN_MA


def area_m2(text: str) -> float:
    """Return the area in m² of a text like `100in2` or `645cm2`.

    Raises:
        UsageError: the text is no area.
    """
    found = re.fullmatch(rf"\s*{_NUMBER}\s*({'|'.join(_SQUARE_METRES)})\s*", text, re.IGNORECASE)
    if found is None or _number(found[1]) == 0.0:
        raise UsageError(f"--area {text!r} is no area: write it like 100in2 or 645cm2")
    return _number(found[1]) * _unit(found[2], _SQUARE_METRES)


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def _unit(name: str, units: Mapping[str, float]) -> float:
    """Return the unit of this name, large or small letters alike."""
    return next(value for key, value in units.items() if key.lower() == name.lower())
