"""Text for terminals that cannot show every character: those characters are written in ASCII. Shell."""

from __future__ import annotations

import codecs
import io
import sys

_HANDLER = "positioner.plain"
_ASCII = str.maketrans(
    {
        "α": "alpha", "β": "beta", "γ": "gamma", "Γ": "Gamma", "Δ": "d", "Σ": "sum ", "σ": "sigma", "ω": "omega",
        "µ": "u", "²": "^2", "³": "^3", "±": "+-", "×": "x", "·": "*", "√": "sqrt ", "≤": "<=", "≥": ">=", "→": "->",
        "↓": "v", "−": "-", "–": "-", "─": "-", "…": "...", "§": "section ", "ä": "ae", "ö": "oe", "ü": "ue", "Å": "A",
    }
)  # fmt: skip


def to_ascii(text: str) -> str:
    """Return `text` in ASCII; a character without a substitute becomes a question mark."""
    return text.translate(_ASCII).encode("ascii", "replace").decode("ascii")


def replace_unknown_characters() -> None:
    """Let the standard streams write characters that their encoding lacks in ASCII; without this they raise."""
    codecs.register_error(_HANDLER, _substitute)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def _substitute(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return to_ascii(error.object[error.start : error.end]), error.end
