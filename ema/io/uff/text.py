"""Lines and numbers of those datasets of a universal file that are plain text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ema.core.errors import RecordingFormatError
from ema.io.uff.dataset58_header import parse_number
from ema.io.uff.scan import COPY_AGAIN, Dataset, place

_LARGEST = 2**53  # beyond, not every whole number is a float


def text_lines(path: Path, dataset: Dataset) -> list[str]:
    """Lines of a dataset behind its number, up to its closing delimiter."""
    with path.open("rb") as file:
        file.seek(dataset.start)
        text = file.read(dataset.stop - dataset.start).decode("latin-1")
    return [line.rstrip("\r") for line in text.rstrip().split("\n")[2:-1]]


def line_numbers(line: str, widths: Sequence[int], where: str) -> list[float]:
    """Numbers of a line: separated ones, or touching ones cut by the widths of their columns.

    Raises
    ------
    RecordingFormatError
        If a column holds no number, or something follows behind the last one.
    """
    try:
        return [parse_number(word) for word in line.split()]
    except ValueError:
        return _by_columns(line.rstrip(), widths, where)


def as_integers(numbers: Sequence[float], where: str) -> list[int]:
    """Whole numbers, e.g. labels of nodes.

    Raises
    ------
    RecordingFormatError
        If one of them is none.
    """
    for number in numbers:
        if not number.is_integer() or abs(number) > _LARGEST:
            rule = "labels and codes are whole numbers"
            raise RecordingFormatError(where, f"{number:g}", rule, COPY_AGAIN)
    return [int(number) for number in numbers]


class Lines:
    """The lines of a dataset, read one after the other.

    Parameters
    ----------
    path : Path
        The file.
    dataset : Dataset
        From `ema.io.uff.scan.scan`.
    """

    def __init__(self, path: Path, dataset: Dataset) -> None:
        self._path, self._index = path, dataset.index
        self._lines = text_lines(path, dataset)
        self._next = 0

    @property
    def where(self) -> str:
        """The line read last, as messages name it."""
        return place(self._path, self._index, self._next + 2)

    def more(self) -> bool:
        """Whether anything but blank lines is left."""
        while self._next < len(self._lines) and not self._lines[self._next].strip():
            self._next += 1
        return self._next < len(self._lines)

    def text(self) -> str:
        """Next line as it is.

        Raises
        ------
        RecordingFormatError
            If there is none.
        """
        self._next += 1
        if self._next > len(self._lines):
            found, rule = "the end of the dataset", "its definition asks for one more line"
            raise RecordingFormatError(self.where, found, rule, COPY_AGAIN)
        return self._lines[self._next - 1]

    def numbers(self, widths: Sequence[int], least: int) -> list[float]:
        """Numbers on the next line, at least as many as said.

        Raises
        ------
        RecordingFormatError
            If there are fewer, or something else.
        """
        numbers = line_numbers(self.text(), widths, self.where)
        if len(numbers) < least:
            rule = f"the line holds {least} numbers"
            raise RecordingFormatError(self.where, f"{len(numbers)} numbers", rule, COPY_AGAIN)
        return numbers

    def integers(self, least: int) -> list[int]:
        """Whole numbers on the next line, in columns of ten; see `numbers`."""
        return as_integers(self.numbers((10,) * 8, least), self.where)


def _by_columns(text: str, widths: Sequence[int], where: str) -> list[float]:
    numbers, begin = [], 0
    for width in widths:
        if begin >= len(text):
            break
        field = text[begin : begin + width]
        try:
            numbers.append(parse_number(field))
        except ValueError:
            rule = f"columns {begin + 1} to {begin + width} must be a number"
            raise RecordingFormatError(where, repr(field), rule, COPY_AGAIN) from None
        begin += width
    if text[begin:].strip():
        found = repr(text[begin:].strip()[:20])
        rule = f"nothing may follow column {begin}"
        raise RecordingFormatError(where, found, rule, COPY_AGAIN)
    return numbers
