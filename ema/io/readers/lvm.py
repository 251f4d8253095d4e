"""Read LabVIEW measurement files, ``.lvm``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.errors import RecordingFormatError
from ema.io.columns import EXPORT_AGAIN, Column, content_of_columns
from ema.io.content import FileContent, remark
from ema.io.lvm_header import LvmHeader, read_lvm_header
from ema.io.text_layout import Dialect, Layout
from ema.io.text_source import open_text
from ema.io.text_table import Cells, missing_samples, read_cells
from ema.quality import Finding

SUFFIXES = (".lvm",)
_NEXT_HEADER = re.compile(
    rb"^(?:Channels|Test_|UUT_|Model_Number|Serial_Number|Notes|\*\*\*)", re.MULTILINE
)


def read(path: Path) -> FileContent:
    """Read the first segment of a LabVIEW measurement file.

    The rate follows from ``Delta_X``, and where the file has a column of time, from that too.
    Comments beside the numbers are left out. A file may hold several segments, one for each time
    LabVIEW was started or triggered: they are events of their own, not one longer recording, so
    those after the first are left out, and a finding says so.

    Raises
    ------
    RecordingFormatError
        If headers are missing or faulty, there are fewer or more rows than they say, a cell is no
        number, or time is uneven.
    """
    with open_text(path) as source:
        header = read_lvm_header(path.name, source.head)
        dialect = Dialect(header.separator, header.decimal)
        columns = header.columns
        layout = Layout(dialect, columns, ("",) * len(columns), header.first_line, header.start)
        has_time = header.x_columns != "no"
        wanted = range(0 if has_time else 1, len(columns))
        segment = _Segment(source.sections(header.start))
        sections = (_without_comments(part, layout) for part in segment)
        cells = read_cells(source, layout, wanted, sections)
        findings = [] if segment.is_last else [_left_out(path)]
    _check_rows(path, header, cells)
    time = [_time(path, header, cells)] if has_time else []
    channels = [
        Column(name, unit, cells[place].samples)
        for place, name, unit in zip(_places(header), header.names, header.units, strict=True)
    ]
    for place, name in zip(_places(header), header.names, strict=True):
        findings += missing_samples(path, name, cells[place])
    content = content_of_columns(path, [*time, *channels], rate_hz=header.rate_hz)
    return replace(content, findings=(*findings, *content.findings))


class _Segment:
    """Text up to where the header of another segment begins, which `is_last` tells."""

    def __init__(self, sections: Iterator[bytes]) -> None:
        self._sections = sections
        self.is_last = True

    def __iter__(self) -> Iterator[bytes]:
        for section in self._sections:
            header = _NEXT_HEADER.search(section)
            if header is not None:
                self.is_last = False
                yield _without_blank_end(section[: header.start()])
                return
            yield section


def _without_blank_end(section: bytes) -> bytes:
    """Drop the lines at the end that hold separators alone."""
    end = len(section)
    while end:
        start = section.rfind(b"\n", 0, end - 1) + 1
        if section[start:end].strip(b"\t,; \r\n"):
            break
        end = start
    return section[:end]


def _without_comments(section: bytes, layout: Layout) -> bytes:
    """Cut the last column, comments, which stand in few rows only and break off in others."""
    separator = layout.dialect.separator.encode()
    n_lines = section.count(b"\n")
    if section.count(separator) <= n_lines * (layout.width - 1):
        return section
    cut = bytearray()
    for line in section.splitlines():
        cut += separator.join(line.split(separator, layout.width)[: layout.width]) + b"\n"
    return bytes(cut) if section.endswith(b"\n") else bytes(cut[:-1])


def _places(header: LvmHeader) -> list[int]:
    """Columns of the channels."""
    stride = 2 if header.x_columns == "multi" else 1
    return [1 + stride * number for number in range(len(header.names))]


def _left_out(path: Path) -> Finding:
    detail = "the first segment is read; later ones are events of their own and left out"
    return remark(path, "", "segments", detail)


def _check_rows(path: Path, header: LvmHeader, cells: dict[int, Cells]) -> None:
    n_rows = len(cells[_places(header)[0]].samples)
    stated = max(header.n_samples, default=n_rows)
    if n_rows != stated:
        found = f"{n_rows} rows of numbers, {stated} samples by the header"
        rule = "the file is cut short" if n_rows < stated else "the header counts all of them"
        raise RecordingFormatError(path.name, found, rule, "Copy or export it again")


def _time(path: Path, header: LvmHeader, cells: dict[int, Cells]) -> Column:
    """The column of time, which all channels share."""
    stamps: NDArray[np.float64] = cells[0].samples
    for place, name in zip(_places(header), header.names, strict=True):
        own = cells[place - 1].samples if header.x_columns == "multi" else stamps
        if not np.array_equal(own, stamps, equal_nan=True):
            found = f"{name!r} and {header.names[0]!r} have times of their own"
            rule = "channels of one run are sampled together"
            raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    return Column("X_Value", "s", stamps)
