"""Text for terminals that cannot show every character: those characters are written in ASCII. Shell.

With LC_ALL=C, or in a terminal whose TERM is dumb, everything is ASCII; Python itself would write UTF-8 (PEP 540).
"""

from __future__ import annotations

import codecs
import io
import os
import sys
import unicodedata
from typing import TextIO

from positioner.errors import visible

_HANDLER = "positioner.plain"
_ASCII = str.maketrans(
    {
        "α": "alpha", "β": "beta", "γ": "gamma", "Γ": "Gamma", "Δ": "d", "η": "eta", "θ": "theta", "λ": "lambda",
        "μ": "u", "π": "pi", "ρ": "rho", "Σ": "sum ", "σ": "sigma", "τ": "tau", "φ": "phi", "ω": "omega", "Ω": "Ohm",
        "µ": "u", "²": "^2", "³": "^3", "±": "+-", "×": "x", "·": "*", "√": "sqrt ", "≤": "<=", "≥": ">=", "≈": "~",
        "→": "->", "←": "<-", "↑": "^", "↓": "v", "−": "-", "–": "-", "─": "-", "…": "...", "§": "section ",
        "°": "deg", "∞": "inf", "ä": "ae", "ö": "oe", "ü": "ue", "Å": "A",
    }
)  # fmt: skip


def to_ascii(text: str) -> str:
    """Return `text` in ASCII; a character without a substitute becomes a question mark."""
    known = text.translate(_ASCII)
    # an accent, a subscript, a narrow space: the character that it is a form of
    plain = "".join(_base(each) for each in known) if not known.isascii() else known
    return plain.encode("ascii", "replace").decode("ascii")


def _base(character: str) -> str:
    form = unicodedata.normalize("NFKD", character)[0]
    return form if form.isascii() else character


def showable(text: str, stream: TextIO) -> str:
    """Return `text` as `visible`, in ASCII where the stream cannot take all of its characters."""
    text = visible(text)
    try:
        text.encode(getattr(stream, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        return to_ascii(text)
    return text


def replace_unknown_characters() -> None:
    """Let the standard streams write characters that their encoding lacks in ASCII; without this they raise."""
    codecs.register_error(_HANDLER, _substitute)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="ascii" if _is_ascii(stream) else None, errors=_HANDLER)


def _is_ascii(stream: TextIO) -> bool:
    if os.environ.get("PYTHONIOENCODING") or os.environ.get("PYTHONUTF8") == "1":  # the person has said more
        return False
    return os.environ.get("LC_ALL") in {"C", "POSIX"} or (os.environ.get("TERM") == "dumb" and stream.isatty())


def _substitute(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return to_ascii(error.object[error.start : error.end]), error.end
