"""Values of datasets 58 and 58b: memory maps where the file allows, arrays elsewhere."""

from __future__ import annotations

import io
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.numerics import constant
from ema.core.units import is_stated, parse_axis
from ema.io.uff.dataset58_header import Header58
from ema.io.uff.scan import Dataset, damaged, line_numbers, place

_CHUNK_BYTES = 1 << 19
_LONGEST_LINE = 4096
# Check of the byte order.
_PROBED = 1024  # values at the beginning
_FEWEST = 16  # values other than zero; fewer may be anything
_SENSIBLE = (1e-15, 1e15)  # of motion or force, in whatever unit
_FORTRAN_TO_C = bytes.maketrans(b"Dde", b"EEE")


def read_values(
    path: Path, dataset: Dataset, *, form_only: bool = False
) -> tuple[NDArray[np.float64] | None, NDArray[Any]]:
    """Read abscissa (None where the header gives minimum and step) and values of a dataset 58.

    Values are real or complex, and a read-only memory map of the file where the payload is binary.
    With `form_only`, long text of equal lines and even spacing is not read: its samples are NaN.
    """
    header = dataset.header58
    if form_only and header.even and dataset.is_equal_lines:
        return None, constant(np.nan, (header.n_values,))
    if dataset.layout is None:
        return _split(header, _read_text(path, dataset, header))
    begin, _ = dataset.payload
    records: NDArray[Any] = np.memmap(
        path, dtype=dataset.layout, mode="r", offset=begin, shape=(header.n_values,)
    )
    _check_byte_order(place(path, dataset.index, 2), records if header.even else records["value"])
    if header.even:
        return None, records
    with np.errstate(invalid="ignore"):  # signalling NaNs; the abscissa is checked where used
        return records["abscissa"].astype(np.float64), records["value"]


def axis_factor(path: Path, dataset: Dataset, kind: str) -> float:
    """Factor from the unit of the abscissa to s or Hz (`kind`), which are taken where none is."""
    text = dataset.header58.abscissa.unit
    if not is_stated(text):
        return 1.0
    unit = parse_axis(text)
    if unit is None or unit.kind != kind:
        found, rule = f"unit {text!r} of the abscissa", f"it must be a unit of {kind}"
        raise damaged(place(path, dataset.index, 10), found, rule)
    return unit.factor


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
    widths, per_value = _widths(header), header.numbers_per_value
    blocks = []
    with path.open("rb") as file:
        file.seek(begin)
        while file.tell() < end:
            text = file.read(min(_CHUNK_BYTES, end - file.tell()))
            text += file.readline(min(_LONGEST_LINE, end - file.tell()))
            blocks.append(_convert(text, widths, where))
    numbers = blocks[0] if len(blocks) == 1 else np.concatenate([np.empty(0), *blocks])
    wanted = header.n_values * per_value
    surplus = len(numbers) - wanted
    if 0 < surplus < len(widths) and not numbers[wanted:].any():
        return numbers[:wanted]  # programs that fill the last line with zeros
    if surplus:
        rule = "the file is truncated" if surplus < 0 else "there are more than stated"
        raise damaged(where, f"{len(numbers) // per_value} of {header.n_values} values", rule)
    return numbers


def _widths(header: Header58) -> tuple[int, ...]:
    """Columns of the numbers on a line: E13.5 and E20.12, abscissae always E13.5."""
    if not header.is_double:
        return (13,) * 6
    if header.even:
        return (20,) * 4
    return (13, 20, 20) if header.is_complex else (13, 20, 13, 20)


def _convert(text: bytes, widths: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Convert complete lines: equal ones at once, and the last one, which may be shorter."""
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
            raise damaged(where, found, "lines of a dataset 58 must have 80 columns")
        numbers.extend(line_numbers(line, widths, where))
    return np.frombuffer(numbers, dtype=np.float64)


def _check_byte_order(where: str, values: NDArray[Any]) -> None:
    """Refuse values of which most are too large or small to be measured, and none if swapped."""
    beginning = np.array(values[:_PROBED])
    stated = beginning.view(beginning.real.dtype)
    swapped = stated.byteswap()
    if _share_sensible(swapped) < 1.0 or _share_sensible(stated) > 0.5:
        return
    first = int(np.flatnonzero(stated)[0])
    found = f"values such as {stated[first]:.3g}, which is {swapped[first]:.3g} in the other order"
    rule = "the byte order is wrong: it must be 1 for little endian, 2 for big endian"
    raise RecordingFormatError(where, found, rule, "Correct the header or export the file again")


def _share_sensible(values: NDArray[Any]) -> float:
    """Share of the values other than zero that can be measured; 0 of too few values."""
    with np.errstate(invalid="ignore"):  # signalling NaNs
        size = np.abs(values[values != 0].astype(np.float64))
    if size.size < _FEWEST:
        return 0.0
    low, high = _SENSIBLE
    return float(np.mean((size > low) & (size < high)))


def convert_lines(text: bytes, length: int, widths: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Convert lines of `length` bytes, ends included, with fields of the given `widths`.

    None where the lines do not have this form, with one number in each field.
    """
    line_width = sum(widths)
    if not text or len(text) % length or length <= line_width or b"_" in text:
        return None
    table = np.frombuffer(text, np.uint8).reshape(-1, length)
    tail = table[0, line_width:]
    if tail.tobytes().strip(b" \r\n") or not (table[:, line_width:] == tail).all():
        return None
    # One point in each field, most often in the same columns: Arrow takes no two in one field.
    points = np.flatnonzero(table[0, :line_width] == ord("."))
    alike = len(points) == len(widths) and (table[:, points] == ord(".")).all()
    if not alike and text.count(b".") != len(table) * len(widths):
        return None
    numbers = _by_arrow(table, widths)
    if numbers is None and (b"+-" not in text):
        plain = text.translate(_FORTRAN_TO_C).replace(b"E ", b"E+")
        numbers = _by_arrow(np.frombuffer(plain, np.uint8).reshape(-1, length), widths, " +")
    return numbers


def _by_arrow(
    table: NDArray[np.uint8], widths: tuple[int, ...], ahead: str = " "
) -> NDArray[np.float64] | None:
    """Numbers of the fields, without the characters that may stand `ahead` of them."""
    same = len(set(widths)) == 1
    numbers, begin = [], 0
    for width in [sum(widths)] if same else widths:
        fields = np.ascontiguousarray(table[:, begin : begin + width]).reshape(
            -1, widths[0] if same else width
        )
        begin += width
        if (fields[:, -1] <= ord(" ")).any():
            return None
        ends = np.arange(0, fields.size + 1, fields.shape[1], dtype=np.int32)
        buffers = [None, pa.py_buffer(ends), pa.py_buffer(fields.ravel())]
        texts = pa.Array.from_buffers(pa.string(), len(fields), buffers)
        try:
            found = pc.cast(pc.ascii_ltrim(texts, ahead), pa.float64())
        except pa.ArrowInvalid:
            return None  # reading number by number finds the faulty one
        numbers.append(found.to_numpy())
    return numbers[0] if same else np.column_stack(numbers).ravel()
