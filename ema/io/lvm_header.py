"""Headers of LabVIEW measurement files: ``.lvm``, text of National Instruments' write-to-file.

After the specification that National Instruments publishes ("Specification for the LabVIEW
Measurement File (.lvm)"): a header of the file and one of each segment, each ended by
``***End_of_Header***``, their lines a key and its values; then a line of names, then numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

from ema.errors import RecordingFormatError
from ema.io.columns import EXPORT_AGAIN
from ema.io.sampling import step_and_inverse

_FIRST_WORDS = "LabVIEW Measurement"
_END = "***End_of_Header***"
_MOST_LINES = 1000
_SPECIAL = ("***Start_Special***", "***End_Special***")
_SEPARATORS = {"tab": "\t", "comma": ","}
_X_COLUMNS = ("no", "one", "multi")


@dataclass(frozen=True)
class LvmHeader:
    """What the headers say about the first segment.

    Parameters
    ----------
    separator, decimal : str
        Of the cells and in numbers.
    x_columns : str
        ``"no"`` column of time, ``"one"``, or one for each channel: ``"multi"``.
    names, units : tuple of str
        Of the channels.
    n_samples : tuple of int
        Of the channels; empty where the file does not say.
    rate_hz : float
        Sampling rate by ``Delta_X``; NaN where the file does not say.
    first_line : int
        Line of the first numbers in the file, counted from 1.
    start : int
        Their first character.
    """

    separator: str
    decimal: str
    x_columns: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    n_samples: tuple[int, ...]
    rate_hz: float
    first_line: int
    start: int

    @property
    def columns(self) -> tuple[str, ...]:
        """Heading of each column of numbers: ``X_Value`` or that of a channel."""
        if self.x_columns == "multi":
            return tuple(text for name in self.names for text in ("X_Value", name))
        return "X_Value", *self.names


def read_lvm_header(where: str, text: str) -> LvmHeader:
    """Read the headers at the beginning of a file.

    Parameters
    ----------
    where : str
        Name of the file, for messages.
    text : str
        Its beginning, with both headers.

    Raises
    ------
    RecordingFormatError
        If they are missing, incomplete, or tell of something else than time series.
    """
    lines = text.split("\n", _MOST_LINES)
    if not lines[0].startswith(_FIRST_WORDS):
        rule = f"a file ending in .lvm begins with {_FIRST_WORDS!r}"
        raise RecordingFormatError(f"{where}, line 1", repr(lines[0][:20]), rule, EXPORT_AGAIN)
    ends = [number for number, line in enumerate(lines) if line.startswith(_END)][:2]
    if len(ends) < 2 or ends[1] + 2 >= len(lines):
        found = f"{len(ends)} lines {_END}"
        rule = "headers of the file and of a segment end so, and names and numbers follow"
        raise RecordingFormatError(where, found, rule, EXPORT_AGAIN)
    general = _Entries(where, lines[: ends[0]], _separator(where, lines[: ends[0]]))
    segment = _Entries(where, lines[ends[0] + 1 : ends[1]], general.separator)
    first = ends[1] + 2
    start = sum(len(line) + 1 for line in lines[:first])
    heading = lines[first - 1].rstrip("\r").split(general.separator)
    return _header(general, segment, heading, first + 1, start)


class _Entries:
    """Values of a header by their key."""

    def __init__(self, where: str, lines: list[str], separator: str) -> None:
        self.where = where
        self.separator = separator
        self._values: dict[str, list[str]] = {}
        is_special = False
        for line in lines:
            is_special = line.startswith(_SPECIAL[0]) or (
                is_special and not line.startswith(_SPECIAL[1])
            )
            key, *values = (cell.strip() for cell in line.split(separator))
            if key and not is_special:
                self._values.setdefault(key, values)

    def of_channels(self, key: str, n: int) -> list[str]:
        """Values for each channel; none where the file does not say."""
        values = self._values.get(key, [])[:n]
        return values if len(values) == n and all(values) else []

    def one(self, key: str, default: str) -> str:
        """A single value in lower case."""
        return (self._values.get(key) or [default])[0].lower() or default

    def fault(self, key: str, found: str, rule: str) -> RecordingFormatError:
        """Build the error about an entry."""
        return RecordingFormatError(f"{self.where}, {key}", found, rule, EXPORT_AGAIN)


def _separator(where: str, lines: list[str]) -> str:
    for line in lines:
        if line.startswith("Separator"):
            name = line[len("Separator") :].strip(" \t,;\r").lower()
            if name in _SEPARATORS:
                return _SEPARATORS[name]
            rule = f"it is one of {', '.join(_SEPARATORS)}"
            raise RecordingFormatError(f"{where}, Separator", repr(name), rule, EXPORT_AGAIN)
    return "\t"


def _header(
    general: _Entries, segment: _Entries, heading: list[str], first_line: int, start: int
) -> LvmHeader:
    decimal = general.one("Decimal_Separator", ".")
    x_columns = general.one("X_Columns", "one")
    if decimal not in (".", ",") or x_columns not in _X_COLUMNS:
        rule = "they are a point or comma, and no, one or multi"
        found = f"{decimal!r} and {x_columns!r}"
        raise general.fault("Decimal_Separator and X_Columns", found, rule)
    count = segment.one("Channels", "")
    stride = 2 if x_columns == "multi" else 1
    most = (len(heading) + stride - 2) // stride  # one X_Value stands before them, or before each
    if not count.isdecimal() or len(count) > 9 or not 0 < int(count) <= most:
        rule = f"it counts the channels, whose names are among the {len(heading)} below the header"
        raise segment.fault("Channels", repr(count), rule)
    n = int(count)
    return LvmHeader(
        separator=general.separator,
        decimal=decimal,
        x_columns=x_columns,
        names=tuple(cell.strip() for cell in heading[1 : 1 + stride * n : stride]),
        units=tuple(segment.of_channels("Y_Unit_Label", n) or [""] * n),
        n_samples=_n_samples(segment, n),
        rate_hz=_rate_hz(segment, n, decimal),
        first_line=first_line,
        start=start,
    )


def _n_samples(segment: _Entries, n: int) -> tuple[int, ...]:
    values = segment.of_channels("Samples", n)
    if not all(value.isdecimal() and len(value) < 16 for value in values):
        raise segment.fault("Samples", repr(values[:3]), "it counts the samples of each channel")
    return tuple(map(int, values))


def _rate_hz(segment: _Entries, n: int, decimal: str) -> float:
    dimensions = segment.of_channels("X_Dimension", n)
    if any(each.lower() != "time" for each in dimensions):
        rule = "FRFs are estimated from channels over time"
        raise segment.fault("X_Dimension", ", ".join(dict.fromkeys(dimensions)), rule)
    steps = dict.fromkeys(segment.of_channels("Delta_X", n))
    if not steps:
        return float("nan")
    try:
        rates = {step_and_inverse(step.replace(decimal, "."))[1] for step in steps}
    except ValueError as error:
        raise segment.fault(
            "Delta_X", str(error), "it is the time from sample to sample"
        ) from error
    if len(rates) > 1:
        rule = "channels of one run share one sampling rate"
        raise segment.fault("Delta_X", ", ".join(steps), rule)
    return rates.pop()
