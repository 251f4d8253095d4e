"""Texts from files, as people and programs may be shown them: nothing in them acts."""

from __future__ import annotations

import re
from typing import Any

# C0 and C1 controls, line and paragraph separators, lone surrogates (bytes of file names that are
# no text), and marks that are not seen but turn the reading direction. Tabs and line ends stay.
_HIDDEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)
# What spreadsheets take for the start of a formula, behind quotes and blanks too.
# https://owasp.org/www-community/attacks/CSV_Injection
_FORMULA = re.compile(r"[\s\"']*[=+\-@\t＝＋－＠]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def visible(text: str) -> str:
    """A text in which characters that are not seen but act are named: ESC is ``[U+001B]``."""
    return _HIDDEN.sub(lambda found: f"[U+{ord(found[0]):04X}]", text)


def visible_line(text: str) -> str:
    """The same in one line, without anything else that cannot be printed."""
    return "".join(
        sign if sign.isprintable() else " " if sign.isspace() else f"[U+{ord(sign):04X}]"
        for sign in text
    )


def escaped(json_text: str) -> str:
    """JSON in which such characters are escaped: what is read is the same, what is seen is not."""
    return _HIDDEN.sub(lambda found: f"\\u{ord(found[0]):04x}", json_text)


def inert(value: Any) -> Any:
    """A cell of a table that a spreadsheet takes for a text; what is no text stays as it is.

    A text that starts like a formula gets an apostrophe in front, which `original` takes away.
    """
    if not isinstance(value, str):
        return value
    shown = visible(value)
    return f"'{shown}" if _FORMULA.match(shown) and not _NUMBER.fullmatch(shown) else shown


def original(cell: str) -> str:
    """The text that `inert` put an apostrophe in front of; any other as it is."""
    text = cell[1:]
    return text if cell.startswith("'") and inert(text) == cell else cell
