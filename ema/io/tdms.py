"""Read LabVIEW TDMS files: the channels of all groups."""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.core.recording import ACCELERATION, FORCE
from ema.core.units import FREQUENCY, NAMES_KEPT, TIME, AxisUnit, is_stated, parse_axis, parse_unit
from ema.io.columns import Column, content_of_columns, name_and_unit
from ema.io.content import LEAVE_OUT, FileContent, check_stored, note, reading, remark, require
from ema.io.variables import stated_rate

if TYPE_CHECKING:
    from nptdms import TdmsChannel, TdmsFile

_TAG = b"TDSm"
_LITTLE_BYTES = 1 << 16  # that may be reserved for nothing
_LEAD_IN_BYTES = 28
_BIG_ENDIAN = 1 << 6  # of a segment's table of contents
_UNITS = ("unit_string", "NI_UnitDescription", "unit")


def read(path: Path) -> FileContent:
    """Read the time series of a TDMS file, with LabVIEW's scaling applied.

    `RecordingFormatError` if npTDMS is not installed, the file is missing, damaged or truncated, or
    its groups differ in rate or length.
    """
    library = require("nptdms", path)
    with reading(path, "a TDMS file"), _BoundedFile(path) as file:
        _check_segments(path, file)
        tdms = library.TdmsFile.open(file)
        channels = [channel for group in tdms.groups() for channel in group.channels()]
        for item in (tdms, *tdms.groups(), *channels):
            _check_scales(path, item.properties)
        usable = [each for each in channels if len(each) > 0 and each.dtype.kind in "iufM"]
        usable = _over_time(path, usable)
        wanted = _fastest(usable)
        samples = _samples(path, tdms, wanted)
        starts_s = _starts_s(wanted)
        places: dict[float, str] = {}  # of each different step
        for channel in wanted:
            places.setdefault(_step_s(channel), f"{channel.group_name}/{channel.name}/wf_increment")
        statements = {place: step_s for step_s, place in places.items() if math.isfinite(step_s)}
        properties = {
            f"{place}/{name}": value
            for place, item in enumerate((tdms, *tdms.groups(), *wanted))
            for name, value in item.properties.items()
        }
    findings = [
        remark(path, channel.name, Check.CONTENT, "no samples, not numeric, or not over time")
        for channel in channels
        if channel not in usable
    ]
    if slower := [each for each in usable if each not in wanted]:
        names = ", ".join(f"{each.group_name}/{each.name}" for each in slower)
        detail = f"{names}: slower than the other channels, or without a rate: left out"
        findings.append(note(path, Check.CONTENT, detail))
    rate = stated_rate(path, statements)
    columns = list(map(_column, wanted, samples, starts_s))
    return content_of_columns(path, columns, rate=rate, findings=findings, statements=properties)


class _BoundedFile(io.BufferedReader):
    """A file that never reserves more memory than it has bytes, whatever length is read."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.size = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and 0 <= size <= _LITTLE_BYTES:
            return super().read(size)
        left = max(self.size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


def _check_segments(path: Path, file: _BoundedFile) -> None:
    """Follow the segments up to the end: npTDMS reads a cut file without an error."""
    start = 0
    while start < file.size or start == 0:
        file.seek(start)
        lead_in = file.read(_LEAD_IN_BYTES)
        where = f"{path.name}, byte {start}"
        if not lead_in or lead_in[:4] != _TAG[: len(lead_in)]:
            rule = f"each segment of a TDMS file begins with {_TAG!r}"
            raise RecordingFormatError(where, repr(lead_in[:4]), rule, LEAVE_OUT)
        end = start + _LEAD_IN_BYTES
        if len(lead_in) == _LEAD_IN_BYTES:
            order = ">" if struct.unpack("<I", lead_in[4:8])[0] & _BIG_ENDIAN else "<"
            end += struct.unpack(f"{order}Q", lead_in[12:20])[0]
        if end > file.size:
            found = f"the file ends {end - file.size} bytes before its last segment does"
            raise RecordingFormatError(where, found, "it is cut short or was not closed", LEAVE_OUT)
        start = end
    file.seek(0)


def _check_scales(path: Path, properties: Mapping[str, Any]) -> None:
    """Refuse counts of scalings or coefficients, each one a property, beyond the properties."""
    for name, value in properties.items():
        counts = name == "NI_Number_Of_Scales" or (name.startswith("NI_Scale") and "_Size" in name)
        if counts and not 0 <= value <= len(properties):
            found = f"{name} is {value}, among {len(properties)} properties"
            rule = "each scaling and each coefficient is a property"
            raise RecordingFormatError(path.name, found, rule, LEAVE_OUT)


def _samples(path: Path, tdms: TdmsFile, channels: list[TdmsChannel]) -> list[NDArray[Any]]:
    """Scaled samples of all channels, in one pass over the file."""
    widths = [max(1, channel.data_type.size or 1) for channel in channels]
    n_claimed = sum(len(each) * width for each, width in zip(channels, widths, strict=True))
    check_stored(path.name, n_claimed, path.stat().st_size)
    arrays = [
        # Single precision is exact for converters of 16 bit.
        np.empty(len(each), np.float32 if each.dtype.kind == "f" and width <= 2 else each.dtype)
        for each, width in zip(channels, widths, strict=True)
    ]
    filled = [0] * len(channels)
    with np.errstate(over="ignore", invalid="ignore"):  # infinite is missing, not a warning
        for chunk in tdms.data_chunks():
            for index, channel in enumerate(channels):
                piece = chunk[channel.group_name][channel.name][:]
                arrays[index][filled[index] : filled[index] + len(piece)] = piece
                filled[index] += len(piece)
    for channel, array, count in zip(channels, arrays, filled, strict=True):
        if count != array.size:
            where, found = f"{path.name}, {channel.path}", f"{count} of {array.size} samples"
            raise RecordingFormatError(where, found, "the file is truncated", LEAVE_OUT)
    return arrays


def _axis_of(channel: TdmsChannel) -> AxisUnit | None:
    """Kind of a channel's axis by its unit or its name, and its factor; None where not known."""
    properties = channel.properties
    return _axis(str(properties.get("wf_xunit_string", "")), str(properties.get("wf_xname", "")))


@lru_cache(NAMES_KEPT)
def _axis(unit: str, name: str) -> AxisUnit | None:
    axis = parse_axis(unit) if is_stated(unit) else parse_axis(name) or AxisUnit(TIME, 1.0)
    return AxisUnit(FREQUENCY, 1.0) if axis and "freq" in name.lower() else axis


def _step_s(channel: TdmsChannel) -> float:
    """Time step of a channel; infinite where it has none: LabVIEW then writes 0."""
    axis = _axis_of(channel) or AxisUnit(TIME, 1.0)
    return float(channel.properties.get("wf_increment") or math.inf) * axis.factor


def _over_time(path: Path, channels: list[TdmsChannel]) -> list[TdmsChannel]:
    """Channels whose axis is time; others are over frequency, an angle or orders."""
    axes = [_axis_of(channel) for channel in channels]
    known = zip(channels, axes, strict=True)
    over_time = [channel for channel, axis in known if axis and axis.kind == TIME]
    if channels and not over_time:
        rule = "time series are read from TDMS"
        remedy = "Export channels over time, and FRFs as universal file or table"
        units = {str(each.properties.get("wf_xunit_string", "Hz")) for each in channels}
        found = f"channels over {', '.join(sorted(units))}"
        raise RecordingFormatError(path.name, found, rule, remedy)
    return over_time


def _fastest(channels: list[TdmsChannel]) -> list[TdmsChannel]:
    """Channels of the highest rate, without the slow ones and decimated copies beside them.

    A force or acceleration that has no copy at that rate stays: its other rate is an error.
    """
    steps = list(map(_step_s, channels))
    fast = [each for each, step in zip(channels, steps, strict=True) if step == min(steps)]
    names = {channel.name for channel in fast}
    slow = [each for each in channels if each not in fast and each.name not in names]
    units = (parse_unit(_column(channel, np.empty(0), 0.0).unit) for channel in slow)
    is_wanted = any(unit is not None and unit.quantity in (FORCE, ACCELERATION) for unit in units)
    return channels if is_wanted or (slow and len(fast) < 2) else fast


def _starts_s(channels: list[TdmsChannel]) -> list[float]:
    """Start of each channel after that of the first one; 0 where the file does not state it."""
    found = []
    first = next((each.properties.get("wf_start_time") for each in channels), None)
    for channel in channels:
        start = channel.properties.get("wf_start_time")
        since = 0.0
        if first is not None and start is not None:
            since = float((np.datetime64(start) - np.datetime64(first)) / np.timedelta64(1, "s"))
        axis = _axis_of(channel) or AxisUnit(TIME, 1.0)
        found.append(since + float(channel.properties.get("wf_start_offset") or 0.0) * axis.factor)
    return found


def _column(channel: TdmsChannel, samples: NDArray[Any], start_s: float) -> Column:
    if samples.dtype.kind == "M":  # time since the first stamp, exact for any date
        return Column("time", "s", (samples - samples[:1]) / np.timedelta64(1, "s"))
    name, unit = name_and_unit(channel.name)
    stated = next((channel.properties[key] for key in _UNITS if key in channel.properties), "")
    return Column(
        name, str(stated).strip() or unit, samples, f"{channel.group_name}/{name}", start_s
    )
