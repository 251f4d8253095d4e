"""Read universal files: time series and FRFs from 58 and 58b, nodes and units beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding
from ema.core.recording import Channel, Recording
from ema.io.columns import even_step, not_together, step_and_inverse
from ema.io.content import FileContent, remark
from ema.io.uff.dataset58 import read_values
from ema.io.uff.dataset58_header import (
    COHERENCE,
    FREQUENCY_RESPONSE,
    TIME_RESPONSE,
    Header58,
    ordinate_unit,
)
from ema.io.uff.frf import measured_only, read_frf
from ema.io.uff.geometry import Surroundings, read_surroundings
from ema.io.uff.scan import Dataset, damaged, place, scan

SUFFIXES = (".uff", ".unv", ".uf", ".bunv", ".58", ".ufb")
_SAME_RATE = 1e-6  # relative
_DIRECTIONS = {1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}
_SHAPES = (55, 2414)
_AROUND = (15, 18, 82, 151, 164, 1858, 2400, 2411, 2412, 2420)  # of no use alone
_DATASETS = {15: "nodes", 18: "coordinate systems", 55: "data at nodes", 56: "data at elements"}
_DATASETS |= {57: "data at nodes of elements", 82: "trace lines", 151: "file header", 164: "units"}
_DATASETS |= {1858: "qualifiers of functions", 2400: "model header", 2411: "nodes"}
_DATASETS |= {2412: "elements", 2414: "analysis data", 2420: "coordinate systems"}
_DATASETS |= {2429: "groups", 2467: "groups"}
_FUNCTIONS = {0: "general or unknown", 1: "time response", 2: "auto spectrum", 3: "cross spectrum"}
_FUNCTIONS |= {4: "frequency response", 5: "transmissibility", 6: "coherence"}
_FUNCTIONS |= {7: "auto correlation", 8: "cross correlation", 9: "power spectral density"}
_FUNCTIONS |= {10: "energy spectral density", 11: "probability density", 12: "spectrum"}
_FUNCTIONS |= {13: "cumulative frequency distribution", 17: "orbit", 18: "mode indicator function"}
_FUNCTIONS |= {19: "force pattern", 20: "partial power", 21: "partial coherence"}
_FUNCTIONS |= {24: "shock response spectrum", 26: "multiple coherence", 27: "order function"}


def read_headers(path: Path) -> FileContent:
    """Read a universal file without the numbers of long text: those samples are NaN."""
    return read(path, form_only=True)


def read(path: Path, *, form_only: bool = False) -> FileContent:
    """Read the time series and FRFs of a universal file.

    Payloads of 58b stay on disk as memory maps. Other function types and datasets are named in a
    finding. `RecordingFormatError` if the file is missing, damaged or truncated, or its channels do
    not belong together.
    """
    datasets = scan(path)
    times = [each for each in datasets if _function(each) == TIME_RESPONSE]
    responses = [each for each in datasets if _function(each) == FREQUENCY_RESPONSE]
    findings: list[Finding] = []
    if others := _describe_left_out(datasets):
        findings.append(remark(path, "", Check.CONTENT, others))
    responses = measured_only(path, responses, findings)
    findings += [
        remark(path, each.header58.id_lines[0], Check.BYTE_COUNT, each.remark)
        for each in (*times, *responses)
        if each.remark
    ]
    if not times and not responses:
        return FileContent(path, findings=tuple(findings))
    in_use = {each.header58.response_node for each in (*times, *responses)}
    around = read_surroundings(path, datasets, in_use)
    findings += around.findings
    recording, frf, shared_node = None, None, None
    if times:
        recording = _read_recording(path, times, around, findings, form_only=form_only)
    if responses:
        coherences = [each for each in datasets if _function(each) == COHERENCE]
        frf, shared_node = read_frf(path, responses, coherences, around, findings)
    names = tuple(_channel_name(each.header58, row) for row, each in enumerate(responses, 1))
    return FileContent(path, recording, frf, names, shared_node, tuple(findings))


def _describe_left_out(datasets: Sequence[Dataset]) -> str:
    """What a file contains besides time series and FRFs; empty where nothing is lost without it.

    Geometry, units and headers are named only in a file without time series and FRFs.
    """
    used = {TIME_RESPONSE, FREQUENCY_RESPONSE}
    if any(_function(each) == FREQUENCY_RESPONSE for each in datasets):
        used.add(COHERENCE)
    left = [each for each in datasets if _function(each) not in used]
    if len(left) < len(datasets):
        left = [each for each in left if each.number not in _AROUND]
    shapes = dict.fromkeys(_name(each) for each in left if each.number in _SHAPES)
    others = dict.fromkeys(_name(each) for each in left if each.number not in _SHAPES)
    parts = [f"{', '.join(others)}: not used by this program, left out"] if others else []
    if shapes:
        parts.append(f"{', '.join(shapes)}: left out; mode shapes are read by ema.read_shapes")
    return "; ".join(parts)


def _function(dataset: Dataset) -> int | None:
    return None if dataset.header is None else dataset.header.function_type


def _name(dataset: Dataset) -> str:
    function = _function(dataset)
    if function is not None:
        return f"function type {function} ({_FUNCTIONS.get(function, 'unknown')})"
    return f"dataset {dataset.number} ({_DATASETS.get(dataset.number, 'unknown')})"


def _read_recording(
    path: Path,
    datasets: Sequence[Dataset],
    around: Surroundings,
    findings: list[Finding],
    *,
    form_only: bool,
) -> Recording:
    channels: list[Channel] = []
    rates: list[float] = []
    for dataset in datasets:
        header = dataset.header58
        abscissa, values = read_values(path, dataset, form_only=form_only)
        if header.is_complex:
            found = f"{header.id_lines[0]!r} has complex values"
            raise damaged(place(path, dataset.index), found, "a time response must be real")
        rates.append(_sampling_rate(path, dataset, abscissa))
        unit = ordinate_unit(header.ordinate_axis, around.units)
        name = _channel_name(header, len(channels) + 1)
        if unit.remark:
            findings.append(remark(path, name, Check.UNIT, unit.remark))
        node = header.response_node
        factor = -unit.factor if header.response_direction < 0 else unit.factor
        angle_deg = around.angle_deg.get(node)
        channels.append(Channel(name, unit.quantity, unit.text, values, factor, node, angle_deg))
        if len(values) != channels[0].n_samples:
            first = f"{channels[0].n_samples} samples of {channels[0].name!r}"
            raise not_together(path, f"{first}, {len(values)} of {name!r}")
        if abs(rates[-1] - rates[0]) > _SAME_RATE * rates[0]:
            first = f"{rates[0]:g} Hz of {channels[0].name!r}"
            raise not_together(path, f"{first}, {rates[-1]:g} Hz of {name!r}")
    return Recording(path, rates[0], tuple(channels))


def _channel_name(header: Header58, number: int) -> str:
    """First ID line; where it is empty, the degree of freedom or the number in the file."""
    name = header.id_lines[0]
    if name and name.upper() != "NONE":
        return name
    if header.response_node:
        return f"{header.response_node}{_DIRECTIONS.get(header.response_direction, '')}"
    return f"channel {number}"


def _sampling_rate(path: Path, dataset: Dataset, abscissa: NDArray[np.float64] | None) -> float:
    header = dataset.header58
    if abscissa is not None:
        steps = even_step(abscissa)
        if steps is None:
            found = f"{header.id_lines[0]!r} is not sampled at equal steps"
            rule = "spectra need a constant sampling rate"
            remedy = "Resample it, or export it with even spacing"
            raise RecordingFormatError(place(path, dataset.index), found, rule, remedy)
        return steps[1]
    try:
        return step_and_inverse(header.abscissa_step)[1]
    except ValueError:
        found, rule = f"time step {header.abscissa_step!r}", "the time step must be positive"
        raise damaged(place(path, dataset.index, 9), found, rule) from None
