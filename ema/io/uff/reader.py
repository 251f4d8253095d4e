"""Read universal files: time series and FRFs from 58 and 58b, nodes and units beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import Channel, Recording
from ema.core.units import TIME
from ema.io.content import (
    FileContent,
    entries,
    not_together,
    note,
    remark,
    stated_windows,
    statements_of_1858,
)
from ema.io.rates import Rate, aligned, rate_findings, rate_of_stamps, rate_of_step
from ema.io.uff.dataset58_header import (
    COHERENCE,
    FORCE_DEG,
    FREQUENCY_RESPONSE,
    TIME_RESPONSE,
    Header58,
    ordinate_unit,
)
from ema.io.uff.frf import (
    about_padding,
    axis_factor,
    coherences_alone,
    read_frf,
    read_values,
    states_no_unit,
)
from ema.io.uff.geometry import Surroundings, read_nodes, read_surroundings
from ema.io.uff.scan import Dataset, Lines, damaged, place, scan

_SAME_RATE = 1e-6  # relative
_START_DIGITS = 5  # of an abscissa minimum behind the point
_DIRECTIONS = {1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}
_SHAPES = (55, 2414)
_QUALIFIERS = 1858
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


#: Begins the third ID line of FRFs that ringmodal exported from modes.
SYNTHESISED = "synthesised"
#: The third ID line of the FRFs of a result.
OF_A_RESULT = "FRFs of a result of ringmodal"
_OWN = (OF_A_RESULT, SYNTHESISED, "measured; direction")
_BESIDE_A_RESULT = "provenance.json"
_ROTATIONS = {4, 5, 6}  # directions about X, Y and Z


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
    responses = _translations(path, _measured_only(path, responses, findings), findings)
    findings += [
        # The closing delimiter confirms what is read.
        Finding(
            path.name, each.header58.id_lines[0], None, Check.BYTE_COUNT, Verdict.OK, each.remark
        )
        for each in (*times, *responses)
        if each.remark
    ]
    if not times and not responses:
        nodes = read_nodes(path, datasets)
        alone = coherences_alone(path, [each for each in datasets if _function(each) == COHERENCE])
        known = nodes if nodes.xyz else None
        return FileContent(path, findings=tuple(findings), nodes=known, coherences=alone)
    in_use = {each.header58.response_node for each in (*times, *responses)}
    forces = {each.header58.reference_node for each in responses} - {0}
    in_use |= forces if len(forces) > 1 else set()  # they may rove, and be the positions
    around = read_surroundings(path, datasets, in_use)
    findings += around.findings
    circle = around.circle
    if placed := dict(filter(None, map(_force_place, responses))):
        circle = replace(circle, angle_deg={**circle.angle_deg, **placed})
    recording, frf, is_result = None, None, False
    of_forces: tuple[tuple[int, int], ...] = ()
    if times:
        recording = _read_recording(path, times, around, findings, form_only=form_only)
    if responses:
        coherences = [each for each in datasets if _function(each) == COHERENCE]
        frf, of_forces = read_frf(path, responses, coherences, around, findings)
        if is_result := _is_of_a_result(path, responses):
            findings.append(note(path, Check.CONTENT, "FRFs that ringmodal made of recordings"))
    names = _channel_names([each.header58 for each in responses])
    windows, ignored = stated_windows(path, _statements(path, datasets, (*times, *responses)))
    noticed = *findings, *ignored
    unitless = tuple(row for row, each in enumerate(responses) if states_no_unit(each))
    found = FileContent(path, recording, frf, names, of_forces, noticed, circle, windows)
    return replace(found, frf_without_unit=unitless, is_result=is_result)


def _translations(path: Path, datasets: list[Dataset], findings: list[Finding]) -> list[Dataset]:
    """FRFs of translations and forces, without those of rotations and moments."""
    kept = [each for each in datasets if _is_translation(each.header58)]
    if len(kept) < len(datasets):
        detail = f"{len(datasets) - len(kept)} FRFs of rotations or moments (directions 4 to 6)"
        findings.append(remark(path, "", Check.DIRECTION, f"{detail}: left out"))
    return kept


def _is_of_a_result(path: Path, datasets: Sequence[Dataset]) -> bool:
    """Whether FRFs are what ringmodal made of recordings, by their ID lines or their folder."""
    if path.with_name(_BESIDE_A_RESULT).is_file():
        return True
    return all(each.header58.id_lines[2].startswith(_OWN) for each in datasets)


def _measured_only(path: Path, datasets: list[Dataset], findings: list[Finding]) -> list[Dataset]:
    """FRFs without those marked as synthesised, where there are others."""
    others = [each for each in datasets if not each.header58.id_lines[2].startswith(SYNTHESISED)]
    if len(others) < len(datasets):
        detail = "all FRFs are synthesised, none is measured"
        if others:
            drawn = f"{len(datasets) - len(others)} FRFs synthesised from modes"
            detail = f"{drawn}, left out beside {len(others)} measured ones"
        findings.append(remark(path, "", Check.CONTENT, detail))
    return others or datasets


def _is_translation(header: Header58) -> bool:
    directions = {abs(header.response_direction), abs(header.reference_direction)}
    return not directions & _ROTATIONS


def _force_place(dataset: Dataset) -> tuple[int, float] | None:
    """Node and angle of the force, where the fourth ID line states the angle."""
    header = dataset.header58
    name, _, value = header.id_lines[3].partition("=")
    if name.strip() != FORCE_DEG or not header.reference_node:
        return None
    try:
        return header.reference_node, float(value)
    except ValueError:
        return None


def _statements(
    path: Path, datasets: Sequence[Dataset], functions: Sequence[Dataset]
) -> dict[str, str]:
    """What ID lines and qualifiers (dataset 1858) state about the treatment of functions."""
    found: dict[str, str] = {}
    for each in functions:
        found |= entries(each.header58.id_lines[1:])
    for each in datasets:
        if each.number == _QUALIFIERS:
            lines = Lines(path, each)
            lines.text()
            found |= statements_of_1858([int(code) for code in lines.numbers((6,) * 12, 2)])
    return found


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
    names = _channel_names([each.header58 for each in datasets])
    rates: list[Rate] = []
    starts: list[tuple[float, float]] = []
    padded: list[Dataset] = []
    for dataset in datasets:
        header = dataset.header58
        abscissa, values = read_values(path, dataset, form_only=form_only, padded=padded)
        if header.is_complex:
            found = f"{header.id_lines[0]!r} has complex values"
            raise damaged(place(path, dataset.index), found, "a time response must be real")
        seconds = axis_factor(path, dataset, TIME)
        rates.append(_sampling_rate(path, dataset, abscissa, seconds))
        starts.append(_start(header, abscissa, seconds))
        unit = ordinate_unit(header.ordinate_axis, around.units_at(dataset))
        name = names[len(channels)]
        if unit.remark:
            findings.append(remark(path, name, Check.UNIT, unit.remark))
        node = header.response_node
        factor = -unit.factor if header.response_direction < 0 else unit.factor
        angle_deg = around.angle_deg.get(node)
        about = unit.quantity, unit.text, values, factor, node, angle_deg
        channels.append(Channel(name, *about, axis=abs(header.response_direction)))
        if len(values) != channels[0].n_samples and starts[-1][0] == starts[0][0]:
            first = f"{channels[0].n_samples} samples of {channels[0].name!r}"
            raise not_together(path, f"{first}, {len(values)} of {name!r}")
        if abs(rates[-1].hz - rates[0].hz) > _SAME_RATE * rates[0].hz:
            first = f"{rates[0].hz:g} Hz of {channels[0].name!r}"
            raise not_together(path, f"{first}, {rates[-1].hz:g} Hz of {name!r}")
    rate = rates[0]
    findings += [*rate_findings(path, rate), *about_padding(path, padded)]
    starts_s = [start for start, _ in starts]
    rounding_s = max(rounding for _, rounding in starts)
    together = aligned(path, channels, starts_s, rate.hz, findings, rounding_s=rounding_s)
    return Recording(path, rate.hz, together, (rate.low_hz, rate.high_hz))


def _start(
    header: Header58, abscissa: NDArray[np.float64] | None, seconds: float
) -> tuple[float, float]:
    """Time of the first sample in s, and the last place to which it is printed."""
    if abscissa is not None:
        return float(abscissa[0]) * seconds, 0.0
    size = abs(header.abscissa_min)
    place = 10.0 ** (math.floor(math.log10(size)) - _START_DIGITS) if size else 0.0
    return header.abscissa_min * seconds, place * seconds


def _channel_names(headers: Sequence[Header58]) -> tuple[str, ...]:
    """First ID lines; where they are empty or all the same, degrees of freedom or numbers."""
    titles = [header.id_lines[0] for header in headers]
    is_name = len(set(titles)) > 1 or len(titles) < 2
    names = []
    for number, header in enumerate(headers, 1):
        title = header.id_lines[0]
        dof = f"{header.response_node}{_DIRECTIONS.get(header.response_direction, '')}"
        dof = dof if header.response_node else f"channel {number}"
        names.append(title if is_name and title and title.upper() != "NONE" else dof)
    return tuple(names)


def _sampling_rate(
    path: Path, dataset: Dataset, abscissa: NDArray[np.float64] | None, seconds: float
) -> Rate:
    header = dataset.header58
    if abscissa is not None:
        rate = rate_of_stamps(abscissa * seconds, f"the times of {header.id_lines[0]!r}")
        if rate is None:
            found = f"{header.id_lines[0]!r} is not sampled at equal steps"
            rule = "spectra need a constant sampling rate"
            remedy = "Resample it, or export it with even spacing"
            raise RecordingFormatError(place(path, dataset.index), found, rule, remedy)
        return rate
    try:
        return rate_of_step(header.abscissa_step, "time step", seconds)
    except ValueError:
        found, rule = f"time step {header.abscissa_step!r}", "the time step must be positive"
        raise damaged(place(path, dataset.index, 9), found, rule) from None
