"""Output on consoles that lack characters: these are written otherwise, and nothing fails."""

from __future__ import annotations

import codecs
import sys

_HANDLER = "ringmodal"
_SUPERSCRIPTS = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"
_AS_DIGITS = str.maketrans(_SUPERSCRIPTS, "-0123456789")
_OTHERWISE = {
    "−": "-",
    "±": "+/-",
    "×": "x",
    "→": "->",
    "…": "...",
    "–": "-",
    "≥": ">=",
    "≤": "<=",
    "°": " deg",
    "²": "^2",
    "³": "^3",
    "─": "-",
}


def tolerant_output() -> None:
    """Let standard output and error replace what their encoding lacks."""
    codecs.register_error(_HANDLER, _replaced)
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)  # a notebook's streams have none
        if reconfigure is not None:
            reconfigure(errors=_HANDLER)


def lacking(encoding: str, characters: str = "±×→−⁶°²") -> str:
    """Characters of results that an encoding lacks."""
    return "".join(sign for sign in characters if not _has(encoding, sign))


def _has(encoding: str, sign: str) -> bool:
    try:
        sign.encode(encoding)
    except UnicodeEncodeError:
        return False
    return True


def _replaced(error: UnicodeError) -> tuple[str, int]:
    """Write the signs that cannot be encoded with others: an exponent stays an exponent."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    signs = error.object[error.start : error.end]
    before = error.object[error.start - 1 : error.start]
    text = ""
    for sign in signs:
        if sign in _SUPERSCRIPTS:
            text += ("" if before in tuple(_SUPERSCRIPTS) else "^") + sign.translate(_AS_DIGITS)
        else:
            text += _OTHERWISE.get(sign, "?")
        before = sign
    return text, error.end
