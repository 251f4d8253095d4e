"""Read HDF5 files: a dataset for each channel, or a matrix with the channels' names."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.errors import RecordingFormatError
from ema.io.columns import Column, content_of_columns, is_time, name_and_unit
from ema.io.content import FileContent, remark
from ema.io.hdf5_file import Hdf5Content, StoredArray, read_content
from ema.io.matrix import matrix_columns
from ema.io.stated_rate import stated_rate, states_rate

SUFFIXES = (".h5", ".hdf5")
_NAMES = ("names", "channels", "labels")
_UNITS = ("unit", "units")


def read(path: Path) -> FileContent:
    """Read the time series of an HDF5 file.

    A dataset of one dimension is a channel, named by the last part of its path (by all of it
    where names repeat); one of two dimensions holds several, named in its attribute ``names``,
    ``channels`` or ``labels``. The unit stands in the attribute ``unit`` or ``units``, or in
    square brackets behind the name. The rate follows from a dataset ``time`` or ``t``, or from
    ``sampling_rate_hz``, ``fs``, ``sample_rate``, ``dt`` and the like: attributes of the dataset,
    its groups or the file, or datasets of one number. Datasets stored in one piece stay on disk;
    others (compressed, in chunks) are read.

    Raises
    ------
    RecordingFormatError
        If h5py is not installed, the file is missing or damaged, claims to be far larger than it
        is, or its datasets do not belong together.
    """
    content = read_content(path)
    left_out = dict(content.left_out)
    series = []
    for array in content.arrays:
        if array.samples.size > 1 and np.squeeze(array.samples).ndim <= 2:
            series.append(array)
        elif not states_rate(array.name):
            left_out[array.path] = f"an array of shape {array.samples.shape}"
    if not series:
        held = "; ".join(f"{place}: {why}" for place, why in left_out.items()) or "nothing"
        rule = "a channel is a dataset of one dimension, or a row or column of a matrix"
        raise RecordingFormatError(path.name, held, rule, "Export the samples as such datasets")
    repeated = Counter(array.name for array in series)
    columns = [column for array in series for column in _columns(path, array, repeated)]
    read_in = content_of_columns(path, columns, rate_hz=stated_rate(path, _rates(content, series)))
    notes = tuple(
        remark(path, place, "content", f"{why}, left out") for place, why in left_out.items()
    )
    return replace(read_in, findings=notes + read_in.findings)


def _columns(path: Path, array: StoredArray, repeated: Counter[str]) -> list[Column]:
    samples = np.squeeze(array.samples)
    units = _texts(array, _UNITS)
    if samples.ndim == 2:
        return matrix_columns(f"{path.name}, {array.path}", samples, _texts(array, _NAMES), units)
    name, unit = name_and_unit(array.name)
    unit = units[0] if units else unit
    alone = repeated[array.name] == 1 or is_time(name, unit)
    return [Column(name if alone else array.path.strip("/"), unit, samples)]


def _rates(content: Hdf5Content, series: list[StoredArray]) -> dict[str, object]:
    """All that is said about rates: on the series, on what they are in, and beside them."""
    found: dict[str, object] = {}
    for array in series:
        found |= {f"{array.path}/{name}": value for name, value in array.attributes.items()}
        group = array.path
        while group:
            group = group.rpartition("/")[0]
            held = content.groups[group or "/"]
            found |= {f"{group}/{name}": value for name, value in held.items()}
    beside = [array for array in content.arrays if array.samples.size == 1]
    return found | {array.path: array.samples for array in beside}


def _texts(array: StoredArray, names: tuple[str, ...]) -> list[str]:
    """Texts of the first of these attributes that there is."""
    value = next((array.attributes[name] for name in names if name in array.attributes), None)
    values = value.ravel().tolist() if isinstance(value, np.ndarray) else [value]
    return [_text(each) for each in values if isinstance(each, str | bytes)]


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
