"""Equally long lines of right-aligned numbers, converted all at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from ema.io.content import arrow_reader

_SIGNS = {b" ", b"+", b"-"}
_EXPONENT_LETTERS = {b"E", b"e", b"D", b"d"}
_MOST_DIGITS = 15  # such integers are exact in double precision
_LARGEST_POWER = 22  # 10²² is the largest power of ten that is exact in double precision
_POWERS_OF_TEN = np.array([float(f"1e{power}") for power in range(_LARGEST_POWER + 1)])
_PAIRINGS: tuple[tuple[Any, int], ...] = (
    (np.uint8, 10),
    (np.uint16, 100),
    (np.uint32, 10_000),
    (np.float64, 100_000_000),
)
_D_TO_E = bytes.maketrans(b"Dd", b"Ee")


@dataclass(frozen=True)
class _Columns:
    """Where the parts of a number such as ``-1.23456E+05`` stand in its field."""

    sign: int
    digits: tuple[int, ...]
    n_decimals: int
    point: int
    letter: int
    exponent_sign: int
    exponent_digits: tuple[int, ...]


def convert_lines(text: bytes, length: int, widths: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Convert lines of `length` bytes, each with as many fields as `widths` says.

    Every number is what ``float`` makes of its text, to the last bit: a mantissa of at most 15
    digits times or divided by a power of ten up to 10²² needs one rounding only (Clinger 1990,
    "How to read floating point numbers accurately").

    Parameters
    ----------
    text : bytes
        Whole lines, with their ends.
    length : int
        Bytes of a line, with its end.
    widths : tuple of int
        Columns of the fields on a line.

    Returns
    -------
    ndarray, shape (n_lines · n_fields,), or None
        None where the lines are not of this form.
    """
    line_width = sum(widths)
    if not text or len(text) % length or length <= line_width:
        return None
    table = np.frombuffer(text, np.uint8).reshape(-1, length)
    tail = table[0, line_width:]
    if tail.tobytes().strip(b" \r\n") or not (table[:, line_width:] == tail).all():
        return None
    if len(set(widths)) == 1:
        return _convert_fields(table[:, :line_width].reshape(-1, widths[0]))
    ends = np.cumsum(widths).tolist()
    columns = [
        _convert_fields(table[:, end - width : end])
        for end, width in zip(ends, widths, strict=True)
    ]
    found = [column for column in columns if column is not None]
    return np.column_stack(found).ravel() if len(found) == len(widths) else None


def _convert_fields(fields: NDArray[np.uint8]) -> NDArray[np.float64] | None:
    """Numbers of fields of one width, (n_fields, width)."""
    columns = _find_columns(fields[0].tobytes())
    values = None if columns is None else _by_arithmetic(fields, columns)
    return _by_arrow(fields) if values is None else values


def _find_columns(field: bytes) -> _Columns | None:
    """Columns of sign, digits, point and exponent; None for any other way to write a number."""
    point = field.find(b".")
    letter = next((k for k in range(len(field)) if field[k : k + 1] in _EXPONENT_LETTERS), -1)
    decimals = range(point + 1, letter)
    exponent = range(letter + 2, len(field))
    if point < 2 or not 0 < len(decimals) < _MOST_DIGITS or not 1 <= len(exponent) <= 3:
        return None
    return _Columns(
        sign=point - 2,
        digits=(point - 1, *decimals),
        n_decimals=len(decimals),
        point=point,
        letter=letter,
        exponent_sign=letter + 1,
        exponent_digits=tuple(exponent),
    )


def _by_arithmetic(fields: NDArray[np.uint8], at: _Columns) -> NDArray[np.float64] | None:
    """Numbers from their digits; None if a field has something else in one of the columns."""
    by_column = np.ascontiguousarray(fields.T)
    negative = _is_negative(by_column[at.sign])
    downwards = _is_negative(by_column[at.exponent_sign])
    digits = by_column - np.uint8(ord("0"))  # what lies below "0" wraps around, beyond 9
    places = [*at.digits, *at.exponent_digits]
    if (
        negative is None
        or downwards is None
        or any(digits[place].max() > 9 for place in places)
        or (by_column[: at.sign] != ord(" ")).any()
        or (by_column[at.point] != ord(".")).any()
        or not _one_of(by_column[at.letter], _EXPONENT_LETTERS)
    ):
        return None
    power = _whole_numbers(digits, at.exponent_digits).astype(np.int16)
    np.negative(power, out=power, where=downwards)
    power -= at.n_decimals
    values = _whole_numbers(digits, at.digits).astype(np.float64)
    far = (np.abs(power) > _LARGEST_POWER) & (values != 0.0)
    if power.max() > 0:
        values *= _POWERS_OF_TEN[np.clip(power, 0, _LARGEST_POWER)]
    values /= _POWERS_OF_TEN[np.clip(-power, 0, _LARGEST_POWER)]
    np.negative(values, out=values, where=negative)
    if far.any():
        exact = _by_arrow(fields[far])
        if exact is None:
            return None
        values[far] = exact
    return values


def _is_negative(column: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
    """Where a minus stands; None if something else than a sign or a blank stands anywhere."""
    return column == ord("-") if _one_of(column, _SIGNS) else None


def _one_of(column: NDArray[np.uint8], allowed: set[bytes]) -> bool:
    left = np.ones(len(column), dtype=np.bool_)
    for each in allowed:
        left &= column != ord(each)
        if not left.any():
            return True
    return False


def _whole_numbers(digits: NDArray[np.uint8], places: tuple[int, ...]) -> NDArray[Any]:
    """Read columns of digits as one number: neighbours are paired until one column is left."""
    parts: list[NDArray[Any]] = [digits[place] for place in places]
    for kind, base in _PAIRINGS:
        if len(parts) == 1:
            break
        odd = len(parts) % 2
        pairs = zip(parts[odd::2], parts[odd + 1 :: 2], strict=True)
        parts = parts[:odd] + [high.astype(kind) * kind(base) + low for high, low in pairs]
    return parts[0]


def _by_arrow(fields: NDArray[np.uint8]) -> NDArray[np.float64] | None:
    """Numbers written in any way Arrow understands, one in each field; else None."""
    n_fields, width = fields.shape
    if (fields[:, -1] == ord(" ")).any() or not (
        np.count_nonzero(fields == ord("."), axis=1) == 1
    ).all():
        return None
    column = np.full((n_fields, width + 1), ord("\n"), np.uint8)
    column[:, :width] = fields

    options = pa.csv.ConvertOptions(column_types={"value": pa.float64()}, null_values=[])
    try:
        parsed = pa.csv.read_csv(
            arrow_reader(column.tobytes().translate(_D_TO_E)),
            read_options=pa.csv.ReadOptions(column_names=["value"]),
            convert_options=options,
        )
    except pa.ArrowInvalid:
        return None  # an oddity somewhere: number by number tells which
    values: NDArray[np.float64] = parsed.column(0).to_numpy()
    return values if len(values) == n_fields else None
