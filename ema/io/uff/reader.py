"""Read universal files: time series and FRFs from 58 and 58b, nodes and units beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Finding
from ema.core.recording import Channel, Recording
from ema.io.content import FileContent, remark
from ema.io.sampling import even_step, step_and_inverse
from ema.io.uff.dataset58 import read_form, read_values
from ema.io.uff.dataset58_header import FREQUENCY_RESPONSE, TIME_RESPONSE, Header58
from ema.io.uff.frf import driven_node, measured_only, read_frf
from ema.io.uff.geometry import Surroundings, read_surroundings
from ema.io.uff.scan import COPY_AGAIN, Dataset, place, scan
from ema.io.uff.units import describe_left_out, ordinate_unit

SUFFIXES = (".uff", ".unv", ".uf", ".bunv", ".58", ".ufb")
SampleReader = Callable[[Path, Dataset], tuple[NDArray[np.float64] | None, NDArray[Any]]]
_DIRECTIONS = {1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}


def read(path: Path) -> FileContent:
    """Read the time series and FRFs of a universal file.

    Payloads of 58b stay on disk as memory maps. Other function types and datasets that say
    nothing about time series or FRFs are counted in a finding.

    Raises
    ------
    RecordingFormatError
        If the file is missing, damaged or truncated, or its channels do not belong together.
    """
    return _read(path, read_values)


def read_headers(path: Path) -> FileContent:
    """Read a universal file without the numbers of long text: those samples are NaN.

    Raises
    ------
    RecordingFormatError
        As `read`, as far as headers and the places of the datasets show it.
    """
    return _read(path, read_form)


def _read(path: Path, read_samples: SampleReader) -> FileContent:
    datasets = scan(path)
    functions = [each for each in datasets if each.header is not None]
    times = [each for each in functions if _function_type(each) == TIME_RESPONSE]
    responses = [each for each in functions if _function_type(each) == FREQUENCY_RESPONSE]
    responses, drawn = measured_only(path, responses)
    findings = _remarks(path, datasets, times, responses) + drawn
    if not times and not responses:
        return FileContent(path, findings=findings)
    in_use = {_header(each).response_node for each in (*times, *responses)}
    around = read_surroundings(path, datasets, in_use)
    findings += around.findings
    recording, noticed = _read_recording(path, times, around, read_samples) if times else (None, ())
    findings += noticed
    frf = None
    if responses:
        frf, noticed = read_frf(path, responses, around.units, around.angle_deg)
        findings += noticed
    names = tuple(_channel_name(_header(each), row) for row, each in enumerate(responses, 1))
    return FileContent(path, recording, frf, names, driven_node(responses), findings)


def _header(dataset: Dataset) -> Header58:
    assert dataset.header is not None
    return dataset.header


def _function_type(dataset: Dataset) -> int:
    return _header(dataset).function_type


def _remarks(
    path: Path,
    datasets: Sequence[Dataset],
    times: Sequence[Dataset],
    responses: Sequence[Dataset],
) -> tuple[Finding, ...]:
    findings = []
    for dataset in (*times, *responses):
        if dataset.remark:
            name = _header(dataset).id_lines[0]
            findings.append(remark(path, name, "byte count", dataset.remark))
    left_out = describe_left_out(datasets)
    if left_out:
        findings.append(remark(path, "", "content", left_out))
    return tuple(findings)


def _read_recording(
    path: Path, datasets: Sequence[Dataset], around: Surroundings, read_samples: SampleReader
) -> tuple[Recording, tuple[Finding, ...]]:
    channels: list[Channel] = []
    rates: list[float] = []
    findings: list[Finding] = []
    for dataset in datasets:
        header = _header(dataset)
        abscissa, values = read_samples(path, dataset)
        if header.is_complex:
            found = f"{header.id_lines[0]!r} holds complex values"
            rule = "a time response must be real"
            raise RecordingFormatError(place(path, dataset.index), found, rule, COPY_AGAIN)
        rates.append(_sampling_rate(path, dataset, abscissa))
        unit = ordinate_unit(header.ordinate_axis, around.units)
        name = _channel_name(header, len(channels) + 1)
        if unit.remark:
            findings.append(remark(path, name, "unit", unit.remark))
        channels.append(
            Channel(
                name=name,
                quantity=unit.quantity,
                unit=unit.text,
                samples=values,
                scale_to_si=unit.factor * (-1.0 if header.response_direction < 0 else 1.0),
                node=header.response_node,
                angle_deg=around.angle_deg.get(header.response_node),
            )
        )
    _check_together(path, channels, rates)
    return Recording(path, rates[0], tuple(channels)), tuple(findings)


def _channel_name(header: Header58, number: int) -> str:
    """First ID line; where it says nothing, the degree of freedom or the number in the file."""
    name = header.id_lines[0]
    if name and name.upper() != "NONE":
        return name
    if header.response_node:
        return f"{header.response_node}{_DIRECTIONS.get(header.response_direction, '')}"
    return f"channel {number}"


def _sampling_rate(path: Path, dataset: Dataset, abscissa: NDArray[np.float64] | None) -> float:
    header = _header(dataset)
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
        found = f"time step {header.abscissa_step!r}"
        rule = "the time step must be positive"
        raise RecordingFormatError(place(path, dataset.index, 9), found, rule, COPY_AGAIN) from None


def _check_together(path: Path, channels: Sequence[Channel], rates: Sequence[float]) -> None:
    """Channels of one file share length and rate; name the first two that do not."""
    first = channels[0]
    for channel, rate in zip(channels, rates, strict=True):
        if channel.n_samples != first.n_samples:
            what = f"{first.n_samples} samples of {first.name!r}, {channel.n_samples}"
        elif abs(rate - rates[0]) > 1e-6 * rates[0]:
            what = f"{rates[0]:g} Hz of {first.name!r}, {rate:g} Hz"
        else:
            continue
        rule = "channels of one run are sampled together, at one rate and equally long"
        remedy = "Export them together, or in files of their own"
        raise RecordingFormatError(path.name, f"{what} of {channel.name!r}", rule, remedy)
