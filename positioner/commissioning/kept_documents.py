"""What a kept result must hold so that others can read it: one shape for each kind of procedure. Pure.

A shape says what is read of a document; keys that it does not name are free, so that versions may add some. It is a
check, a list with the shape of each element, a tuple with one for each, or a dictionary by key: a key that ends with
`?` may be missing, and a report then says so.
"""

from __future__ import annotations

import math
from typing import Any

from positioner.health.reference import kept_preload_n


def check_document(kind: str, document: Any) -> None:
    """Check that a document is as its procedure writes it.

    Raises:
        ValueError: it is not; the message names the place.
    """
    _check(_COMMON, document, "document")
    _check(_KINDS.get(kind, {}), document, "document")
    if kind == "signature":
        kept_preload_n(document)
        _check_friction(document["quantities"], "sliding_n", "static_n")
    elif kind == "identify":
        _check_friction(document["configuration"]["valve"], "coulomb_friction_n", "static_friction_n")


def _check_friction(values: dict[str, float | None], sliding: str, static: str) -> None:
    low, high = values.get(sliding), values.get(static)
    if low is not None and high is not None and low > high:
        raise ValueError(f"holds a {sliding} above {static}")


def _check(shape: Any, value: Any, place: str) -> None:
    if isinstance(shape, dict):
        if not isinstance(value, dict):
            raise ValueError(f"holds no object at {place}")  # noqa: TRY004 - of the file
        for key, each in shape.items():
            name = key.removesuffix("?")
            if name in value:
                _check(each, value[name], f"{place}.{name}")
            elif name == key:
                raise ValueError(f"has no {place}.{name}")
    elif isinstance(shape, list | tuple):
        if not isinstance(value, list) or (isinstance(shape, tuple) and len(value) != len(shape)):
            raise ValueError(f"holds no such list at {place}")
        for number, each in enumerate(value):
            _check(shape[number] if isinstance(shape, tuple) else shape[0], each, f"{place}.{number}")
    elif not shape(value):
        raise ValueError(f"holds an impossible value at {place}")


def _real(value: Any) -> bool:
    return type(value) in {int, float} and math.isfinite(value)


def _number(value: Any) -> bool:
    """Whether it is a number, or None for one that was not measured."""
    return value is None or _real(value)


def _positive(value: Any) -> bool:
    return _real(value) and value > 0.0


def _positive_if_seen(value: Any) -> bool:
    return value is None or _positive(value)


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _flag(value: Any) -> bool:
    return isinstance(value, bool)


def _numbers_by_name(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_number, value.values()))


def _texts_by_name(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_text, value.values()))


def _none_or_stop(value: Any) -> bool:
    return value is None or (isinstance(value, dict) and _text(value.get("cause")) and _text(value.get("why")))


_ROW = {"name": _text, "unit": _text, "value": _number, "low?": _number, "high?": _number, "seen?": _flag}
_COMMON = {"valve": _text, "rows?": [_ROW], "remarks?": [_text], "travel_m?": (_real, _real, _real)}
_MEDIAN = {"median": _number}
_FIGURES = ("dead_time_s?", "t63_s?", "t98_s?", "overshoot?", "gain?")
_RESPONSE = {"size": _positive, "direction": _text, "time_s": [_real], "part": [_number]}
_KINDS: dict[str, dict[str, Any]] = {
    "identify": {
        "configuration": {
            "valve": {
                "spring_rate_n_per_m?": _positive,
                "bench_set_n?": _real,
                "coulomb_friction_n?": _positive,
                "static_friction_n?": _positive,
            }
        }
    },
    "signature": {
        "quantities": {"spring_n_per_m": _positive, "sliding_n": _positive, "static_n": _positive_if_seen},
        "rows": [_ROW],
        "sliding_friction_by_place": [(_real, _positive)],
        "breakaways?": [(_real, _real, _real)],
        "loop?": [{"pressure_ma": [_number], "position_m": [_number]}],
        "compared?": _flag,
        "beyond_limits?": [{"text": _text, "category": _text}],
    },
    "step-test": {
        "sizes": [
            {
                "size": _positive,
                "direction": _text,
                "t86_s": _MEDIAN,
                "responses?": _real,
                "moved?": _real,
                "region?": _text,
                **dict.fromkeys(_FIGURES, _MEDIAN),
            }
        ],
        "responses?": [_RESPONSE],
        "input?": _text,
        "broken?": [_text],
    },
    "stroke-test": {
        "verdict": _text,
        "cause?": _text,
        "stop": _none_or_stop,
        "findings": [{"limit": _text, "text?": _text}],
        "quantities?": _numbers_by_name,
        "units?": _texts_by_name,
        "trace?": [(_number, _number, _number)],
        "suspects?": [_text],
    },
}
