"""Values of datasets 58 and 58b: memory maps where the file allows, arrays elsewhere."""

from __future__ import annotations

import io
from array import array
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ema.core.arrays import constant
from ema.core.errors import RecordingFormatError
from ema.io.uff.columns import convert_lines
from ema.io.uff.dataset58_header import Header58
from ema.io.uff.scan import COPY_AGAIN, Dataset, place
from ema.io.uff.text import line_numbers

_CHUNK_BYTES = 1 << 20
_LONGEST_LINE = 4096


def read_values(path: Path, dataset: Dataset) -> tuple[NDArray[np.float64] | None, NDArray[Any]]:
    """Read abscissa and values of a dataset 58.

    Returns
    -------
    abscissa : ndarray or None
        None where the header gives minimum and step.
    values : ndarray, shape (n_values,)
        Real or complex; a read-only memory map of the file where the payload is binary.

    Raises
    ------
    RecordingFormatError
        If an ASCII payload holds more or fewer values than the header states, or no numbers, or
        a binary one makes sense in the other byte order alone.
    """
    header = dataset.header
    assert header is not None
    if dataset.layout is None:
        return _split(header, _read_text(path, dataset, header))
    begin, _ = dataset.payload
    records: NDArray[Any] = np.memmap(
        path, dtype=dataset.layout, mode="r", offset=begin, shape=(header.n_values,)
    )
    check_byte_order(place(path, dataset.index, 2), records if header.even else records["value"])
    if header.even:
        return None, records
    with np.errstate(invalid="ignore"):  # signalling NaNs; whoever uses the abscissa checks it
        return records["abscissa"].astype(np.float64), records["value"]


def read_form(path: Path, dataset: Dataset) -> tuple[NDArray[np.float64] | None, NDArray[Any]]:
    """Read a dataset as `read_values` does, but leave out long text: NaN for every sample.

    Where its length does not fit the number of values, or the abscissa is among the numbers, it
    is read all the same.

    Raises
    ------
    RecordingFormatError
        As `read_values`.
    """
    header = dataset.header
    assert header is not None
    if dataset.layout is not None or not header.even or not dataset.is_equal_lines:
        return read_values(path, dataset)
    return None, constant(np.nan, (header.n_values,))


def _split(
    header: Header58, numbers: NDArray[np.float64]
) -> tuple[NDArray[np.float64] | None, NDArray[Any]]:
    """Separate abscissa and values, without a copy; real and imaginary part alternate."""
    table = numbers.reshape(header.n_values, header.numbers_per_value)
    parts = table if header.even else table[:, 1:]
    values = (parts.view(np.complex128) if header.is_complex else parts)[:, 0]
    values.setflags(write=False)
    return None if header.even else table[:, 0], values


def _read_text(path: Path, dataset: Dataset, header: Header58) -> NDArray[np.float64]:
    begin, end = dataset.payload
    where = place(path, dataset.index)
    widths = _widths(header)
    per_value = header.numbers_per_value
    expected = header.n_values * per_value
    # A number takes two bytes at least: no header makes this larger than four times the file.
    numbers = np.empty(min(expected, (end - begin) // 2 + 1))
    count = 0
    with path.open("rb") as file:
        file.seek(begin)
        while file.tell() < end:
            text = _some_lines(file, end)
            block = _convert(text, widths, where)
            room = numbers[count : count + len(block)]
            room[:] = block[: len(room)]
            count += len(block)
    if count != expected:
        found = f"{count // per_value} of {header.n_values} values"
        rule = "the file is truncated" if count < expected else "there are more than stated"
        raise RecordingFormatError(where, found, rule, COPY_AGAIN)
    return numbers


def _widths(header: Header58) -> tuple[int, ...]:
    """Columns of the numbers on a line: E13.5 and E20.12, abscissae always E13.5."""
    if not header.is_double:
        return (13,) * 6
    if header.even:
        return (20,) * 4
    return (13, 20, 20) if header.is_complex else (13, 20, 13, 20)


def _some_lines(file: BinaryIO, end: int) -> bytes:
    """Next part of a payload, up to the end of a line."""
    text = file.read(min(_CHUNK_BYTES, end - file.tell()))
    return text + file.readline(min(_LONGEST_LINE, end - file.tell()))


def _convert(text: bytes, widths: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Convert whole lines: equal ones at once, the last one apart because it may be shorter."""
    length = (text.find(b"\n") + 1) or len(text)
    end = len(text) - len(text) % length
    numbers = convert_lines(text[:end], length, widths)
    if numbers is None:
        return _irregular(text, widths, where)
    rest = text[end:]
    return np.append(numbers, _irregular(rest, widths, where)) if rest else numbers


def _irregular(text: bytes, widths: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Convert line by line: separated numbers, or touching ones cut by their columns."""
    numbers = array("d")
    for raw in io.BytesIO(text):
        line = raw.decode("latin-1")
        if len(line) > _LONGEST_LINE:
            found = f"a line of more than {_LONGEST_LINE} characters"
            rule = "lines of a dataset 58 must have 80 columns"
            raise RecordingFormatError(where, found, rule, COPY_AGAIN)
        numbers.extend(line_numbers(line, widths, where))
    return np.frombuffer(numbers, dtype=np.float64)


_LOOKED_AT = 1024
_FEWEST = 16  # values other than zero; fewer may be anything
_SENSIBLE = (1e-15, 1e15)  # of motion or force, in whatever unit


def check_byte_order(where: str, values: NDArray[Any]) -> None:
    """Refuse values that make sense in the other byte order alone.

    Parameters
    ----------
    where : str
        File and place of the byte order in it.
    values : ndarray, shape (n_values,)
        Real or complex, in the byte order stated; the beginning is looked at.

    Raises
    ------
    RecordingFormatError
        If most of them are too large or too small to be measured, and none is when swapped.
    """
    beginning = np.array(values[:_LOOKED_AT])
    stated = beginning.view(beginning.real.dtype)
    swapped = stated.byteswap()
    if _share_sensible(swapped) < 1.0 or _share_sensible(stated) > 0.5:
        return
    first = int(np.flatnonzero(stated)[0])
    found = f"values such as {stated[first]:.3g}, which is {swapped[first]:.3g} in the other order"
    rule = "the byte order is wrong: it must be 1 for little endian, 2 for big endian"
    raise RecordingFormatError(where, found, rule, "Correct the header or export the file again")


def _share_sensible(values: NDArray[Any]) -> float:
    """Share of the values other than zero that a sensor could have measured; 0 of too few."""
    with np.errstate(invalid="ignore"):  # signalling NaNs
        size = np.abs(values[values != 0].astype(np.float64))
    if size.size < _FEWEST:
        return 0.0
    low, high = _SENSIBLE
    return float(np.mean((size > low) & (size < high)))
