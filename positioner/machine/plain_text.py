"""Text for terminals that know fewer letters than we use: what they cannot show is written in other words. Shell."""

from __future__ import annotations

import codecs
import io
import sys

_HANDLER = "positioner.plain"
_IN_OTHER_WORDS = str.maketrans(
    {
        "α": "alpha",
        "β": "beta",
        "γ": "gamma",
        "Γ": "Gamma",
        "Δ": "d",
        "Σ": "sum ",
        "σ": "sigma",
        "ω": "omega",
        "µ": "u",
        "²": "^2",
        "³": "^3",
        "±": "+-",
        "×": "x",
        "·": "*",
        "√": "sqrt ",
        "≤": "<=",
        "≥": ">=",
        "→": "->",
        "↓": "v",
        "−": "-",
        "–": "-",
        "─": "-",
        "…": "...",
        "§": "section ",
        "ä": "ae",
        "ö": "oe",
        "ü": "ue",
        "Å": "A",
    }
)


def in_other_words(text: str) -> str:
    """Return `text` in ASCII; a letter without a substitute is a question mark."""
    return text.translate(_IN_OTHER_WORDS).encode("ascii", "replace").decode("ascii")


def speak_plainly() -> None:
    """Let the standard streams write in other words what their encoding does not know; without this they raise."""
    codecs.register_error(_HANDLER, _substitute)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def _substitute(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return in_other_words(error.object[error.start : error.end]), error.end
