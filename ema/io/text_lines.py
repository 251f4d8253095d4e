"""Lines at the beginning of a text file that hold something."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from ema.io.text_source import TextSource

_MOST_LINES = 2000  # blank ones too
_MOST_JOINED = 10  # lines of one row, in whose quoted names lines break
_OPEN_QUOTE = re.compile(r"(?:^|[\t;,|])[ ]*\"[^\"]*$")
_RULE = " \t\r\x1a,;|+-=_*#"  # what rules between header and numbers are made of


@dataclass(frozen=True)
class Line:
    """A line, or several that a quoted cell joins.

    Parameters
    ----------
    text : str
        Without its end.
    number : int
        In the file, counted from 1.
    start : int
        Its first character in the beginning of the file.
    """

    text: str
    number: int
    start: int


def lines_of(source: TextSource) -> Iterator[Line]:
    """Lines that hold something; one whose quoted cell goes on in the next is one with that."""
    text, start, number = source.head, 0, 1
    while start < len(text) and number <= _MOST_LINES:
        end = _line_end(text, start)
        joined = end
        for _ in range(_MOST_JOINED):
            if joined >= len(text) or not _OPEN_QUOTE.search(_last_line(text, start, joined)):
                break
            joined = _line_end(text, joined)
            if text.count('"', start, joined) % 2 == 0:
                end = joined
                break
        if end == len(text) and not source.is_whole and text[-1] != "\n":
            return  # the head ends within this line
        line = text[start:end].rstrip("\r\n")
        if line.strip(_RULE):
            yield Line(line, number, start)
        number += text.count("\n", start, end)
        start = end


def _line_end(text: str, start: int) -> int:
    return text.find("\n", start) + 1 or len(text)


def _last_line(text: str, start: int, end: int) -> str:
    """The line in which a quotation mark may stand open, or nothing where none does."""
    line = text[start:end].rstrip("\r\n")
    return line if line.count('"') % 2 else ""
